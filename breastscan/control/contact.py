"""From the force error to a correction of the pose along the probe axis [Zhang, Sec. V-B.2, Fig.
23].

The correction is a rate, from a force law, bounded, and summed to a depth;
`control.selection` joins it with the plan. Pure functions of (measurement, reference, memory) ->
memory: the twin and the robot run the same code.
"""

import math
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Annotated, Any, cast

import tyro

from breastscan.checks import require_positive
from breastscan.control.filters import Filtered
from breastscan.control.follower import stopping_speed, towards
from breastscan.control.force_law import ForceLaw, Measurement, Reference
from breastscan.control.laws import DEFAULT_LAW, LAW_NAMES, LawName, Laws
from breastscan.control.phases import PhaseConfig
from breastscan.control.servo_model import ServoModel
from breastscan.control.surface import SkinEstimate, SurfaceConfig
from breastscan.control.tilt import TiltConfig
from breastscan.errors import ConfigError
from breastscan.servo import Servo

LawOption = Annotated[
    LawName | ForceLaw,
    tyro.conf.arg(constructor=cast(type, LawName), help_behavior_hint=f"(default: {DEFAULT_LAW})"),
]
"""On the command line a law has a name; in Python it may be an object."""
CONTACT_HZ = 10.0
"""Corner of the low-pass on the force that decides whether there is contact [Hz]."""
CONTACT_SIGMA = 3.0
"""Noise below this many times itself is no contact: five times the filtered noise of a sensor of 50
Hz."""
PRESSING_SPEED_RATIO = 4.0
"""Largest speed into the skin, where it is felt, over the approach's [-]: by default that is
`rate_limit`. A body that is approached slowly because it is hard is pressed slowly too, whatever a
law requests."""
SMOOTHING_TIME = 0.034
"""Lag, a UR's, below which the law's requests are smoothed as such an arm would, with a noisy
sensor [s]: they follow the noise of the force, an arm that is at once where it is sent throws the
tool about with them, and its inertia, which shows in the force, would drive them on."""
QUIET = 0.01
"""Noise of the force with which half of that will do [N]."""
NOISE_TIME = 0.5
"""Time over which the sensor's noise is taken, in the air [s]."""


