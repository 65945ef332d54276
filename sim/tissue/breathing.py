"""The patient breathes: the chest, and the breast with it, rises and falls along its normal.

At the end of an exhalation p_BS holds; from there it rises by twice the amplitude at the most.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from breastscan.errors import ConfigError

Waveform = Literal["sine", "cos4"]
LARGEST_AMPLITUDE = 0.02
"""The deepest breath that leaves a scan possible [m]."""
FASTEST_RATE = 1.0
"""Breaths a second of someone out of breath [Hz]."""


@dataclass(frozen=True, kw_only=True)
class BreathingConfig:
    """How deep, how fast, and in what rhythm."""

    amplitude: float = 0.0
    """Half of the chest's stroke along its normal [m]; 0 for a breath that is held, .005 for a
    calm one."""
    rate: float = 0.25
    """Breaths a second [Hz]."""
    waveform: Waveform = "sine"
    """A sine, or the fourth power of a cosine, which dwells at the end of the exhalation as people
    do [Lujan]."""
    phase: float = 0.0
    """Where in the breath the robot's clock starts, and so where the pictures find the chest: a
    fraction of a breath past the end of the exhalation, 0 to 1 [-]."""

    def __post_init__(self) -> None:
        if not 0 <= self.amplitude <= LARGEST_AMPLITUDE:
            raise ConfigError(
                f"amplitude must lie in 0 .. {LARGEST_AMPLITUDE} m, got {self.amplitude} m", self
            )
        if not 0 < self.rate <= FASTEST_RATE:
            raise ConfigError(f"rate must lie in (0, {FASTEST_RATE}] Hz, got {self.rate} Hz", self)
        if not 0 <= self.phase <= 1:
            raise ConfigError(f"phase must lie in 0 .. 1, got {self.phase}", self)
        if self.waveform not in get_args(Waveform):
            raise ConfigError(
                f"waveform must be one of {', '.join(get_args(Waveform))}, got {self.waveform!r}",
                self,
            )


def rise(config: BreathingConfig, time: float) -> float:
    """Way of the chest along its normal from the end of the exhalation [m] at `time` [s]."""
    wave = math.sin(_angle(config, time)) ** 2
    return 2 * config.amplitude * (wave if config.waveform == "sine" else wave**2)


def rising_speed(config: BreathingConfig, time: float) -> float:
    """Derivative of `rise` with respect to time [m/s]."""
    angle = _angle(config, time)
    change = math.pi * config.rate * math.sin(2 * angle)
    return (
        2
        * config.amplitude
        * change
        * (1 if config.waveform == "sine" else 2 * math.sin(angle) ** 2)
    )


def _angle(config: BreathingConfig, time: float) -> float:
    """Half of the breath's angle [rad], 0 at the end of an exhalation."""
    return math.pi * (config.rate * time + config.phase)
