"""How the arm follows streamed joint targets: the controller's servoj.

The controller's law is not published. The script manual says that `gain` acts like the P term on
the error between the joint's position and the target, and that `lookahead_time` projects that
position ahead with the present speed [UR-script]. Read as an acceleration, that is the law of
`breastscan.servo`, here once a period. With nothing fitted it gives what was measured and reported:
30 ms beside the transport at .03 s [UR-lag]; overshoot at .03 s and 300, the settings of an early
driver, where the damping is .26 [UR-overshoot]; calm motion at .03 s and 2000, those of its
successor (.67), and at the manual's own .1 s and 300 (.87).
"""

from collections import deque
from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError
from breastscan.robot.ur.ur5e import PERIOD, SERVO
from breastscan.servo import Servo

LOOKAHEAD_RANGE = (0.03, 0.2)
"""Of servoj's `lookahead_time` [s], from the script manual."""
GAIN_RANGE = (100.0, 2000.0)
"""Of servoj's `gain`, from the script manual."""
LONGEST_TRANSPORT = 0.1
"""Transport that is still a control loop [s]."""


@dataclass(frozen=True, kw_only=True)
class ServoConfig:
    """How the controller follows joint targets; the same two numbers as servoj takes."""

    lag: bool = True
    """Whether it follows as servoj does; False for a servo that is at its target one period
    later."""
    lookahead_time: float = SERVO.lookahead_time
    """Time by which the joint's position is projected ahead [s]: longer is smoother and later."""
    gain: float = SERVO.gain
    """Proportional gain on the error to the target [1/s^2]: lower is later, and less damped."""
    transport: float = SERVO.transport + PERIOD
    """From the sending of a target to the first sample that shows its effect [s]; 2 or 3 periods on
    a robot."""

    def __post_init__(self) -> None:
        for name, (low, high) in (
            ("lookahead_time", LOOKAHEAD_RANGE),
            ("gain", GAIN_RANGE),
            ("transport", (PERIOD, LONGEST_TRANSPORT)),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ConfigError(
                    f"servo.{name} must lie in {low:g} .. {high:g}, got {value}", value
                )
        if abs(self.transport / PERIOD - round(self.transport / PERIOD)) > 1e-6:
            raise ConfigError(
                f"servo.transport must be a multiple of the control period of {PERIOD} s, got "
                f"{self.transport} s",
                self.transport,
            )

    @property
    def delay_periods(self) -> int:
        """Periods for which a target waits before servoj sees it."""
        return round(self.transport / PERIOD) - 1

    @property
    def servo(self) -> Servo:
        """What a robot with these settings says of its servo: a target's effect shows in the sample
        after the period in which it arrives.
        """
        if not self.lag:
            return Servo.pure_delay(PERIOD)
        return Servo(
            lookahead_time=self.lookahead_time, gain=self.gain, transport=self.transport - PERIOD
        )


class ServoJ:
    """Position and speed that the controller asks of the drives, one period after the other."""

    def __init__(self, config: ServoConfig, q: Float[np.ndarray, "6"]) -> None:
        """Start at rest at `q` [rad]."""
        self.config = config
        """How it follows; another lookahead time or gain counts from the next period on."""
        self.q = np.array(q, float)
        """Where the joints are to be as the period begins [rad]."""
        self.qd = np.zeros(6)
        """How fast they are to move through it [rad/s]."""
        self.qdd = np.zeros(6)
        """Change of that speed since the period before, over the period [rad/s^2]."""
        self._forget_waiting()

    @property
    def q_end(self) -> Float[np.ndarray, "6"]:
        """Where the joints are to be as the period ends [rad]."""
        return self.q + PERIOD * self.qd

    @property
    def commanded(self) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """Joint angles as the period ends [rad], and speeds [rad/s]."""
        return self.q_end, self.qd

    def follow(self, target: Float[np.ndarray, "6"]) -> None:
        """A period of servoj, in which `target` [rad] is sent."""
        if not self.config.lag:
            self.go(target)
            return
        self._waiting.append(target.copy())
        self.q, self.qd, self.qdd = _servoj(
            self.q, self.qd, self._waiting.popleft(), self.config.lookahead_time, self.config.gain
        )

    def go(self, q: Float[np.ndarray, "6"]) -> None:
        """A period of the controller's own motions, that ends at `q` [rad]."""
        self.q = self.q_end
        qd = (q - self.q) / PERIOD
        self.qdd, self.qd = (qd - self.qd) / PERIOD, qd
        self._forget_waiting()

    def place(self, q: Float[np.ndarray, "6"], qd: Float[np.ndarray, "6"]) -> None:
        """Take for commanded where the joints have got to by themselves [rad], [rad/s]."""
        self.q = q - PERIOD * qd
        self.qd, self.qdd = qd, np.zeros(6)
        self._forget_waiting()

    def _forget_waiting(self) -> None:
        self._waiting = deque([self.q_end] * self.config.delay_periods)


@numba.njit(cache=True)
@no_type_check  # keeps the tests' run-time type checker from wrapping what numba compiles
def _servoj(q, qd, target, lookahead_time, gain):
    """A period of the law: compiled, because six numbers cost NumPy more than their arithmetic."""
    q_next = q + PERIOD * qd
    qdd = gain * (target - (q_next + lookahead_time * qd))
    return q_next, qd + PERIOD * qdd, qdd
