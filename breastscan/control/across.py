"""The reference across the probe axis: it breathes along with the chest, and goes where pressing
has dragged the skin to.

The force holds the probe on the skin along its axis z, and nothing does across it. A chest that
rises by h along its outward normal n carries the skin by h n: along the axis by p = h (n . z),
which the force loop follows and so tells, and across it by

    h (n - (n . z) z),    h = p / (n . z).

p is where the tip is, less its indentation, for which `control.settle_fit` finds how soft the skin
is while the force rises.

What lies within the errors of a plan is not taken for breath: with R half the range of the rise so
far, the plan's own place among it, the share R^4 / (R^4 + e^4) of it is. The range begins anew once
the fit has told how soft the skin is: what the observer was off by before is no breath.
"""

from dataclasses import dataclass, field, replace

from breastscan.control.follower import Follower
from breastscan.control.phases import PRESSING, Phase
from breastscan.control.settle_fit import POWER, SettleFit
from breastscan.control.surface import SkinEstimate

RISE_HZ = 2.0
"""Corner of the low-pass on the rise [Hz]: eight times a calm breath's."""
DEPTH_HZ = 8.0
"""Of that on the indentation [Hz]: the tip goes along with the skin that it drags while the force
rises, and not after."""
ACCELERATION = 0.4
"""Bound of the rise's and the indentation's [m/s^2]: twice that of a breath of 5 mm at 1 Hz."""
BLEND_HZ = 1.3
"""Corner with which breathing along sets in at first contact and ends off the skin [Hz]: 99 % after
.8 s."""
PLAN_ERROR = 0.7e-3
"""Motion along the axis that errors of plan and indentation explain [m], e above."""
MIN_ALONG = 0.25
"""Least share of the chest's motion along the probe axis from which the rest is inferred [-]."""
MIN_FORCE = 0.4
"""Force below which it does not tell where the skin is [N]."""
HOLDING = frozenset({Phase.SEARCH, Phase.ESCAPE})
"""Phases in which the reference stays where it is: the skin was lost, or is left fast."""
ABSENT = 1e-6
"""Weight below which the breath's estimate may jump, since nothing shows of it [-]."""


@dataclass(frozen=True)
class Pressed:
    """What this period says about the skin."""

    phase: Phase
    position: float
    """Of the tip along the probe axis, from the planned skin [m]."""
    force: float
    """Measured, positive when pressing [N]."""
    surface: SkinEstimate | None
    """The estimate of the skin; None without contact."""
    along: float
    """n . z, of the chest's outward normal and the probe axis [-]; 0 where the chest is unknown."""
    lag: float
    """Of the servo [s]."""
    period: float
    """[s]"""


@dataclass(frozen=True)
class AcrossMemory:
    """What the reference across the axis carries from one period to the next."""

    estimate: Follower = field(default_factory=Follower)
    """The trusted share of the chest's rise along its normal since the pictures, once the servo
    has followed [m]."""
    low: float = 0.0
    """Lowest rise since the skin's softness is known [m]."""
    high: float = 0.0
    """Highest [m]."""
    weight: Follower = field(default_factory=Follower)
    """Share of that which is followed, 0 off the skin and 1 on it [-]."""
    depth: Follower = field(default_factory=Follower)
    """Indentation [m]."""
    fit: SettleFit | None = None
    """For the softness; None but on the first spot of a contact."""
    softness: float = 0.0
    """Of the skin, as it was found there: the indentation over f^m [m/N^m]."""
    skin_rate: float = 0.0
    """Speed of the chest along its normal in this period [m/s]."""

    @property
    def rise(self) -> float:
        """How far the reference goes along with the chest [m]."""
        return self.rise_before(0.0)

    def rise_before(self, lag: float) -> float:
        """The same as the servo has it by now, so much later [s]."""
        return self.weight.position * (self.estimate.position - lag * self.estimate.rate)

    @property
    def indentation(self) -> float:
        """Depth of the tip below the undeformed skin [m], 0 off it."""
        return max(self.depth.position, 0.0)


def update(now: Pressed, memory: AcrossMemory) -> AcrossMemory:
    """One period later."""
    if now.phase in HOLDING:
        return _held(memory, now.period)
    if now.phase not in PRESSING:
        return _ended(memory, now.period)
    if now.surface is None or now.force < MIN_FORCE:
        return _coasting(memory, memory.weight, memory.depth.position, now.period)
    return _following(now, now.surface, memory)


def _following(now: Pressed, surface: SkinEstimate, memory: AcrossMemory) -> AcrossMemory:
    """In contact."""
    root = now.force**POWER
    found = memory.fit is not None and now.phase is not Phase.SETTLE
    memory = _with_softness(now, root, surface.indentation(now.force) / root, memory)
    indentation = root * memory.softness
    depth = memory.depth.after(indentation, 0.0, DEPTH_HZ, now.period, ACCELERATION)
    if now.along == 0.0:
        return replace(memory, depth=depth)
    along = min(now.along, -MIN_ALONG)
    speed = surface.speed / along
    rise = (now.position - indentation) / along + now.lag * speed
    absent = memory.weight.position < ABSENT
    low, high = (0.0, 0.0) if absent or found else (memory.low, memory.high)
    low, high = min(low, rise), max(high, rise)
    trusted = _trusted(0.5 * (high - low))
    if absent:
        estimate = Follower(trusted * rise)
    else:
        estimate = memory.estimate.after(
            trusted * rise, trusted * speed, RISE_HZ, now.period, ACCELERATION
        )
    return AcrossMemory(
        estimate,
        low,
        high,
        memory.weight.after(1.0, 0.0, BLEND_HZ, now.period),
        depth,
        memory.fit,
        memory.softness,
        speed,
    )


def _trusted(half_range: float) -> float:
    """Share of a rise that is taken for breath, by half its range [m]."""
    return half_range**4 / (half_range**4 + PLAN_ERROR**4)


def _with_softness(
    now: Pressed, root: float, observed: float, memory: AcrossMemory
) -> AcrossMemory:
    """The softness is the observer's until that of the fit is there."""
    if now.phase is Phase.SETTLE:
        fit = memory.fit or SettleFit.beginning(now.position, root)
        fit = fit.after(now.position, root, now.period)
        return replace(memory, fit=fit, softness=observed)
    if memory.fit is not None:
        return replace(memory, fit=None, softness=memory.fit.softness(observed))
    return memory


def _held(memory: AcrossMemory, period: float) -> AcrossMemory:
    """Coming to rest where the reference is."""
    weight = memory.weight.after(memory.weight.position, 0.0, BLEND_HZ, period)
    return _coasting(memory, weight, memory.depth.position, period)


def _ended(memory: AcrossMemory, period: float) -> AcrossMemory:
    """Off the skin: back to the plan."""
    return _coasting(memory, memory.weight.after(0.0, 0.0, BLEND_HZ, period), 0.0, period)


def _coasting(
    memory: AcrossMemory, weight: Follower, indentation: float, period: float
) -> AcrossMemory:
    """Without knowing where the skin is."""
    estimate = memory.estimate.after(memory.estimate.position, 0.0, RISE_HZ, period, ACCELERATION)
    depth = memory.depth.after(indentation, 0.0, DEPTH_HZ, period, ACCELERATION)
    return replace(memory, estimate=estimate, weight=weight, depth=depth, fit=None, skin_rate=0.0)
