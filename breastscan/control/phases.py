"""The phases of a scan as a state machine: what the probe does next, and why.

    travel -> approach -> settle -> loop -> lift -> retreat -> done
    loop -> search -> settle                                where contact was lost
    loop -> halt -> lift -> retreat -> pause -> approach    where a pause is requested
    any -> escape -> done                                   where something is wrong

Pure functions: (progress, situation) -> (progress, command). The place on the path is a row of the
plan, with a fraction; the feed override is the fraction of the planned speed at which it moves on,
so that a halted scan goes on where it stood.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from breastscan.control.force_law import Reference
from breastscan.errors import BreastScanError, RobotError, SafetyError


class Phase(StrEnum):
    """What the probe is doing; the names stand in the log."""

    TRAVEL = "travel"
    """Along the path in the air, to where the scan starts."""
    APPROACH = "approach"
    """Straight down the normal, until the skin is felt."""
    SETTLE = "settle"
    """At rest on the skin, until the force is there."""
    LOOP = "loop"
    """Along the path, in contact."""
    SEARCH = "search"
    """Contact was lost: slowly down the normal."""
    HALT = "halt"
    """Coming to rest on the path, in contact."""
    LIFT = "lift"
    """At rest, the force sinking."""
    RETREAT = "retreat"
    """Off the skin, up the normal."""
    PAUSE = "pause"
    """Clear of the skin, waiting to go on."""
    ESCAPE = "emergency retreat"
    """Off the skin, fast, whatever the sensor says."""
    DONE = "done"


PRESSING = frozenset({Phase.SETTLE, Phase.LOOP, Phase.HALT, Phase.LIFT})
"""Phases under force control."""


@dataclass(frozen=True, kw_only=True)
class PhaseConfig:
    """How the probe comes to the skin and leaves it."""

    approach_speed: float = 0.015
    """Speed towards the skin until contact [m/s]; on a rigid phantom .003."""
    window: float = 0.012
    """How far before and beyond the planned skin the approach may meet it [m]."""
    ramp_time: float = 0.35
    """Time over which the set-point rises from first contact to its full value, and sinks at the
    end [s]."""
    settle_time: float = 1.0
    """Time from first contact to the start of the path [s]."""
    override_time: float = 0.5
    """Time in which the feed override goes from 0 to 1, and back [s]."""
    search_speed: float = 0.01
    """Speed down the normal after contact was lost [m/s]; never above the approach's."""
    search_depth: float = 0.005
    """How deep that search goes [m]."""
    losses: int = 5
    """How often contact may be lost in one scan."""
    retreat_speed: float = 0.03
    """Speed away from the skin at the end [m/s]."""
    escape_speed: float = 0.10
    """The same after a fault [m/s]: faster than a person flinches towards the probe."""
    escape_acceleration: float = 2.5
    """Acceleration of that [m/s^2]: the speed is there after 40 ms, once the servo follows."""
    escape_override_time: float = 0.1
    """Time in which the feed override goes to 0 then [s]."""


@dataclass(frozen=True)
class PathSection:
    """The section of the plan that is to be followed."""

    last: int
    """Last row of the plan."""
    start: int = 0
    """Row at which contact is made."""
    in_air: bool = False
    """Whether to travel the whole path clear of the skin, without contact."""
    clearance: float = 0.03
    """How far from the planned skin that is [m]."""


@dataclass(frozen=True)
class Situation:
    """What the machine decides on."""

    depth: float
    """Of the tip beyond the planned skin, as commanded [m]."""
    rate: float
    """Speed of that [m/s]."""
    force: float
    """Low-passed contact force [N]."""
    touching: bool
    """Whether that is contact."""
    pause: bool = False
    """Whether a pause is requested."""


@dataclass(frozen=True)
class Progress:
    """Where the scan stands."""

    phase: Phase
    clock: float = 0.0
    """Time in this phase [s]."""
    row: float = 0.0
    """Place on the path, in rows of the plan."""
    feed_override: float = 0.0
    """Fraction of the planned speed at which the path is followed, 0 to 1."""
    entry: float = 0.0
    """What the phase has to remember from its beginning: the force [N], or the depth [m]."""
    lost: int = 0
    """How often contact was lost so far."""


