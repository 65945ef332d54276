"""What the simulation knows exactly: the undeformed skin, and where each of its points lies now.

"Now" is the tissue's last press. To know an earlier instant, press the tissue again with that row's
`TruthLog.X_SP`.
"""

from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from breastscan.geometry import se3
from breastscan.vision.camera import Intrinsics
from sim.cameras.lens import pixel_rays
from sim.cameras.mesh_rays import first_hits
from sim.tissue.contact import Mechanics
from sim.tissue.hemisphere import sphere_axes
from sim.tissue.phantom import Phantom

LOOP_POINTS = 4000
"""Points of the true half-height loop: .1 mm apart."""
CLOSEST_STEPS = 100
CLOSEST_TOLERANCE = 1e-10
"""Step that ends the search for the closest point [m]."""
SHARPEST_RADIUS = 0.015
"""Smallest radius of curvature of the skin, on the nipple [m]: it keeps the search from
overshooting far outside."""
RAY_STEP = 0.003
"""Spacing at which a ray searches for the skin [m]: it may miss what is within .02 mm of the
silhouette."""
BISECTIONS = 30
AXIS_TOLERANCE = 1e-6
"""A probe's axis that comes no nearer to the skin than this misses it [m]."""
LONGEST_STEP = 0.1
"""Longest step of the search along a probe's axis, on the unit hemisphere [-]."""
OCCLUSION = 1e-3
"""A point this much farther than the first skin on its ray is hidden [m]."""


