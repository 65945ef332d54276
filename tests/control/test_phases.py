"""The state machine by itself: what leads from phase to phase."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from breastscan.control import phases
from breastscan.control.phases import PathSection, Phase, PhaseConfig, Progress, Situation
from breastscan.errors import RobotError, SafetyError

CONFIG = PhaseConfig()
PERIOD = 0.002
SECTION = PathSection(1000)
SKIN_NEAR = Situation(depth=0.0, rate=0.0, force=0.0, touching=False)
AIR = Situation(depth=-0.03, rate=0.0, force=0.0, touching=False)
SKIN = Situation(depth=0.005, rate=0.0, force=5.0, touching=True)


def step(progress, now, section=SECTION):
    return phases.step(progress, now, section, 5.0, CONFIG, PERIOD)


@pytest.mark.parametrize(
    ("phase", "now", "row", "leads_to"),
    [
        (Phase.TRAVEL, AIR, 0.0, Phase.APPROACH),
        (Phase.APPROACH, AIR, 0.0, Phase.APPROACH),
        (Phase.APPROACH, SKIN, 0.0, Phase.SETTLE),
        (Phase.LOOP, SKIN, 500.0, Phase.LOOP),
        (Phase.LOOP, SKIN, 1000.0, Phase.LIFT),
        (Phase.LOOP, AIR, 500.0, Phase.SEARCH),
        (Phase.SEARCH, SKIN, 500.0, Phase.SETTLE),
        (Phase.HALT, SKIN, 500.0, Phase.LIFT),
        (Phase.RETREAT, AIR, 500.0, Phase.PAUSE),
        (Phase.RETREAT, AIR, 1000.0, Phase.DONE),
        (Phase.PAUSE, AIR, 500.0, Phase.APPROACH),
        (Phase.ESCAPE, AIR, 500.0, Phase.DONE),
        (Phase.DONE, AIR, 500.0, Phase.DONE),
    ],
)
def test_each_phase_leads_where_it_should(phase, now, row, leads_to):
    progress, command = step(Progress(phase, row=row), now)
    assert progress.phase is leads_to
    assert command.fault is None


@pytest.mark.parametrize("phase", [Phase.APPROACH, Phase.SETTLE, Phase.LOOP])
def test_a_pause_leads_off_the_skin_from_every_phase_on_it(phase):
    now = SKIN if phase is not Phase.APPROACH else AIR
    progress = Progress(phase, row=500.0, feed_override=float(phase is Phase.LOOP))
    seen = []
    for _ in range(2000):
        lifted = progress.phase in (Phase.RETREAT, Phase.PAUSE)
        now = Situation(
            -0.03 if lifted else now.depth, 0.0, now.force, now.touching and not lifted, pause=True
        )
        progress, _ = step(progress, now)
        seen.append(progress.phase)
    assert seen[-1] is Phase.PAUSE
    assert progress.feed_override == 0.0
    assert 500.0 <= progress.row <= 500.0 + 0.5 * CONFIG.override_time / PERIOD + 1


@pytest.mark.parametrize(
    ("phase", "now", "error"),
    [
        (Phase.TRAVEL, SKIN, SafetyError),
        (Phase.APPROACH, Situation(-0.013, 0.0, 1.0, True), SafetyError),
        (Phase.APPROACH, Situation(0.013, 0.0, 0.0, False), RobotError),
        (Phase.SEARCH, Situation(0.006, 0.0, 0.0, False), RobotError),
    ],
)
def test_what_must_not_be_is_told(phase, now, error):
    assert isinstance(step(Progress(phase), now)[1].fault, error)


@given(phase=st.sampled_from(list(Phase)))
def test_every_phase_leads_to_the_escape_which_stops_the_path_within_a_tenth_of_a_second(phase):
    progress = phases.escape(Progress(phase, row=500.0, feed_override=1.0), SKIN.depth)
    if phase is Phase.DONE:
        assert progress.phase is Phase.DONE
        return
    for _ in range(round(CONFIG.escape_override_time / PERIOD) + 1):
        progress, command = step(progress, SKIN)
        assert command.speed == -CONFIG.escape_speed
    assert progress.feed_override == 0.0
    assert progress.row < 500.0 + CONFIG.escape_override_time / PERIOD


@pytest.mark.parametrize(("entry", "ends_at"), [(0.005, -0.03), (-0.010, -0.04)])
def test_a_retreat_goes_as_far_from_where_the_skin_was_as_from_where_it_was_planned(entry, ends_at):
    for depth, speed in ((ends_at + 1e-4, -CONFIG.escape_speed), (ends_at - 1e-4, 0.0)):
        now = Situation(depth, -0.1, 0.0, False)
        assert step(phases.escape(Progress(Phase.LOOP), entry), now)[1].speed == speed


def test_the_feed_override_rises_over_its_time_and_the_row_with_it():
    progress = Progress(Phase.LOOP)
    rows = []
    for _ in range(500):
        progress, _ = step(progress, SKIN)
        rows.append(progress.row)
    assert progress.feed_override == 1.0
    assert rows[-1] == pytest.approx(500 - 0.5 * CONFIG.override_time / PERIOD, abs=1)


@pytest.mark.parametrize("start", [300, 301])
def test_the_way_through_the_air_ends_at_the_row_where_the_scan_starts(start):
    progress, section = Progress(Phase.TRAVEL), PathSection(1000, start)
    for _ in range(3000):
        progress, _ = step(progress, AIR, section)
        if progress.phase is not Phase.TRAVEL:
            break
    assert progress.phase is Phase.APPROACH
    assert progress.row == pytest.approx(start, abs=1.0)


@given(clock=st.floats(0, 1), end=st.floats(0, 10))
def test_a_ramp_stays_between_its_ends_and_its_change_is_its_derivative(clock, end):
    now, later = phases.ramp(clock, 0.5, end, 0.35), phases.ramp(clock + 1e-6, 0.5, end, 0.35)
    assert min(0.5, end) - 1e-12 <= now.force <= max(0.5, end) + 1e-12
    assert (later.force - now.force) / 1e-6 == pytest.approx(now.change, abs=1e-3)


def test_the_ramp_is_over_before_the_path_begins():
    settled = Progress(Phase.SETTLE, clock=CONFIG.settle_time - PERIOD, entry=0.5)
    assert step(settled, SKIN)[1].reference.force == 5.0


def test_a_contact_that_is_lost_again_and_again_ends_the_scan():
    progress, lost = Progress(Phase.LOOP, row=500.0), 0
    while lost <= CONFIG.losses:
        progress, command = step(progress, AIR)
        if command.fault is not None:
            break
        lost += 1
        assert progress.phase is Phase.SEARCH
        progress, _ = step(progress, SKIN)
        for _ in range(round(CONFIG.settle_time / PERIOD) + 2):
            progress, _ = step(progress, SKIN)
        assert progress.phase is Phase.LOOP
    assert lost == CONFIG.losses
    assert isinstance(command.fault, RobotError)
    assert "lost 6 times" in str(command.fault)


def test_lost_contact_is_searched_for_no_faster_than_the_skin_was_approached():
    config = PhaseConfig(approach_speed=0.003)
    _, command = phases.step(Progress(Phase.SEARCH), SKIN_NEAR, SECTION, 5.0, config, PERIOD)
    assert command.speed == 0.003
