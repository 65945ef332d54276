"""What the simulation knows and no sensor tells: the true contact."""

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from breastscan.run import parquet
from breastscan.run.columns import TRUTH


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

    def save(self, path: Path) -> None:
        """Write `truth.parquet` with the columns of docs/data.md."""
        parquet.write(path, TRUTH, vars(self))


class TruthRecorder:
    """Collects rows; nothing is computed until the log is asked for."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, np.ndarray, np.ndarray, float, np.ndarray]] = deque()

    def recall(self, log: TruthLog) -> None:
        """Begin with the rows of an earlier run."""
        columns = log.time.tolist(), log.q, log.force_S, log.depth.tolist(), log.X_SP
        self._rows.extend(zip(*columns, strict=True))

    def limit(self, rows: int) -> None:
        """Keep the latest so many."""
        self._rows = deque(self._rows, maxlen=rows)

    def add(
        self,
        time: float,
        q: Float[np.ndarray, "6"],
        force_S: Float[np.ndarray, "3"],
        depth: float,
        X_SP: Float[np.ndarray, "4 4"],
    ) -> None:
        """Append one period. The arrays are kept, not copied."""
        self._rows.append((time, q, force_S, depth, X_SP))

    def log(self) -> TruthLog:
        """All rows so far as arrays."""
        time, q, force_S, depth, X_SP = (
            np.array(column, float) for column in zip(*self._rows, strict=True)
        )
        return TruthLog(
            time=time,
            q=q,
            force_axial=-np.einsum("ni,ni->n", force_S, X_SP[:, :3, 2]),
            force_S=force_S,
            depth=depth,
            X_SP=X_SP,
        )
