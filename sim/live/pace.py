"""Simulated time kept to a multiple of the wall clock's."""

import time
from collections.abc import Callable

SLACK = 2e-3
"""Time ahead of the wall clock from which waiting pays [s]."""
BEHIND = 0.1
"""Time behind the wall clock that is not made up for [s]: what was slow stays late, nothing races
after it."""


class Pace:
    """Makes the simulation wait where it runs ahead of the pace that was set."""

    def __init__(
        self,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._speed = 1.0
        self._start: tuple[float, float] | None = None

    @property
    def speed(self) -> float:
        """Simulated over wall time [-]."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        if speed != self._speed:
            self._speed = speed
            self.restart()

    def restart(self) -> None:
        """Count from the next period on: the simulation stood still."""
        self._start = None

    def keep(self, simulated: float) -> None:
        """Wait until the wall clock has come to `simulated` [s], if it has not."""
        now = self._clock()
        if self._start is None:
            self._start = now, simulated
        start_wall, start_simulated = self._start
        ahead = (simulated - start_simulated) / self._speed - (now - start_wall)
        if ahead > SLACK:
            self._sleep(ahead)
        elif ahead < -BEHIND:
            self.restart()
