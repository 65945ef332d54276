"""How an arm follows streamed joint targets.

The law of a UR's servoj, read from its manual [UR-script] as an acceleration,

    q''(t) = gain (target(t - transport) - (q(t) + lookahead_time q'(t))),

trails a steady motion by `transport + lookahead_time`, whatever its gain, and is damped by
`lookahead_time sqrt(gain) / 2`. Every robot says its own three numbers, and whoever leads the arm
or predicts it goes by them.
"""

import math
from dataclasses import dataclass

from breastscan.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Servo:
    """The three parameters of a servo that follows streamed joint targets."""

    lookahead_time: float
    """Time by which the joint's position is projected ahead with its speed [s]."""
    gain: float
    """Acceleration per error of the projected position [1/s^2]; infinite for an arm that is at a
    target as soon as that arrives."""
    transport: float
    """Dead time: from the sending of a target until it arrives at the law, on the clock of the
    robot's states [s]."""

    def __post_init__(self) -> None:
        if not (0 <= self.lookahead_time < math.inf and 0 <= self.transport < math.inf):
            raise ConfigError(
                "a servo's lookahead_time and transport must be finite and not negative, got "
                f"{self.lookahead_time} s and {self.transport} s",
                self,
            )
        if not self.gain > 0:
            raise ConfigError(f"a servo's gain must be positive, got {self.gain} 1/s^2", self.gain)

    @staticmethod
    def pure_delay(transport: float) -> "Servo":
        """An arm that is at each target `transport` [s] after it was sent."""
        return Servo(lookahead_time=0.0, gain=math.inf, transport=transport)

    @property
    def lag(self) -> float:
        """Time by which the arm trails a steady motion of its targets [s]."""
        return self.transport + self.lookahead_time
