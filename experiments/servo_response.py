"""The arm's response to a ramp and to a step of its joint targets, for settings of servoj."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from breastscan.robot.ur.ur5e import PERIOD
from sim.arm.servo import ServoConfig, ServoJ
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene, SceneConfig

LOOKAHEADS = (0.03, 0.05, 0.1, 0.2)
GAINS = (100.0, 300.0, 1000.0, 2000.0)
RAMP_SPEED = 0.2
"""Speed of the ramp, reached in a second [rad/s]."""
STEP = 0.005
"""Height of the step [rad]: what servoj takes at once."""
DURATION = 3.0
"""Longest that a response is recorded [s]."""


@dataclass(frozen=True, kw_only=True)
class Response:
    """How the arm's six joints respond to one setting of servoj, sampled every period."""

    config: ServoConfig
    ramp_lag: Float[np.ndarray, "6"]
    """Time by which each joint trails the steady ramp [s]."""
    step: Float[np.ndarray, "n 6"]
    """Offset of each joint over the step's height [-]; row k is what `state` tells after the target
    of period k."""
    law: Float[np.ndarray, "n"]
    """The same as servoj commands it."""

    @property
    def half_time(self) -> Float[np.ndarray, "6"]:
        """Time until half of the step is done [s]."""
        after = (self.step > 0.5).argmax(axis=0)
        joints = np.arange(6)
        below, above = self.step[after - 1, joints], self.step[after, joints]
        return PERIOD * (after - 1 + (0.5 - below) / (above - below))

    @property
    def overshoot(self) -> float:
        """Of the joint that overshoots most [-]."""
        return float(self.step.max() - 1)


def respond(config: ServoConfig) -> Response:
    """Command the ramp and the step on all joints at once, in free space."""
    scene = Scene(SceneConfig(servo=config))
    seconds = np.arange(0.0, DURATION, PERIOD)
    ramp = RAMP_SPEED * np.where(seconds < 1.0, seconds**2 / 2, seconds - 0.5)
    lag = (ramp[-1] - _followed(scene, ramp)[-1]) / RAMP_SPEED
    steps = np.full(len(seconds), STEP)
    return Response(
        config=config,
        ramp_lag=lag,
        step=_followed(scene, steps) / STEP,
        law=_commanded(config, steps) / STEP,
    )


def sweep() -> list[Response]:
    """Every pair of lookahead time and gain, the lookahead slowest."""
    return [
        respond(ServoConfig(lookahead_time=time, gain=gain))
        for time, gain in product(LOOKAHEADS, GAINS)
    ]


def _followed(scene: Scene, offsets: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 6"]:
    """Offsets of the joints that are sent `offsets` [rad] from where the arm is parked."""
    robot, rows = SimRobot(scene), []
    for offset in offsets:
        robot.servo_joint(HOME_Q + offset)
        rows.append(robot.state().q - HOME_Q)
    return np.array(rows)


def _commanded(config: ServoConfig, offsets: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    servo, rows = ServoJ(config, np.zeros(6)), []
    for offset in offsets:
        rows.append(servo.q_end[0])
        servo.follow(np.full(6, offset))
    return np.array(rows)
