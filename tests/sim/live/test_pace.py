import pytest

from sim.live.pace import BEHIND, Pace


class Clock:
    """A wall clock that passes while somebody sleeps or works."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now

    def sleep(self, duration):
        self.now += duration


@pytest.mark.parametrize("speed", [0.1, 1.0, 4.0])
def test_simulated_time_passes_at_the_set_multiple_of_the_clocks(speed):
    clock = Clock()
    pace = Pace(clock, clock.sleep)
    pace.speed = speed
    for period in range(1001):
        pace.keep(period * 0.002)
    assert clock.now - 100.0 == pytest.approx(2.0 / speed, abs=0.005)


def test_a_slow_simulation_neither_waits_nor_races_after_the_clock():
    clock = Clock()
    pace = Pace(clock, clock.sleep)
    pace.keep(0.0)
    clock.now += 10 * BEHIND  # something took long
    pace.keep(0.002)
    started = clock.now
    for period in range(2, 502):
        pace.keep(period * 0.002)
    assert clock.now - started == pytest.approx(1.0, abs=0.005)


def test_a_change_of_speed_counts_from_now():
    clock = Clock()
    pace = Pace(clock, clock.sleep)
    for period in range(501):
        pace.keep(period * 0.002)
    pace.speed = 2.0
    for period in range(501, 1002):
        pace.keep(period * 0.002)
    assert clock.now - 100.0 == pytest.approx(1.5, abs=0.01)


def test_a_pause_is_not_made_up_for():
    clock = Clock()
    pace = Pace(clock, clock.sleep)
    pace.keep(0.0)
    clock.now += 60.0
    pace.restart()
    pace.keep(0.002)
    paused_until = clock.now
    pace.keep(0.502)
    assert clock.now - paused_until == pytest.approx(0.5, abs=0.005)
