"""A robot of the tests: a servo that is exact but may be late, and a flat elastic surface under
the probe.
"""

from collections import deque

import numpy as np

from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.interface import RobotState
from breastscan.servo import Servo

PERIOD = 0.008
"""Control period [s]: the law runs at 125 Hz as at 500, and the tests are over sooner."""
NOISE = 1e-4
"""RMS noise of every channel of the sensor [N, N m]."""
X_FP = se3.pose(np.eye(3), np.array([0.0, 0.0, 0.15]))


class SpringRobot:
    """Moves exactly as told, `late` periods later; a plane z = height in B pushes back with a
    stiffness [N/m].

    Its sensor has a little noise, as any has: one that repeats itself counts as frozen.
    """

    period = PERIOD

    def __init__(self, q, height, stiffness=1000.0, late=0):
        self.q = np.array(q, float)
        self.height = height
        self.stiffness = stiffness
        self.calibration = KinematicCalibration.nominal()
        self.X_FP = X_FP
        self.time = 0.0
        self.offset = np.zeros(6)
        self.servo = Servo.pure_delay(late * self.period)
        self._waiting = deque([self.q] * late)
        self.qd = np.zeros(6)
        self.stopped = False
        self.largest_force = 0.0
        self._rng = np.random.default_rng(0)

    def state(self):
        wrench_P = self._wrench() - self.offset + NOISE * self._rng.standard_normal(6)
        return RobotState(
            time=self.time,
            q=self.q.copy(),
            qd=self.qd.copy(),
            wrench_P=wrench_P,
            sample=round(self.time / self.period),
        )

    def _wrench(self):
        X_BP = kinematics.forward(self.q) @ self.X_FP
        force = self.stiffness * max(self.height - X_BP[2, 3], 0.0)
        self.largest_force = max(self.largest_force, force)
        return np.concatenate([X_BP[:3, :3].T @ [0.0, 0.0, force], np.zeros(3)])

    def servo_joint(self, q):
        self._waiting.append(q.copy())
        q = self._waiting.popleft()
        self.qd, self.q = (q - self.q) / self.period, q
        self.time += self.period

    def move_joint(self, q, speed, acceleration):
        self.q, self.qd = np.array(q, float), np.zeros(6)
        self._waiting = deque([self.q] * len(self._waiting))
        self.time += 1.0

    def tare(self):
        self.offset = self._wrench()

    def stop(self):
        self.stopped = True
