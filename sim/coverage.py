"""What an examination has touched and looked through, against the true skin and tissue.

Skin counts as touched where the loaded patch of the probe has been, tissue as seen where a beam of
an element that was in contact has passed.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from breastscan.geometry import se3
from breastscan.geometry.compiled import kernel
from breastscan.planning.examination import Coverage
from breastscan.run.skin_map import SkinMap
from sim.tissue.phantom import Phantom
from sim.tissue.soft import SoftTissue
from sim.wrist.probe_face import ProbeFace

GRID = 0.003
"""Spacing of the tissue's points [m]."""
DEPTH = 0.040
"""Of the tissue under the skin that is to be seen [m]."""
MM2_PER_M2 = 1e6


@dataclass
class Touched:
    """Collects the presses of an examination."""

    phantom: Phantom
    tissue: SoftTissue
    ends: Float[np.ndarray, "strokes"]
    """Length along the plan at which each stroke ends [m]."""
    _by: Bool[np.ndarray, "strokes n"] = field(init=False)
    _seen: Bool[np.ndarray, "g"] = field(init=False)

    def __post_init__(self) -> None:
        self._by = np.zeros((len(self.ends), len(self.tissue.skin_points_S)), bool)
        self._grid_S = _inside(self.phantom)
        self._seen = np.zeros(len(self._grid_S), bool)
        self._face = ProbeFace()

    def add(self, s: float, X_SP: Float[np.ndarray, "4 4"]) -> None:
        """Note what the tissue's last press touches, at a length along the plan [m]."""
        touched = self.tissue.touched
        if not len(touched):
            return
        self._by[np.searchsorted(self.ends, s), touched] = True
        points_P = se3.transform(se3.inverse(X_SP), self.tissue.patch().points_S)
        angles = np.arctan2(points_P[:, 0], points_P[:, 2] + self._face.radius)
        _look(
            np.ascontiguousarray(X_SP), self._grid_S, self._face.radius, self._face.elevation / 2,
            angles.min(), angles.max(), self._seen,
        )  # fmt: skip

    def metrics(
        self, coverage: Coverage, X_BS: Float[np.ndarray, "4 4"]
    ) -> dict[str, float | dict[str, float]]:
        """Shares of the skin between the margins that were touched, once and by two strokes, and of
        the tissue under it that was seen [%]; and the skin that was not touched, by reason [mm^2].

        Args:
            coverage: What was planned.
            X_BS: Pose of the phantom when it was seen.
        """
        points_S, areas = self.tissue.skin_points_S, self.tissue.skin_areas
        target = self._target(coverage)
        times = self._by.sum(axis=0)
        _, nearest = KDTree(points_S).query(self._grid_S)
        deep = np.linalg.norm(points_S[nearest] - self._grid_S, axis=1) <= DEPTH
        under = deep & target[nearest]
        gap = target & (times == 0)
        reasons = coverage.why_not(se3.transform(X_BS, points_S[gap]))
        return {
            "coverage_skin_pct": _share(areas, times > 0, target),
            "coverage_twice_pct": _share(areas, times > 1, target),
            "coverage_volume_pct": 100.0 * float(self._seen[under].mean()),
            "coverage_gap_mm2": {
                reason: float(areas[gap][reasons == reason].sum() * MM2_PER_M2)
                for reason in np.unique(reasons).tolist()
            },
        }

    def skin_map(self, coverage: Coverage, X_BS: Float[np.ndarray, "4 4"]) -> SkinMap:
        """By how many strokes each point of the skin was touched; arguments as for `metrics`."""
        return SkinMap(
            points_B=se3.transform(X_BS, self.tissue.skin_points_S),
            strokes=self._by.sum(axis=0),
            wanted=self._target(coverage),
        )

    def _target(self, coverage: Coverage) -> Bool[np.ndarray, "n"]:
        points_S = self.tissue.skin_points_S
        tip_S = self.phantom.embed(np.array([[0.0, 0.0, 1.0]]))[0]
        from_tip = np.linalg.norm(points_S - tip_S, axis=1)
        return (from_tip > coverage.config.nipple_margin) & (
            self.phantom.heights(points_S) > coverage.config.base_margin
        )


def _share(areas: np.ndarray, part: np.ndarray, whole: np.ndarray) -> float:
    return 100.0 * float(areas[whole & part].sum() / areas[whole].sum())


def _inside(phantom: Phantom) -> Float[np.ndarray, "g 3"]:
    """Points of the breast, even in space [m]."""
    reach = np.abs(phantom.skin.vertices_S).max(axis=0)
    axes = [np.arange(-r, r, GRID) for r in reach[:2]] + [np.arange(GRID / 2, reach[2], GRID)]
    grid_S = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.ascontiguousarray(grid_S[phantom.level(grid_S) < 0])


@kernel
def _look(X_SP, grid_S, radius, half_thickness, first, last, seen):
    """Mark the points that beams between two angles pass, as thick as the face is wide, of a convex
    array that is bent about a centre behind its face.
    """
    for i in range(len(grid_S)):
        if seen[i]:
            continue
        x = y = 0.0
        z = radius
        for axis in range(3):
            away = grid_S[i, axis] - X_SP[axis, 3]
            x += X_SP[axis, 0] * away
            y += X_SP[axis, 1] * away
            z += X_SP[axis, 2] * away
        if abs(y) > half_thickness or z <= 0.0 or x * x + z * z > (radius + DEPTH) ** 2:
            continue
        angle = np.arctan2(x, z)
        seen[i] = first <= angle <= last