class Truth:
    """Ground truth of one phantom and its tissue; all points in S."""

    def __init__(self, phantom: Phantom, tissue: Mechanics) -> None:
        self._phantom = phantom
        self._tissue = tissue
        skin = phantom.skin
        self._skin_direction = phantom.inverse_map(skin.vertices_S)
        self._skin_tree = KDTree(skin.vertices_S)
        self._faces_around = trimesh.Trimesh(
            skin.vertices_S, skin.triangles, process=False
        ).vertex_faces

    def distance(self, p_S: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distance to the undeformed skin [m], positive outside."""
        points_S, normals_S = self.closest(p_S)
        away_S = p_S - points_S
        side = np.where(np.einsum("nc,nc->n", away_S, normals_S) < 0, -1.0, 1.0)
        return side * np.linalg.norm(away_S, axis=1)

    def closest(
        self, p_S: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Closest points of the smooth undeformed skin [m], and its outward unit normals there."""
        direction = self._skin_direction[self._skin_tree.query(p_S)[1]]
        for _ in range(CLOSEST_STEPS):
            direction, step = self._towards(p_S, direction)
            if step < CLOSEST_TOLERANCE:
                break
        return self._phantom.embed(direction), self._phantom.normal(direction)

    @cached_property
    def ball(self) -> tuple[Float[np.ndarray, "3"], float]:
        """Centre and radius of a ball that holds the undeformed skin [m]."""
        centre_S = np.array([0.0, 0.0, self._phantom.height / 2])
        apart = np.linalg.norm(self._phantom.skin.vertices_S - centre_S, axis=1)
        return centre_S, float(apart.max())

    def pressed_place(
        self, X_SP: Float[np.ndarray, "n 4 4"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Where the axes of probes' tips meet the undeformed skin [m], and its outward unit normals
        there; of an axis that misses the breast, those closest to the tip.
        """
        p_S, across_S = X_SP[:, :3, 3], X_SP[:, :3, :2]
        direction = self._skin_direction[self._skin_tree.query(p_S)[1]]
        for _ in range(CLOSEST_STEPS):
            direction, step = self._onto_axis(p_S, across_S, direction)
            if step < CLOSEST_TOLERANCE:
                break
        points_S, normals_S = self._phantom.embed(direction), self._phantom.normal(direction)
        off_axis = np.einsum("nc,nck->nk", points_S - p_S, across_S)
        missed = ~(np.linalg.norm(off_axis, axis=1) < AXIS_TOLERANCE)
        points_S[missed], normals_S[missed] = self.closest(p_S[missed])
        return points_S, normals_S

    def material_point(
        self, p_S: Float[np.ndarray, "n 3"], deformed_S: Float[np.ndarray, "v 3"] | None = None
    ) -> Float[np.ndarray, "n 3"]:
        """Where on the undeformed skin that point lies which is now, deformed, the closest one
        to `p_S` [m]; `deformed_S` is the tissue's deformed skin, where it is at hand.
        """
        deformed_S = self._tissue.deformed_skin() if deformed_S is None else deformed_S
        skin = self._phantom.skin
        nearest = cdist(p_S, deformed_S).argmin(axis=1)
        around = self._faces_around[nearest]
        triangles = skin.triangles[around]
        corners_S = deformed_S[triangles].reshape(-1, 3, 3)
        closest_S = trimesh.triangles.closest_point(
            corners_S, np.repeat(p_S, around.shape[1], axis=0)
        )
        distances = np.linalg.norm(closest_S.reshape(*around.shape, 3) - p_S[:, None], axis=2)
        best = np.where(around >= 0, distances, np.inf).argmin(axis=1)
        chosen = np.arange(len(p_S)) * around.shape[1] + best
        weights = trimesh.triangles.points_to_barycentric(corners_S[chosen], closest_S[chosen])
        undeformed_S = skin.vertices_S[triangles.reshape(-1, 3)[chosen]]
        return np.einsum("nk,nkc->nc", weights, undeformed_S)

    def level_loop(self, height_fraction: float = 0.5) -> Float[np.ndarray, "n 3"]:
        """Dense contour of the undeformed skin at a fraction of its height [m]; it closes without
        repeating its first point.
        """
        return self._phantom.level_loop(self._phantom.height * height_fraction, LOOP_POINTS)

    def cast(
        self, origin_S: Float[np.ndarray, "3"], direction_S: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """First point of the undeformed skin on each ray from an origin outside the breast [m],
        NaN where it misses.
        """
        unit_S = direction_S / np.linalg.norm(direction_S, axis=1, keepdims=True)
        inside = self._first_inside(origin_S, unit_S, *self._span(origin_S, unit_S))
        hit = np.isfinite(inside)
        points_S = np.full(direction_S.shape, np.nan)
        points_S[hit] = self._bisected(origin_S, unit_S[hit], inside[hit])
        return points_S

    def normals(self) -> Float[np.ndarray, "n 3"]:
        """Outward unit normals of the skin as it lies now, at the vertices of `Phantom.skin`."""
        corners_S = self._tissue.deformed_skin()[self._phantom.skin.triangles]
        facing_S = np.cross(corners_S[:, 1] - corners_S[:, 0], corners_S[:, 2] - corners_S[:, 0])
        normals_S = np.zeros_like(self._phantom.skin.vertices_S)
        for corner in self._phantom.skin.triangles.T:
            np.add.at(normals_S, corner, facing_S)
        return normals_S / np.linalg.norm(normals_S, axis=1, keepdims=True)

    def seen(
        self, X_SC: Float[np.ndarray, "4 4"], rays_C: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
        """What a camera's rays see of the skin as it lies now: depth along its z [m] and normal in
        S, NaN where none.

        The skin is taken as its fine mesh, within .01 mm of the smooth surface and .04 mm on the
        nipple; nothing else stands in the way.

        Args:
            X_SC: The camera, OpenCV's axes, outside the breast.
            rays_C: Directions with z = 1.
        """
        vertices_C = se3.transform(se3.inverse(X_SC), self._tissue.deformed_skin())
        triangles = self._phantom.skin.triangles
        depth, hit, weights = first_hits(vertices_C[triangles], np.ascontiguousarray(rays_C))
        normals_S = np.einsum("nk,nkc->nc", weights, self.normals()[triangles[hit]])
        normals_S[hit < 0] = np.nan
        return depth, normals_S / np.linalg.norm(normals_S, axis=1, keepdims=True)

    def depth_map(
        self, camera: Intrinsics, X_SC: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "h w"]:
        """Depth along its z [m] of the skin that each pixel of a distorted camera sees now, NaN
        where none.
        """
        return self.seen(X_SC, pixel_rays(camera))[0].reshape(camera.height, camera.width)

    def visible(
        self, p_S: Float[np.ndarray, "n 3"], centre_S: Float[np.ndarray, "3"]
    ) -> Bool[np.ndarray, "n"]:
        """Whether points of the undeformed skin are seen from `centre_S`, not hidden by the
        breast itself.
        """
        first_S = self.cast(centre_S, p_S - centre_S)
        hidden_by = np.linalg.norm(p_S - centre_S, axis=1) - np.linalg.norm(
            first_S - centre_S, axis=1
        )
        return ~(hidden_by > OCCLUSION)

    def _towards(
        self, p_S: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], float]:
        """One Gauss-Newton step to the closest point, shortened outside as curvature asks; its
        longest length [m].
        """
        away_S = p_S - self._phantom.embed(direction)
        along_S, across_S = self._phantom.tangents(direction)
        jacobian = np.stack([along_S, across_S], axis=2)
        height = np.einsum("nc,nc->n", away_S, self._phantom.normal(direction))
        shortening = 1 / (1 + np.maximum(height, 0) / SHARPEST_RADIUS)
        gradient = np.einsum("nck,nc->nk", jacobian, away_S) * shortening[:, None]
        steps = np.linalg.solve(np.einsum("nck,ncl->nkl", jacobian, jacobian), gradient[:, :, None])
        return self._moved(direction, steps[:, :, 0])

    def _onto_axis(
        self,
        p_S: Float[np.ndarray, "n 3"],
        across_S: Float[np.ndarray, "n 3 2"],
        direction: Float[np.ndarray, "n 3"],
    ) -> tuple[Float[np.ndarray, "n 3"], float]:
        """One Newton step towards the lines through `p_S` that are square on two axes each; its
        longest length [m].
        """
        tangents_S = np.stack(self._phantom.tangents(direction), axis=2)
        jacobian = np.einsum("nck,ncl->nkl", across_S, tangents_S)
        off_axis = np.einsum("nck,nc->nk", across_S, p_S - self._phantom.embed(direction))
        steps = (np.linalg.pinv(jacobian) @ off_axis[:, :, None])[:, :, 0]
        length = np.linalg.norm(steps, axis=1, keepdims=True)
        return self._moved(
            direction, steps * np.minimum(1, LONGEST_STEP / np.maximum(length, 1e-9))
        )

    def _moved(
        self, direction: Float[np.ndarray, "n 3"], steps: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 3"], float]:
        """Directions moved along the two axes of each, not below the foot; the longest way [m]."""
        u, v = sphere_axes(direction)
        moved = direction + steps[:, :1] * u + steps[:, 1:] * v
        moved[:, 2] = np.maximum(moved[:, 2], 0.0)
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        return moved, self._phantom.radius * float(np.abs(moved - direction).max(initial=0.0))

    def _bisected(
        self,
        origin_S: Float[np.ndarray, "3"],
        unit_S: Float[np.ndarray, "n 3"],
        inside: Float[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n 3"]:
        """The skin within the last step of each ray, which is inside the breast at the length
        `inside` [m].
        """
        outside = inside - RAY_STEP
        for _ in range(BISECTIONS):
            midpoint = (inside + outside) / 2
            is_inside = self._phantom.level(origin_S + midpoint[:, None] * unit_S) < 0
            inside, outside = (
                np.where(is_inside, midpoint, inside),
                np.where(is_inside, outside, midpoint),
            )
        return origin_S + inside[:, None] * unit_S

    def _span(
        self, origin_S: Float[np.ndarray, "3"], unit_S: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Where each ray enters and leaves a ball around the breast, above the chest [m];
        nowhere if far < near.
        """
        centre_S, radius = self.ball
        to_centre = unit_S @ (centre_S - origin_S)
        discriminant = radius**2 - np.sum((centre_S - origin_S) ** 2) + to_centre**2
        half = np.sqrt(np.maximum(discriminant, 0.0))
        near = np.maximum(to_centre - half, 0.0)
        far = np.minimum(to_centre + half, self._to_chest(origin_S, unit_S))
        return near, np.where(discriminant > 0, far, -np.inf)

    def _to_chest(
        self, origin_S: Float[np.ndarray, "3"], unit_S: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n"]:
        """Where each ray from above the chest enters it [m], infinite where it never does."""
        _, y, z = origin_S
        bend = self._phantom.curvature
        falling = -unit_S[:, 2] - bend * y * unit_S[:, 1]
        over = z + bend * y**2 / 2
        discriminant = falling**2 - 2 * bend * unit_S[:, 1] ** 2 * over
        with np.errstate(divide="ignore"):
            along = 2 * over / (falling + np.sqrt(np.maximum(discriminant, 0.0)))
        return np.where((falling > 0) & (discriminant >= 0), along, np.inf)

    def _first_inside(
        self,
        origin_S: Float[np.ndarray, "3"],
        unit_S: Float[np.ndarray, "n 3"],
        near: Float[np.ndarray, "n"],
        far: Float[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n"]:
        """First distance along each ray at which it is inside the breast, in steps of `RAY_STEP`
        [m]; NaN if never.
        """
        inside = np.full(len(near), np.nan)
        searching = np.nonzero(far > near)[0]
        along = near[searching]
        while len(searching) > 0:
            p_S = origin_S + along[:, None] * unit_S[searching]
            found = self._phantom.level(p_S) < 0
            inside[searching[found]] = along[found]
            going_on = ~found & (along < far[searching])
            searching = searching[going_on]
            along = np.minimum(along[going_on] + RAY_STEP, far[searching])
        return inside
