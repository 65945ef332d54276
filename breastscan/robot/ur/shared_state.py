"""The controller's latest state, in memory that the worker writes and its parent reads, without a
lock.

A version number stands odd while the worker writes; a reader that saw it odd, or changed, reads
again. Waiting is done elsewhere, on a socket: a parent that is busy for seconds must still find the
newest state here.
"""

from dataclasses import dataclass
from multiprocessing.context import SpawnContext

import numpy as np
from jaxtyping import Float

from breastscan.robot.ur.faults import Fault

LAYOUT = np.dtype(
    [
        ("version", "i8"),
        ("time", "f8"),
        ("q", "f8", 6),
        ("qd", "f8", 6),
        ("force_B", "f8", 6),
        ("sample", "i8"),
        ("acknowledged", "i8"),
        ("fault", "i8"),
        ("failed", "f8"),
        ("seen", "f8"),
    ]
)
"""Of the memory; the names are those of `ControllerState`."""


@dataclass(frozen=True)
class ControllerState:
    """One sample, as the controller gave it."""

    time: float
    """Controller's clock [s]."""
    q: Float[np.ndarray, "6"]
    """Joint angles [rad]."""
    qd: Float[np.ndarray, "6"]
    """Joint speeds [rad/s]."""
    force_B: Float[np.ndarray, "6"]
    """`actual_TCP_force`: on the probe, about its tip, in the axes of B, force first [N, N m]."""
    sample: int
    """Count of the sensor's samples."""
    acknowledged: int
    """Sequence number of the latest target that was sent before this state came."""
    fault: Fault
    """Why commands are no longer taken."""
    failed: float
    """Controller's clock when that was seen [s]; the latest state's without a fault."""
    seen: float
    """Monotonic clock when the controller was last there [s]: told a state, or may wait for the
    answer to it."""


class SharedState:
    """The memory; it travels to a spawned process as an argument."""

    def __init__(self, context: SpawnContext) -> None:
        """Allocate it, all zero."""
        self._memory = context.RawArray("b", LAYOUT.itemsize)

    def _record(self) -> np.ndarray:
        return np.frombuffer(self._memory, LAYOUT)  # type: ignore[call-overload]

    def write(self, state: ControllerState) -> None:
        """Replace the state."""
        record = self._record()
        record["version"] += 1
        for name in LAYOUT.names[1:]:  # type: ignore[index]
            record[name] = getattr(state, name)
        record["version"] += 1

    def note_seen(self, seen: float) -> None:
        """The controller is there [s], without a new state."""
        self._record()["seen"] = seen

    def read(self) -> ControllerState:
        """A copy of the state, whole."""
        record = self._record()
        while True:
            before = int(record["version"][0])
            copy = record.copy()[0]
            if before % 2 == 0 and int(record["version"][0]) == before:
                break
        return ControllerState(
            float(copy["time"]),
            copy["q"].copy(),
            copy["qd"].copy(),
            copy["force_B"].copy(),
            int(copy["sample"]),
            int(copy["acknowledged"]),
            Fault(int(copy["fault"])),
            float(copy["failed"]),
            float(copy["seen"]),
        )
