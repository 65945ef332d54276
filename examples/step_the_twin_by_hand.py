"""Drive the twin's arm yourself: a joint target every 2 ms, a state after each."""

import numpy as np

from sim import Twin

SWING = np.deg2rad([0.0, 0.0, 0.0, 0.0, 0.0, 10.0])
"""How far each joint swings [rad]."""
SECONDS = 1.0

robot = Twin().robot
start = robot.state()
for time in np.arange(0.0, SECONDS, robot.period):
    robot.servo_joint(start.q + SWING * (1 - np.cos(2 * np.pi * time / SECONDS)) / 2)
    if round(time / robot.period) % 100 == 0:
        state = robot.state()
        print(
            f"{state.time:.3f} s: joint 6 turned by {np.rad2deg(state.q - start.q)[5]:5.2f} deg, "
            f"at {np.rad2deg(state.qd)[5]:6.2f} deg/s"
        )
