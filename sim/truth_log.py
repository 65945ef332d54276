"""What the simulation knows and no sensor tells: the true contact."""

from collections import deque
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from breastscan.run import parquet
from breastscan.run.columns import TRUTH
from sim.room.rigid_contacts import RigidContact, plain_name

NAME = "U32"
"""NumPy's type of a shape's name."""


@dataclass(frozen=True, kw_only=True)
class TruthLog:
    """One row a control period."""

    time: Float[np.ndarray, "n"]
    """Robot's clock [s]."""
    q: Float[np.ndarray, "n 6"]
    """Joint angles [rad]."""
    force_axial: Float[np.ndarray, "n"]
    """Force with which the probe presses along its axis [N]."""
    force_S: Float[np.ndarray, "n 3"]
    """Force of the tissue on the probe [N]."""
    depth: Float[np.ndarray, "n"]
    """Largest inward displacement of the skin [m]."""
    X_SP: Float[np.ndarray, "n 4 4"]
    """Pose of the probe tip in the phantom."""
    rise: Float[np.ndarray, "n"]
    """Height of the chest over the end of an exhalation [m]."""
    chest_S: Float[np.ndarray, "n 3"]
    """Force of the chest plate on arm and tool [N]."""
    rigid_force: Float[np.ndarray, "n"]
    """Force between a rigid shape and the arm's or tool's that presses it hardest [N]; 0 where none
    touches."""
    of_arm: Shaped[np.ndarray, "n"]
    """Name of the arm's or tool's shape of the two; empty where none touches."""
    of_other: Shaped[np.ndarray, "n"]
    """Name of the other."""

    @property
    def force_any(self) -> Float[np.ndarray, "n"]:
        """Force on the body in any direction, of the face on the breast and of arm and tool on the
        chest plate together [N].
        """
        return np.linalg.norm(self.force_S + self.chest_S, axis=1)

    @property
    def touched_else(self) -> str | None:
        """What else touched than the probe's face and the breast, how hard and when, as a sentence
        for the user; None if nothing did.

        Arm and tool meet the chest plate, the table and the cameras' stand. The breast gives way to
        all but the face: what reaches into it is not felt, and only in `clearance_body_min_mm`.
        """
        touching = np.flatnonzero(self.of_arm != "")
        if touching.size == 0:
            return None
        hardest = touching[self.rigid_force[touching].argmax()]
        same = (self.of_arm == self.of_arm[hardest]) & (self.of_other == self.of_other[hardest])
        first = self.time[np.flatnonzero(same)[0]]
        return (
            f"In the twin, {plain_name(str(self.of_arm[hardest]))} touched "
            f"{plain_name(str(self.of_other[hardest]))}, first at {first:.3f} s and hardest, with "
            f"{self.rigid_force[hardest]:.1f} N, at {self.time[hardest]:.3f} s of the robot's clock"
        )

    @staticmethod
    def load(path: Path) -> "TruthLog | None":
        """What `keep` left; None where that lacks a column, as an earlier version left it."""
        with np.load(path) as kept:
            found = dict(kept)
        whole = set(found) == {field.name for field in fields(TruthLog)}
        return TruthLog(**found) if whole else None

    def keep(self, path: Path) -> None:
        """Write every column to the last bit, as an `.npz` for `load`."""
        np.savez(path, **vars(self))

    def save(self, path: Path) -> None:
        """Write `truth.parquet` with the columns of docs/data.md."""
        parquet.write(path, TRUTH, vars(self))


class TruthRecorder:
    """Collects rows; nothing is computed until the log is asked for."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, np.ndarray, np.ndarray, float, np.ndarray, float]] = deque()
        self._rigid: deque[RigidContact] = deque()
        """Of the few periods in which anything rigid touched."""

    def recall(self, log: TruthLog) -> None:
        """Begin with the rows of an earlier run."""
        columns = (
            log.time.tolist(), log.q, log.force_S, log.depth.tolist(), log.X_SP, log.rise.tolist(),
        )  # fmt: skip
        self._rows.extend(zip(*columns, strict=True))
        for row in np.flatnonzero(log.of_arm != ""):
            names = str(log.of_arm[row]), str(log.of_other[row])
            force = float(log.rigid_force[row])
            self._rigid.append(RigidContact(float(log.time[row]), log.chest_S[row], force, *names))

    def limit(self, rows: int) -> None:
        """Keep the latest so many."""
        self._rows = deque(self._rows, maxlen=rows)
        self._rigid = deque(self._rigid, maxlen=rows)

    def add(
        self,
        time: float,
        q: Float[np.ndarray, "6"],
        force_S: Float[np.ndarray, "3"],
        depth: float,
        X_SP: Float[np.ndarray, "4 4"],
        rise: float,
    ) -> None:
        """Append one period. The arrays are kept, not copied."""
        self._rows.append((time, q, force_S, depth, X_SP, rise))

    def add_rigid(self, contact: RigidContact) -> None:
        """Say of the latest period that something rigid touched."""
        self._rigid.append(contact)

    def log(self) -> TruthLog:
        """All rows so far as arrays."""
        time, q, force_S, depth, X_SP, rise = (
            np.array(column, float) for column in zip(*self._rows, strict=True)
        )
        rigid = [contact for contact in self._rigid if contact.time >= time[0]]
        rows = np.searchsorted(time, [contact.time for contact in rigid])

        def spread(empty: np.ndarray, values: list) -> np.ndarray:
            """A column that is empty but where something rigid touched."""
            column = np.repeat(empty[None], len(time), axis=0)
            column[rows] = np.array(values, empty.dtype).reshape(-1, *empty.shape)
            return column

        return TruthLog(
            time=time,
            q=q,
            force_axial=-np.einsum("ni,ni->n", force_S, X_SP[:, :3, 2]),
            force_S=force_S,
            depth=depth,
            X_SP=X_SP,
            rise=rise,
            chest_S=spread(np.zeros(3), [contact.chest_S for contact in rigid]),
            rigid_force=spread(np.zeros(()), [contact.force for contact in rigid]),
            of_arm=spread(np.array("", NAME), [contact.of_arm for contact in rigid]),
            of_other=spread(np.array("", NAME), [contact.of_other for contact in rigid]),
        )
