"""The numbers of the two cameras, found again [Zhang, Sec. II-A, Tables 1, 2].

The twin's cameras are the paper's: both tables are the truth that the calibration is to find again.
"""

from collections.abc import Iterator

import numpy as np

from breastscan.geometry import se3
from breastscan.vision.camera import Intrinsics
from experiments.paper.calibration import Calibrated
from experiments.paper.item import Item, column, judged
from sim.rig_errors import rig_errors

INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Of a camera, in OpenCV's order."""
SAME = 1e-3
"""Relative error of a length up to which it counts as found again."""


def items(day: Calibrated) -> Iterator[Item]:
    """What the calibrated rig answers."""
    yield _intrinsics(day)
    yield _extrinsics(day)


def _intrinsics(day: Calibrated) -> Item:
    rows = [
        (side, name, true, found)
        for side in ("left", "right")
        for name, true, found in zip(
            INTRINSICS,
            _parameters(getattr(day.truth, side)),
            _parameters(getattr(day.result.rig, side)),
            strict=True,
        )
    ]
    sides, names, paper, ours = (np.array(values) for values in zip(*rows, strict=True))
    error = np.abs(ours - paper)
    focal, centre = (
        float(error[np.isin(names, which)].max()) for which in (("fx", "fy"), ("cx", "cy"))
    )
    return Item(
        heading="Table 1",
        ours=f"found again from rendered shots: focal lengths to {focal:.2f} px "
        f"({100 * focal / 684:.3f} %), principal points to {centre:.2f} px",
        verdict=judged(focal < SAME * paper[np.isin(names, ("fx", "fy"))].min(), "agrees"),
        why="the twin's cameras were built with Table 1; the calibration gives it back. How true "
        "the table is of the paper's own cameras nobody can say.",
        data={
            column("camera", "which camera", kind="text"): sides,
            column("parameter", "OpenCV's name", kind="text"): names,
            column("paper", "Table 1, read as OpenCV needs it", "px or 1"): paper,
            column("ours", "calibrated", "px or 1"): ours,
        },
    )


def _parameters(camera: Intrinsics) -> list[float]:
    K = camera.K
    return [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion]


def _extrinsics(day: Calibrated) -> Item:
    rig, truth = day.result.rig, day.truth
    angle_deg = np.degrees(np.linalg.norm(se3.rotation_vector(rig.X_RL @ se3.inverse(truth.X_RL))))
    moved_mm = 1e3 * (rig.X_RL[:3, 3] - truth.X_RL[:3, 3])
    errors = rig_errors(rig, truth)
    names = [f"R{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)] + ["Tx", "Ty", "Tz"]

    def values(X: np.ndarray) -> np.ndarray:
        return np.concatenate([X[:3, :3].T.ravel(), 1e3 * X[:3, 3]])  # as Table 2 prints them

    return Item(
        heading="Table 2",
        ours=f"found again to {angle_deg:.4f}° and ({', '.join(f'{v:+.3f}' for v in moved_mm)}) "
        f"mm; baseline {1e3 * rig.baseline:.3f} mm, off by {errors['baseline_error_mm']:.3f} mm; "
        f"yaw off by {errors['yaw_error_deg']:.4f}°",
        verdict=judged(abs(rig.baseline / truth.baseline - 1.0) < SAME, "agrees"),
        why="the twin's rig was built with Table 2; the calibration gives it back.",
        data={
            column("entry", "as Table 2 prints it", kind="text"): np.array(names),
            column("paper", "Table 2 with the nearest rotation", "1 or mm"): values(truth.X_RL),
            column("ours", "calibrated", "1 or mm"): values(rig.X_RL),
        },
    )
