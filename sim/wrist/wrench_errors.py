"""What a wrist sensor gets wrong: each error by itself, and the classes of sensors that set them
all.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import Literal

from breastscan.errors import ConfigError
from breastscan.robot.ur.ur5e import PERIOD

Quality = Literal["ideal", "industrial", "ur5e_builtin"]
MINUTE = 60.0
TORQUE_ARM = 0.05
"""Error of a torque over that of a force, where only the force's is known [m]: between those of the
classes' noise."""


@dataclass(frozen=True, kw_only=True)
class WrenchErrors:
    """How a six-axis sensor differs from a perfect one, and its readings from the wrench of the
    tissue alone.
    """

    force_noise: float = 0.0
    """RMS noise of each force component, as it is read [N]."""
    torque_noise: float = 0.0
    """RMS noise of each torque component [N m]."""
    bandwidth: float = math.inf
    """Frequency at which a reading is down to 1/sqrt(2), of a first-order low-pass [Hz]."""
    resolution: float = 0.0
    """Step of the force readings [N]; that of the torques is `TORQUE_ARM` times as large [N m]."""
    drift: float = 0.0
    """Speed at which the force reading creeps away in some direction [N/s]; the torque's
    likewise."""
    gain_error: float = 0.0
    """Relative error of each axis's sensitivity, one sigma [-]."""
    cross_talk: float = 0.0
    """Fraction of a load that shows on another axis of its kind, one sigma [-]."""
    pose_offset: float = 0.0
    """Maximum by which the force reading changes when the flange tilts by 60 degrees, beside the
    tool's weight [N]."""
    force_range: float = math.inf
    """Force at which a component saturates [N]."""
    torque_range: float = math.inf
    """Torque at which a component saturates [N m]."""
    sample_rate: float = 1 / PERIOD
    """New readings a second [Hz]; between them the last one stands."""
    knows_acceleration: bool = True
    """Whether the tool's inertia is taken out with its true acceleration; else with the change of
    its speed over the last period, which is all that joint encoders tell."""


WRENCH_CLASSES: dict[Quality, WrenchErrors] = {
    "ideal": WrenchErrors(),
    "industrial": WrenchErrors(
        force_noise=0.05,
        torque_noise=0.002,
        bandwidth=100.0,
        resolution=0.02,
        drift=0.1 / MINUTE,
        gain_error=0.01,
        cross_talk=0.01,
        knows_acceleration=False,
    ),
    "ur5e_builtin": WrenchErrors(
        force_noise=0.3,
        torque_noise=0.02,
        bandwidth=50.0,
        resolution=0.1,
        drift=4.0 / (5 * MINUTE),
        gain_error=0.03,
        cross_talk=0.03,
        pose_offset=1.5,
        force_range=50.0,
        torque_range=10.0,
        knows_acceleration=False,
    ),
}
"""Noise, bandwidth, resolution, gain and cross-talk are engineering values of the class. The
built-in sensor's drift: UR ROS driver, issues 269 and 633 (4 N in 5 minutes, unmoved); its range:
the UR5e's data sheet."""


@dataclass(frozen=True, kw_only=True)
class WrenchSensorConfig:
    """How well the wrist feels: a class of errors, any of which can be set by itself."""

    quality: Quality = "industrial"
    """Class of errors. The tool carries a six-axis sensor, so this is `industrial` unless told
    otherwise."""
    force_noise: float | None = None
    """RMS noise of each force component [N]; None for the class's."""
    torque_noise: float | None = None
    """RMS noise of each torque component [N m]; None for the class's."""
    bandwidth: float | None = None
    """Of a first-order low-pass [Hz]; None for the class's."""
    resolution: float | None = None
    """Step of the force readings [N]; None for the class's."""
    drift: float | None = None
    """Speed at which the force reading creeps away [N/s]; None for the class's."""
    gain_error: float | None = None
    """Relative error of each axis's sensitivity, one sigma [-]; None for the class's."""
    cross_talk: float | None = None
    """Fraction of a load that shows on another axis, one sigma [-]; None for the class's."""
    pose_offset: float | None = None
    """Maximum by which the force reading changes when the flange tilts by 60 degrees [N]; None for
    the class's."""
    force_range: float | None = None
    """Force at which a component saturates [N]; None for the class's."""
    torque_range: float | None = None
    """Torque at which a component saturates [N m]; None for the class's."""
    sample_rate: float | None = None
    """New readings a second [Hz]; None for the class's."""
    knows_acceleration: bool | None = None
    """Whether the tool's inertia is taken out exactly; None for the class's."""
    seed: int | None = None
    """Draws the noise and the errors that one sensor keeps: gains, cross-talk, directions of drift
    and offset; None follows the seed of the whole."""

    def __post_init__(self) -> None:
        if self.quality not in WRENCH_CLASSES:
            raise ConfigError(
                f"quality must be one of {', '.join(WRENCH_CLASSES)}, got {self.quality!r}",
                self.quality,
            )
        errors = self.errors
        for name in (
            "force_noise",
            "torque_noise",
            "resolution",
            "drift",
            "gain_error",
            "cross_talk",
            "pose_offset",
        ):
            if not 0 <= getattr(errors, name) < math.inf:
                raise ConfigError(
                    f"wrist.{name} must be finite and not negative, got {getattr(errors, name)}",
                    self,
                )
        for name in ("bandwidth", "force_range", "torque_range"):
            if not getattr(errors, name) > 0:
                raise ConfigError(
                    f"wrist.{name} must be positive, got {getattr(errors, name)}", self
                )
        periods = 1 / (errors.sample_rate * PERIOD) if errors.sample_rate > 0 else math.nan
        if not (periods >= 1 and abs(periods - round(periods)) < 1e-6):
            raise ConfigError(
                f"wrist.sample_rate must be {1 / PERIOD:.0f} Hz or a whole fraction of it, got "
                f"{errors.sample_rate}",
                errors.sample_rate,
            )

    @property
    def errors(self) -> WrenchErrors:
        """The class's errors, with those that are set by themselves in place of them."""
        own = {field.name: getattr(self, field.name) for field in fields(WrenchErrors)}
        return replace(
            WRENCH_CLASSES[self.quality],
            **{name: value for name, value in own.items() if value is not None},
        )
