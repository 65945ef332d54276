"""From the force error to a correction of the pose along the probe axis [Zhang, Sec. V-B.2, Fig.
23].

The correction is a rate, from one of `control.laws`, bounded, and summed to a depth;
`control.selection` joins it with the plan. Pure functions of (measurement, reference, memory) ->
memory: the twin and the robot run the same code.
"""

import math
from dataclasses import dataclass, field, replace

from breastscan.checks import require_positive
from breastscan.control.filters import Filtered
from breastscan.control.laws import LAWS, LawGains, LawMemory, LawName, Reference, Seen
from breastscan.control.phases import PhaseConfig
from breastscan.control.servo_model import ServoModel
from breastscan.control.surface import Surface, SurfaceConfig
from breastscan.control.tilt import TiltConfig
from breastscan.errors import ConfigError

CONTACT_HZ = 10.0
"""Corner of the low-pass on the force that decides whether there is contact [Hz]."""
CONTACT_SIGMA = 3.0
"""Noise below this many times itself is no contact: five times the filtered noise of a sensor of 50
Hz."""
HASTE = 4.0
"""Largest speed into the skin, where it is felt, over the approach's [-]: by default that is
`rate_limit`. A body that is approached slowly because it is hard is pressed slowly too, whatever a
law believes."""
NOISE_TIME = 0.5
"""Time over which the sensor's noise is taken, in the air [s]."""


@dataclass(frozen=True, kw_only=True)
class ContactConfig:
    """How the probe keeps its force on the skin."""

    law: LawName = "observer"
    """What turns the force error into a speed of the tip; `docs/control.md` compares them."""
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
    gains: LawGains = field(default_factory=LawGains)

    def __post_init__(self) -> None:
        require_positive(self, "contact")
        if self.law not in LAWS:
            raise ConfigError(
                f"contact.law must be one of {', '.join(LAWS)}, got {self.law!r}", self.law
            )
        if self.contact_force >= self.force:
            raise ConfigError(
                f"contact.contact_force ({self.contact_force} N) must be below the set-point "
                f"({self.force} N)",
                self.force,
            )


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
    """Of the sensor's noise, seen in the air [N^2]."""
    surface: Surface | None
    """What is believed about the skin; None before it was met."""
    stiffness: float
    """The stiffest that it was found to be, in contacts that ended [N^(2/3)/m]: what threw the
    probe off once would do so again."""
    law: LawMemory

    @staticmethod
    def resting(depth: float, period: float) -> "ContactMemory":
        """At rest in the air, `depth` [m] from the planned skin."""
        servo = ServoModel.resting(depth, period)
        return ContactMemory(
            depth, 0.0, servo, Filtered(), 0.0, 0.0, None, 0.0, LawMemory(Filtered())
        )

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

    In the air the sensor's noise is learnt, from the differences of samples, in which a slow touch
    does not show; from the first contact on, the skin.
    """
    slow = memory.slow.after(force, CONTACT_HZ, period)
    variance = memory.variance
    surface = memory.surface
    if surface is None:
        variance += (0.5 * (force - memory.last) ** 2 - variance) * period / NOISE_TIME
    else:
        surface = surface.after(memory.servo.position, force, memory.noise, config.surface, period)
    return replace(memory, slow=slow, last=force, variance=variance, surface=surface)


def meet(memory: ContactMemory, config: ContactConfig) -> ContactMemory:
    """Begin a contact: the skin is where the tip feels it."""
    force = memory.slow.force
    stiffness = max(memory.stiffness, config.surface.stiffness)
    surface = Surface.met(memory.servo.position, force, stiffness, config.surface)
    return replace(memory, surface=surface, law=LawMemory(Filtered(force)))


def leave(memory: ContactMemory) -> ContactMemory:
    """End a contact: where the skin was believed to be is forgotten, not how stiff it is."""
    assert memory.surface is not None, "a contact ends after `meet`"
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
    step = acceleration * period
    rate = min(max(speed, memory.rate - step), memory.rate + step)
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
        The state after this period; its depth stays inside `config.depth_limit`.
    """
    assert memory.surface is not None, "force control begins with `meet`"
    seen = Seen(memory.last, memory.depth, memory.rate, memory.surface, lag, period)
    asked, law = LAWS[config.law](seen, reference, memory.law, config.gains.of(config.law))
    step, limit = config.acceleration * period, config.rate_limit
    approach = config.phases.approach_speed
    inward = min(HASTE * approach if _presses(memory, config) else approach, limit)
    rate = max(min(max(asked, -limit), memory.rate + step, inward), memory.rate - step)
    depth = memory.depth + rate * period
    if abs(depth) > config.depth_limit:
        depth, rate = math.copysign(config.depth_limit, depth), 0.0
    return _moved(memory, depth, rate, law, lag, period)


def _presses(memory: ContactMemory, config: ContactConfig) -> bool:
    """Whether the skin is felt at this moment: where it is not, the tip must not come at it
    faster than at first.
    """
    return memory.last > 0.5 * _threshold(memory, config) and touches(memory, config)


def _threshold(memory: ContactMemory, config: ContactConfig) -> float:
    """Force that counts as contact with this sensor [N]."""
    return max(config.contact_force, CONTACT_SIGMA * memory.noise)


def _moved(
    memory: ContactMemory, depth: float, rate: float, law: LawMemory, lag: float, period: float
) -> ContactMemory:
    """The state after a period that ends with a commanded depth [m]."""
    servo = memory.servo.after(depth, lag, period)
    return replace(memory, depth=depth, rate=rate, servo=servo, law=law)
