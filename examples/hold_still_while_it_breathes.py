"""A patient who breathes under a probe that holds still, pressed in by 4 mm: why a scan controls
its force.
"""

import numpy as np

from breastscan.geometry import se3
from sim import BreathingConfig, SceneConfig, Twin

twin = Twin(SceneConfig(breathing=BreathingConfig(amplitude=0.001, rate=0.5)))
robot = twin.robot


def joints(height: float) -> np.ndarray:
    """The nearest joint angles [rad] with the tip, pointing down, so high over the skin [m]."""
    p_BP = twin.scene.X_BS[:3, 3] + np.array([0.02, 0.0, twin.scene.phantom.height + height])
    X_BP = se3.from_rotation_vector(np.array([np.pi, 0.0, 0.0]), p_BP)
    solutions = robot.calibration.inverse(X_BP @ se3.inverse(robot.X_FP))
    return solutions[np.abs(solutions - robot.state().q).max(axis=1).argmin()]


robot.move_joint(joints(0.02), speed=1.0, acceleration=2.0)
robot.tare()
robot.move_joint(joints(-0.004), speed=0.05, acceleration=0.5)

held = robot.state().q
force = []
for _ in np.arange(0.0, 2.0, robot.period):  # one breath
    robot.servo_joint(held)
    force.append(-robot.state().wrench_P[2])
print(f"force over one breath of 2 mm: {min(force):.2f} to {max(force):.2f} N")