@dataclass(frozen=True)
class PhaseCommand:
    """What a phase commands in this period: a speed along the probe axis, or a force to hold."""

    speed: float = 0.0
    """[m/s], where no force is held."""
    reference: Reference | None = None
    contact_made: bool = False
    """Whether contact is made in this period."""
    contact_lost: bool = False
    """Whether it is lost, or ended."""
    fault: BreastScanError | None = None
    """Why the scan must end."""


Step = tuple[Progress, PhaseCommand]


def step(
    progress: Progress,
    now: Situation,
    section: PathSection,
    force: float,
    config: PhaseConfig,
    period: float,
) -> Step:
    """One period [s] later.

    Args:
        progress: Where the scan stands.
        now: What was sensed.
        section: The section of the plan that is followed.
        force: Set-point [N].
        config: Speeds and times.
        period: Control period [s].

    Returns:
        The new progress, and the command of this period. A fault in it sends the
        caller to `escape`.
    """
    after, command = _STEPS[progress.phase](progress, now, section, force, config)
    feed_override = _feed_override(after, section, config, period)
    row = min(after.row + feed_override, float(section.last))
    return Progress(
        after.phase, after.clock + period, row, feed_override, after.entry, after.lost
    ), command


def escape(progress: Progress, felt: float) -> Progress:
    """The escape from any phase; the skin was `felt` at that depth [m], 0 where it was not."""
    return (
        progress
        if progress.phase in (Phase.ESCAPE, Phase.DONE)
        else _enter(progress, Phase.ESCAPE, felt)
    )


def ramp(clock: float, start: float, end: float, duration: float) -> Reference:
    """A force [N] on its smooth transition from `start` to `end`, and its change, `clock` [s] after
    it began.
    """
    fraction = min(clock / duration, 1.0)
    span = end - start
    return Reference(
        start + span * fraction**2 * (3.0 - 2.0 * fraction),
        span * 6.0 * fraction * (1.0 - fraction) / duration,
    )


def _enter(progress: Progress, phase: Phase, entry: float = 0.0) -> Progress:
    return replace(progress, phase=phase, clock=0.0, entry=entry)


def _feed_override(
    progress: Progress, section: PathSection, config: PhaseConfig, period: float
) -> float:
    """The feed override one period on: up where the path is to be followed, else down."""
    escaping = progress.phase is Phase.ESCAPE
    change = period / (config.escape_override_time if escaping else config.override_time)
    if progress.phase is Phase.TRAVEL:
        braking_rows = 0.5 * progress.feed_override**2 / change
        wanted = 1.0 if progress.row + braking_rows < _travel_end(section) else 0.0
    else:
        wanted = 1.0 if progress.phase is Phase.LOOP else 0.0
    return min(max(wanted, progress.feed_override - change), progress.feed_override + change)


def _travel_end(section: PathSection) -> int:
    return section.last if section.in_air else section.start


