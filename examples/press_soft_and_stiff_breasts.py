"""Lower the probe by hand onto breasts of different stiffness: the force that the wrist sensor
measures, and the true one.
"""

import numpy as np

from breastscan.geometry import se3
from sim import PhantomConfig, SceneConfig, Twin

ABOVE, BELOW = 0.02, -0.006
"""Heights of the tip over the skin at the start and at the end [m]."""
SPEED = 0.02
"""[m/s]"""

for young in (15e3, 30e3, 45e3):
    twin = Twin(SceneConfig(phantom=PhantomConfig(young=young)))
    robot, arm, X_PF = twin.robot, twin.robot.calibration, se3.inverse(twin.robot.X_FP)
    p_BP = twin.scene.X_BS[:3, 3] + np.array([0.02, 0.0, twin.scene.phantom.height + ABOVE])
    X_BP = se3.from_rotation_vector(np.array([np.pi, 0.0, 0.0]), p_BP)  # pointing down

    solutions = arm.inverse(X_BP @ X_PF)
    nearest = np.abs(solutions - robot.state().q).max(axis=1).argmin()
    robot.move_joint(solutions[nearest], speed=1.0, acceleration=2.0)
    robot.tare()

    q = robot.state().q
    for _ in range(round((ABOVE - BELOW) / (SPEED * robot.period))):
        X_BP[2, 3] -= SPEED * robot.period
        q = arm.step(q, X_BP @ X_PF)
        robot.servo_joint(q)

    measured, truth = -robot.state().wrench_P[2], robot.truth_log()
    print(
        f"{young * 1e-3:.0f} kPa: {measured:.2f} N measured, {truth.force_axial[-1]:.2f} N true, "
        f"{1e3 * truth.depth[-1]:.1f} mm deep"
    )