@dataclass(frozen=True, kw_only=True)
class ContactConfig:
    """How the probe keeps its force on the skin."""

    law: LawOption = DEFAULT_LAW
    """What turns the force error into a speed of the tip: one of the names that `docs/control.md`
    compares, or a law of your own (`control.force_law`)."""
    force: float = 5.0
    """Set-point of the contact force along the probe axis [N]."""
    contact_force: float = 0.5
    """Force that counts as contact [N]; more where the sensor is too noisy for it."""
    rate_limit: float = 0.06
    """Bound of the correction's speed [m/s]."""
    acceleration: float = 1.0
    """Bound of its change [m/s^2]: from rest to `rate_limit` in 60 ms, twice the servo's lag."""
    depth_limit: float = 0.03
    """Bound of the correction, in both directions from the planned skin [m]: planning error,
    breathing and indentation together."""
    phases: PhaseConfig = field(default_factory=PhaseConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    tilt: TiltConfig = field(default_factory=TiltConfig)
    gains: Laws = field(default_factory=Laws)
    """The laws that have a name."""

    def __post_init__(self) -> None:
        require_positive(self, "contact", but=("law",))
        if self.law not in LAW_NAMES and not _is_own_law(self.law):
            raise ConfigError(
                f"contact.law must be one of {', '.join(LAW_NAMES)}, or an instance of a dataclass "
                f"with the methods of control.force_law.ForceLaw, got {self.law!r}",
                self.law,
            )
        if self.contact_force >= self.force:
            raise ConfigError(
                f"contact.contact_force ({self.contact_force} N) must be below the set-point "
                f"({self.force} N)",
                self.force,
            )

    @property
    def force_law(self) -> ForceLaw:
        """The law itself."""
        return self.gains.named(self.law) if isinstance(self.law, str) else self.law


def _is_own_law(law: object) -> bool:
    """Whether it can be called, and written down with the settings."""
    return is_dataclass(law) and not isinstance(law, type) and isinstance(law, ForceLaw)


@dataclass(frozen=True)
class ContactMemory:
    """What the controller carries from one period to the next."""

    depth: float
    """Commanded displacement of the tip along its axis from the planned skin, positive into the
    tissue [m]."""
    rate: float
    """Speed of that displacement [m/s]."""
    servo: ServoModel
    """Where the servo has the tip by now."""
    slow: Filtered
    """The force that decides on contact."""
    last: float
    """The last measured force [N]."""
    variance: float
    """Of the sensor's noise, estimated in the air [N^2]."""
    surface: SkinEstimate | None
    """The estimate of the skin; None without contact."""
    stiffness: float
    """The stiffest that it was found to be, in contacts that ended [N^(2/3)/m]: what threw the
    probe off once would do so again."""
    law: Any
    """What the force law carries from one period to the next; None without contact."""

    @staticmethod
    def resting(depth: float, servo: Servo, period: float) -> "ContactMemory":
        """At rest in the air, `depth` [m] from the planned skin, on an arm with this servo."""
        model = ServoModel.resting(depth, servo, period)
        return ContactMemory(depth, 0.0, model, Filtered(), 0.0, 0.0, None, 0.0, None)

    @property
    def noise(self) -> float:
        """Of the force [N], RMS."""
        return math.sqrt(self.variance)


def touches(memory: ContactMemory, config: ContactConfig) -> bool:
    """Whether the force says that the skin is there; a contact ends at half the force at which
    it begins.
    """
    threshold = _threshold(memory, config)
    return memory.slow.force > (threshold if memory.surface is None else 0.5 * threshold)


def sense(
    memory: ContactMemory, force: float, config: ContactConfig, period: float
) -> ContactMemory:
    """Take in a measured force [N], the servo being where its model has it.

    In the air the sensor's noise is estimated, from the differences of samples, in which a slow
    touch does not show; in contact, the skin.
    """
    slow = memory.slow.after(force, CONTACT_HZ, period)
    variance = memory.variance
    surface = memory.surface
    if surface is None:
        variance += (0.5 * (force - memory.last) ** 2 - variance) * period / NOISE_TIME
    else:
        surface = surface.after(memory.servo.position, force, memory.noise, config.surface, period)
    return replace(memory, slow=slow, last=force, variance=variance, surface=surface)


def begin(memory: ContactMemory, config: ContactConfig) -> ContactMemory:
    """Begin a contact: the skin is where the tip feels it."""
    force = memory.slow.force
    stiffness = max(memory.stiffness, config.surface.stiffness)
    surface = SkinEstimate.at_contact(memory.servo.position, force, stiffness, config.surface)
    return replace(memory, surface=surface, law=config.force_law.begin(force))


def end(memory: ContactMemory) -> ContactMemory:
    """End a contact: the estimate of where the skin is is dropped, not that of its stiffness."""
    assert memory.surface is not None, "a contact ends after `begin`"
    return replace(memory, surface=None, stiffness=max(memory.stiffness, memory.surface.stiffness))


def advance(
    memory: ContactMemory, speed: float, acceleration: float, lag: float, period: float
) -> ContactMemory:
    """Move along the axis, whatever the force.

    Args:
        memory: State.
        speed: Where to [m/s], reached at an `acceleration` [m/s^2].
        acceleration: Bound of the speed's change.
        lag: Of the servo [s].
        period: Control period [s].
    """
    rate = towards(memory.rate, speed, acceleration, period)
    return _moved(memory, memory.depth + rate * period, rate, memory.law, lag, period)


def regulate(
    memory: ContactMemory, reference: Reference, config: ContactConfig, lag: float, period: float
) -> ContactMemory:
    """One period of force control, after `sense`.

    Args:
        memory: State, in contact.
        reference: Force wanted now.
        config: Law and bounds.
        lag: Of the servo [s].
        period: Control period [s].

    Returns:
        The state after this period; its depth comes to rest at `config.depth_limit`.
    """
    assert memory.surface is not None, "force control begins with `begin`"
    # what an arm does not smooth is smoothed for it, and counts as lag
    smoothing = max(SMOOTHING_TIME * memory.noise / (memory.noise + QUIET) - lag, 0.0)
    measurement = Measurement(
        memory.last, memory.depth, memory.rate, memory.surface, lag + smoothing, period
    )
    requested, law = config.force_law.speed(measurement, reference, memory.law)
    requested = memory.rate + (requested - memory.rate) * period / (period + smoothing)
    acceleration, limit = config.acceleration, config.rate_limit
    approach = config.phases.approach_speed
    inward = min(PRESSING_SPEED_RATIO * approach if _presses(memory, config) else approach, limit)
    # in time to stop at the bounds of the depth
    inward = min(inward, stopping_speed(config.depth_limit - memory.depth, acceleration))
    outward = min(limit, stopping_speed(config.depth_limit + memory.depth, acceleration))
    rate = towards(memory.rate, min(max(requested, -outward), inward), acceleration, period)
    return _moved(memory, memory.depth + rate * period, rate, law, lag, period)


def _presses(memory: ContactMemory, config: ContactConfig) -> bool:
    """Whether the skin is felt at this moment: where it is not, the tip must not come at it
    faster than at first.
    """
    return memory.last > 0.5 * _threshold(memory, config) and touches(memory, config)


def _threshold(memory: ContactMemory, config: ContactConfig) -> float:
    """Force that counts as contact with this sensor [N]."""
    return max(config.contact_force, CONTACT_SIGMA * memory.noise)


def _moved(
    memory: ContactMemory, depth: float, rate: float, law: object, lag: float, period: float
) -> ContactMemory:
    """The state after a period that ends with a commanded depth [m]."""
    servo = memory.servo.after(depth, lag, period)
    return replace(memory, depth=depth, rate=rate, servo=servo, law=law)
