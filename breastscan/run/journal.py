"""The log of a scan on disk while it runs: what ends the program, a SIGKILL or the power, does not
take the log along.

A thread of its own writes what is new and waits for the disk; the control cycle only appends to its
list. Records are of one size, so that one which was cut off in the middle is known.
"""

import os
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from breastscan.run.trajectory import Sample

INTERVAL = 0.25
"""Between two writes [s]: so much of a log is lost at most. To pack it takes .15 ms, the only time
for which the control cycle may have to wait."""
RECORD = np.dtype(
    [
        ("time", "<f8"),
        ("phase", "S20"),
        ("row", "<f8"),
        ("q", "<f8", 6),
        ("qd", "<f8", 6),
        ("target", "<f8", 6),
        ("wrench_P", "<f8", 6),
        ("contact", "?"),
        ("shift_B", "<f8", 3),
    ]
)
"""One `Sample` in the file, without padding."""
_PACKED = struct.Struct("<d20sd24d?3d")
"""The same, faster for one at a time."""


@contextmanager
def written(path: Path, log: list[Sample]) -> Iterator[None]:
    """Append to a file what comes into the log inside the block; what the log already holds is
    there, or comes from there.

    A disk that takes no more ends the writing, and nothing else: the log itself stays.
    """
    with path.open("ab") as stream:
        stream.truncate(len(log) * RECORD.itemsize)
        ended = threading.Event()
        thread = threading.Thread(
            target=_follow, args=(stream, log, len(log), ended), name="journal", daemon=True
        )
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def read(path: Path) -> list[Sample]:
    """The samples in a file that `written` wrote; one that was cut off is left out."""
    content = path.read_bytes()
    records = np.frombuffer(content, RECORD, count=len(content) // RECORD.itemsize)
    return [
        Sample(
            time=float(record["time"]),
            phase=record["phase"].decode(),
            row=float(record["row"]),
            q=record["q"].copy(),
            qd=record["qd"].copy(),
            target=record["target"].copy(),
            wrench_P=record["wrench_P"].copy(),
            contact=bool(record["contact"]),
            shift_B=record["shift_B"].copy(),
        )
        for record in records
    ]


def _follow(stream: BinaryIO, log: list[Sample], written_rows: int, ended: threading.Event) -> None:
    """Write until the end, and then what is left."""
    last = False
    while not last:
        last = ended.wait(INTERVAL)
        new = log[written_rows:]
        if not new:
            continue
        try:
            stream.write(b"".join(map(_pack, new)))
            stream.flush()
            os.fsync(stream.fileno())
        except OSError:
            return
        written_rows += len(new)


def _pack(sample: Sample) -> bytes:
    return _PACKED.pack(
        sample.time,
        sample.phase.encode(),
        sample.row,
        *sample.q.tolist(),
        *sample.qd.tolist(),
        *sample.target.tolist(),
        *sample.wrench_P.tolist(),
        sample.contact,
        *sample.shift_B.tolist(),
    )
