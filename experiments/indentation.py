"""How far is the soft phantom's response from full finite elements with large deformations, and
where does that end?
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import KDTree

from experiments.full_tissue import FullTissue
from sim.tissue.contact import Mechanics
from sim.tissue.phantom import Phantom
from sim.tissue.soft import SoftTissue

DEPTHS = np.arange(1, 9) * 1e-3
"""Indentations [m]; the full finite elements find their equilibrium in no larger steps."""
FINEST = 0.003
"""Longest edge of the full finite elements under the probe [m]."""
SET_POINT = 5.0
"""Force at which the deformed surfaces are compared [N]."""
UNDER = (0.028, 0.006)
"""Half lengths of the probe's face along and across the array, edges left out [m]."""
REST = np.zeros(3)
CANDIDATES = 12
"""Facets among which the closest one is looked for."""


@dataclass(frozen=True, kw_only=True)
class Indentation:
    """One place pressed deeper and deeper, square to the skin."""

    full: Float[np.ndarray, "n"]
    """Axial force at `DEPTHS` by full finite elements [N]."""
    soft: Float[np.ndarray, "n"]
    """The same by the soft phantom [N]."""
    surface_rmse: float
    """Distance of the skin by full finite elements from the soft phantom's, under the probe at
    `SET_POINT` [m]."""
    displacement_rmse: float
    """Distance of its points from the soft phantom's same points, there [m]."""

    @property
    def error(self) -> Float[np.ndarray, "n"]:
        """Relative error of the soft phantom's force."""
        return self.soft / self.full - 1


def pose(
    phantom: Phantom, azimuth: float, depth: float, height: float = 0.5, roll: float = 0.0
) -> np.ndarray:
    """X_SP of a probe square on the skin, its face `depth` [m] below it.

    Args:
        phantom: What is touched.
        azimuth: Where on the contour [rad].
        depth: [m]
        height: Of the contour over the breast's [-].
        roll: About the probe's axis; 0 has the array along the contour, pi/2 across it [rad].
    """
    loop_S = phantom.level_loop(height * phantom.height, 1440)
    angles = 2 * np.pi * np.arange(len(loop_S)) / len(loop_S)
    p_S = np.array([np.interp(azimuth, angles, column, period=2 * np.pi) for column in loop_S.T])
    inward_S = -phantom.normal(phantom.inverse_map(p_S[None]))[0]
    along_S = np.cross([0.0, 0.0, 1.0], inward_S)
    along_S /= np.linalg.norm(along_S)
    across_S = np.cross(inward_S, along_S)
    X_SP = np.eye(4)
    X_SP[:3, 0] = np.cos(roll) * along_S + np.sin(roll) * across_S
    X_SP[:3, 1] = np.cross(inward_S, X_SP[:3, 0])
    X_SP[:3, 2], X_SP[:3, 3] = inward_S, p_S + depth * inward_S
    return X_SP


def axial_force(mechanics: Mechanics, X_SP: Float[np.ndarray, "4 4"]) -> float:
    """Force with which a resting probe presses along its axis [N]."""
    return -float(mechanics.press(X_SP, REST).force_S @ X_SP[:3, 2])


def against_full(
    phantom: Phantom, soft: SoftTissue, azimuth: float, depths: Float[np.ndarray, "n"]
) -> Indentation:
    """Press one place of the half-height loop by both; takes minutes."""
    reference = FullTissue(phantom, pose(phantom, azimuth, 0.0), FINEST)
    full, surface = [], (np.nan, np.nan)
    for depth in depths:
        X_SP = pose(phantom, azimuth, depth)
        full.append(-float(reference.press(X_SP) @ X_SP[:3, 2]))
        if full[-1] > SET_POINT > (full[-2] if len(full) > 1 else 0.0):
            at = float(np.interp(SET_POINT, full, depths[: len(full)]))
            X_SP, deep_S = pose(phantom, azimuth, at), reference.displacement_S
            reference.press(X_SP)
            surface = _surfaces(phantom, soft, reference, X_SP)
            # from the shallower place the next step would be too large
            reference.displacement_S = deep_S
    forces = [axial_force(soft, pose(phantom, azimuth, depth)) for depth in depths]
    return Indentation(
        full=np.array(full),
        soft=np.array(forces),
        surface_rmse=surface[0],
        displacement_rmse=surface[1],
    )


def _surfaces(
    phantom: Phantom, soft: SoftTissue, reference: FullTissue, X_SP: Float[np.ndarray, "4 4"]
) -> tuple[float, float]:
    """RMS distances [m] under the probe: of the reference's skin from the soft skin, and of the
    same points.
    """
    before_S, now_S, areas = reference.skin(X_SP)
    under = (np.abs((now_S - X_SP[:3, 3]) @ X_SP[:3, :2]) < UNDER).all(axis=1)
    before_S = before_S[under]
    now_S = now_S[under]
    areas = areas[under]
    soft.press(X_SP, REST)
    deformed_S, skin = soft.deformed_skin(), phantom.skin
    triangles, weights, _ = _closest(skin.vertices_S[skin.triangles], before_S)
    same_S = np.einsum("nk,nkc->nc", weights, deformed_S[skin.triangles[triangles]])
    _, _, away = _closest(deformed_S[skin.triangles], now_S)
    squared = np.linalg.norm(now_S - same_S, axis=1) ** 2
    return float(np.sqrt(np.average(away**2, weights=areas))), float(
        np.sqrt(np.average(squared, weights=areas))
    )


def _closest(
    corners_S: Float[np.ndarray, "m 3 3"], p_S: Float[np.ndarray, "n 3"]
) -> tuple[np.ndarray, np.ndarray, Float[np.ndarray, "n"]]:
    """The triangle closest to each point, barycentric coordinates there, and its distance [m]."""
    near = np.asarray(KDTree(corners_S.mean(axis=1)).query(p_S, CANDIDATES)[1])
    closest_S = trimesh.triangles.closest_point(
        corners_S[near.ravel()], np.repeat(p_S, CANDIDATES, axis=0)
    )
    away = np.linalg.norm(closest_S.reshape(-1, CANDIDATES, 3) - p_S[:, None], axis=2)
    best = np.arange(len(p_S)) * CANDIDATES + away.argmin(axis=1)
    triangles = near.ravel()[best]
    return (
        triangles,
        trimesh.triangles.points_to_barycentric(corners_S[triangles], closest_S[best]),
        away.min(axis=1),
    )