def _travel(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if now.touching:
        why = "something was touched in the air: is the space around the path clear?"
        return progress, PhaseCommand(fault=SafetyError(why, now.force))
    if progress.feed_override == 0.0 and progress.row >= _travel_end(section) - 1.0:
        return _enter(progress, Phase.RETREAT if section.in_air else Phase.APPROACH), PhaseCommand()
    return progress, PhaseCommand()


def _approach(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if now.pause:
        return _enter(progress, Phase.RETREAT), PhaseCommand()
    if now.touching and now.depth < -config.window:
        why = (
            f"the skin was met {-now.depth * 1e3:.0f} mm before where it was planned, expected "
            f"within {config.window * 1e3:.0f} mm: has the phantom moved since the pictures were "
            "taken?"
        )
        return progress, PhaseCommand(fault=SafetyError(why, now.depth))
    if now.touching:
        return _enter(progress, Phase.SETTLE, now.force), PhaseCommand(
            reference=Reference(now.force), contact_made=True
        )
    if now.depth > config.window:
        why = (
            f"no contact within {config.window * 1e3:.0f} mm beyond the planned skin: is the "
            "phantom where the cameras saw it, and is the sensor connected?"
        )
        return progress, PhaseCommand(fault=RobotError(why, now.depth))
    return progress, PhaseCommand(speed=config.approach_speed)


def _settle(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if now.pause:
        return _enter(progress, Phase.LIFT, now.force), PhaseCommand(reference=Reference(now.force))
    if not now.touching and progress.clock > config.ramp_time:
        return _lose(progress, now, config)
    if progress.clock >= config.settle_time:
        return _enter(progress, Phase.LOOP), PhaseCommand(reference=Reference(force))
    return progress, PhaseCommand(
        reference=ramp(progress.clock, progress.entry, force, config.ramp_time)
    )


def _loop(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if not now.touching:
        return _lose(progress, now, config)
    if progress.row >= section.last:
        return _enter(progress, Phase.LIFT, force), PhaseCommand(reference=Reference(force))
    if now.pause:
        return _enter(progress, Phase.HALT), PhaseCommand(reference=Reference(force))
    return progress, PhaseCommand(reference=Reference(force))


def _lose(progress: Progress, now: Situation, config: PhaseConfig) -> Step:
    """Search where contact was lost, unless that happens all the time."""
    if progress.lost >= config.losses:
        why = (
            f"contact was lost {progress.lost + 1} times: is the phantom much stiffer or softer "
            "than expected (surface.stiffness), or does it shake?"
        )
        return progress, PhaseCommand(fault=RobotError(why, progress.lost + 1))
    searching = replace(_enter(progress, Phase.SEARCH, now.depth), lost=progress.lost + 1)
    return searching, PhaseCommand(speed=_search_speed(config), contact_lost=True)


def _search_speed(config: PhaseConfig) -> float:
    return min(config.search_speed, config.approach_speed)


def _search(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if now.touching:
        return _enter(progress, Phase.SETTLE, now.force), PhaseCommand(
            reference=Reference(now.force), contact_made=True
        )
    if now.depth - progress.entry > config.search_depth:
        why = (
            f"contact was lost and not found again within {config.search_depth * 1e3:.0f} mm along "
            "the normal: does the plan leave the skin, or has the phantom moved?"
        )
        return progress, PhaseCommand(fault=RobotError(why, now.depth))
    return progress, PhaseCommand(speed=_search_speed(config))


def _halt(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if progress.feed_override == 0.0:
        return _enter(progress, Phase.LIFT, force), PhaseCommand(reference=Reference(force))
    return progress, PhaseCommand(reference=Reference(force))


def _lift(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if progress.clock >= config.ramp_time or not now.touching:
        return _enter(progress, Phase.RETREAT, now.depth), PhaseCommand(contact_lost=True)
    return progress, PhaseCommand(
        reference=ramp(progress.clock, progress.entry, 0.0, config.ramp_time)
    )


def _retreat(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if now.depth > _clear(progress, section):
        return progress, PhaseCommand(speed=-config.retreat_speed)
    if now.rate < 0.0:
        return progress, PhaseCommand()
    finished = section.in_air or progress.row >= section.last
    return _enter(progress, Phase.DONE if finished else Phase.PAUSE), PhaseCommand()


def _clear(progress: Progress, section: PathSection) -> float:
    """Depth at which a retreat ends [m]: as far from the planned skin as from where the skin was
    felt.
    """
    return min(progress.entry, 0.0) - section.clearance


def _pause(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    return (progress if now.pause else _enter(progress, Phase.APPROACH)), PhaseCommand()


def _escape(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    if now.depth > _clear(progress, section):
        return progress, PhaseCommand(speed=-config.escape_speed)
    at_rest = now.rate == 0.0 and progress.feed_override == 0.0
    return (_enter(progress, Phase.DONE) if at_rest else progress), PhaseCommand()


def _done(
    progress: Progress, now: Situation, section: PathSection, force: float, config: PhaseConfig
) -> Step:
    return progress, PhaseCommand()


_STEPS: dict[Phase, Callable[[Progress, Situation, PathSection, float, PhaseConfig], Step]] = {
    Phase.TRAVEL: _travel,
    Phase.APPROACH: _approach,
    Phase.SETTLE: _settle,
    Phase.LOOP: _loop,
    Phase.SEARCH: _search,
    Phase.HALT: _halt,
    Phase.LIFT: _lift,
    Phase.RETREAT: _retreat,
    Phase.PAUSE: _pause,
    Phase.ESCAPE: _escape,
    Phase.DONE: _done,
}
