# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""How near all of arm and tool but the probe's face comes to the body: to the breast's skin and to
the chest.

Arm and tool are the hulls that physics and planning know: capsules around the links, a cylinder
around the sensor, a box around the probe from 10 mm behind its face on. The signed distance of each
has a closed form, so the skin's mesh is held against the hulls as it is, however it is shaped;
`mj_geomDistance` takes convex shapes, and errs where they lie deep in each other.
"""

import math
from typing import no_type_check

import mujoco
import numba
import numpy as np
import trimesh
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.hulls import BOX, CAPSULE, CYLINDER, placed_distance, signed_distance
from sim.arm.ur5e import joint_names
from sim.room.chest import chest_block, chest_distance
from sim.room.describe import ARM_BIT
from sim.scene import Scene

KIND_OF_GEOM = {
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): CAPSULE,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): CYLINDER,
    int(mujoco.mjtGeom.mjGEOM_BOX): BOX,
}
"""The kinds of hulls of `geometry.hulls` by MuJoCo's numbers."""
RUN = 16
"""Vertices of the skin that follow one another, and lie together, are passed over together."""
STRETCH = 0.006
"""How much farther a vertex of pressed skin may lie from its neighbours than of unpressed, or from
the middle of the breast [m]."""
SLACK = 1e-3
"""How much nearer a point of a triangle may lie than its vertices [m]."""
PARTS = 8
"""The edges of the triangles where the skin is nearest are divided into so many: .2 mm."""
AXIS_POINTS = 65
"""Points along a capsule's axis that are held against the chest. Over its top the nearest
is always among these, and among those of a box; of a cylinder's rims one is within .2 mm."""
RIM_POINTS = 32
"""Points around each rim of a cylinder that are."""
BOX_POINTS = 5
"""Points along each edge of a box that are, and as many layers between."""


class BodyGap:
    """The smallest gap of all the poses that were added."""

    def __init__(self, scene: Scene) -> None:
        """Collect the hulls; `scene` says where arm and phantom stand."""
        model = self._model = scene.physics
        self._data = mujoco.MjData(model)
        self._joints = [model.joint(name).qposadr[0] for name in joint_names()]
        # the probe first: what is near already spares a look at the others
        self._hulls = np.flatnonzero(model.geom_contype == ARM_BIT)[::-1]
        kinds = [KIND_OF_GEOM[kind] for kind in model.geom_type[self._hulls].tolist()]
        self._kinds, self._sizes = np.array(kinds), model.geom_size[self._hulls]
        self._X_BS = scene.X_BS
        skin, centre_S = scene.phantom.skin, np.array([0.0, 0.0, scene.phantom.height / 2])
        faces = trimesh.Trimesh(skin.vertices_S, skin.triangles, process=False).vertex_faces
        self._skin = np.ascontiguousarray(skin.triangles), np.ascontiguousarray(faces)
        self._runs = _run_radii(skin.vertices_S) + STRETCH
        radius = float(np.linalg.norm(skin.vertices_S - centre_S, axis=1).max())
        self._ball = centre_S, radius + STRETCH
        self._points = _points(self._kinds, self._sizes)
        half, depth = chest_block(scene.X_BS, scene.phantom.curvature)
        self._chest = scene.phantom.curvature, np.append(half, depth / 2)
        self.smallest = math.inf
        """[m]; negative where they lie in each other: how deep the skin lies in a hull, or a hull
        in the chest."""

    def add(self, q: Float[np.ndarray, "6"], rise: float, skin_S: Float[np.ndarray, "n 3"]) -> None:
        """See whether anything is nearer in this pose.

        Args:
            q: Joint angles [rad].
            rise: Height of the chest over the end of an exhalation [m].
            skin_S: Vertices of the fine skin mesh as they now lie [m].
        """
        data, R_BS = self._data, self._X_BS[:3, :3]
        data.qpos[self._joints] = q
        mujoco.mj_kinematics(self._model, data)
        p_SH = (data.geom_xpos[self._hulls] - self._X_BS[:3, 3]) @ R_BS - [0.0, 0.0, rise]
        X_SH = se3.pose(R_BS.T @ data.geom_xmat[self._hulls].reshape(-1, 3, 3), p_SH)
        smallest = _to_chest(X_SH, *self._points, *self._chest, self.smallest)
        self.smallest = _to_skin(
            self._kinds, self._sizes, X_SH, skin_S, *self._skin, self._runs, *self._ball,
            smallest,
        )  # fmt: skip


def _run_radii(skin_S: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "r"]:
    """For each run of vertices, the farthest from the one in its middle [m]."""
    starts = range(0, len(skin_S), RUN)
    runs = [skin_S[start : start + RUN] for start in starts]
    return np.array([np.linalg.norm(run - run[len(run) // 2], axis=1).max() for run in runs])


def _points(
    kinds: np.ndarray, sizes: Float[np.ndarray, "h 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the hulls in their own frames [m], around each a radius [m], and the hull's row."""
    points, radii = [], []
    for kind, size in zip(kinds, sizes, strict=True):
        if kind == BOX:
            edge = np.linspace(-1.0, 1.0, BOX_POINTS)
            points.append(np.stack(np.meshgrid(edge, edge, edge), axis=-1).reshape(-1, 3) * size)
        elif kind == CYLINDER:
            angle = np.linspace(0.0, 2 * np.pi, 2 * RIM_POINTS, endpoint=False)
            ends = np.resize([-1.0, -1.0, 1.0, 1.0], 2 * RIM_POINTS)
            points.append(np.stack([np.cos(angle), np.sin(angle), ends], axis=1) * size[[0, 0, 1]])
        else:
            axis = np.linspace(-size[1], size[1], AXIS_POINTS)
            points.append(np.outer(axis, [0.0, 0.0, 1.0]))
        radii.append(0.0 if kind in (BOX, CYLINDER) else size[0])
    counts = [len(found) for found in points]
    return np.vstack(points), np.repeat(radii, counts), np.repeat(np.arange(len(kinds)), counts)


@numba.njit(cache=True)
@no_type_check
def _to_chest(X_SH, points, radii, rows, curvature, half, smallest):
    """The smaller of a gap and the smallest between the hulls' points and the chest [m]."""
    for k in range(len(points)):
        X = X_SH[rows[k]]
        a, b, c = points[k]
        x = X[0, 0] * a + X[0, 1] * b + X[0, 2] * c + X[0, 3]
        y = X[1, 0] * a + X[1, 1] * b + X[1, 2] * c + X[1, 3]
        z = X[2, 0] * a + X[2, 1] * b + X[2, 2] * c + X[2, 3]
        if curvature == 0:
            distance = signed_distance(BOX, half, x, y, z + half[2])
        else:
            distance = chest_distance(curvature, half, x, y, z)
        smallest = min(smallest, distance - radii[k])
    return smallest


@numba.njit(cache=True)
@no_type_check
def _to_skin(kinds, sizes, X_SH, skin_S, triangles, faces_around, runs, centre_S, radius, smallest):
    """The smaller of a gap and the smallest between hulls and skin [m]."""
    x, y, z = centre_S
    for h in range(len(kinds)):
        kind, size = kinds[h], sizes[h]
        X = X_SH[h]
        if placed_distance(kind, size, X, x, y, z) - radius < smallest:
            nearest = _nearest_vertex(kind, size, X, skin_S, runs, smallest + SLACK)
            for face in faces_around[nearest]:
                if face >= 0 and nearest >= 0:
                    gap = _to_triangle(kind, size, X, skin_S, triangles[face])
                    smallest = min(smallest, gap)
    return smallest


@numba.njit(cache=True)
@no_type_check
def _nearest_vertex(kind, size, X, skin_S, runs, gap):
    """The vertex nearest to a hull; -1 if none is nearer than a gap [m]."""
    nearest = -1
    for run in range(len(runs)):
        start, end = run * RUN, min((run + 1) * RUN, len(skin_S))
        k = start + (end - start) // 2
        middle = placed_distance(kind, size, X, skin_S[k, 0], skin_S[k, 1], skin_S[k, 2])
        if middle - runs[run] < gap:
            for i in range(start, end):
                # as numbers: handing the array on would take three times as long
                x = skin_S[i, 0]
                y = skin_S[i, 1]
                z = skin_S[i, 2]
                distance = placed_distance(kind, size, X, x, y, z)
                if distance < gap:
                    nearest, gap = i, distance
    return nearest


@numba.njit(cache=True)
@no_type_check
def _to_triangle(kind, size, X, skin_S, corners):
    """Gap between a hull and a triangle of the skin [m]."""
    gap, (a, b, c) = np.inf, corners
    for i in range(PARTS + 1):
        for j in range(PARTS + 1 - i):
            u, v = i / PARTS, j / PARTS
            w = 1.0 - u - v
            x = w * skin_S[a, 0] + u * skin_S[b, 0] + v * skin_S[c, 0]
            y = w * skin_S[a, 1] + u * skin_S[b, 1] + v * skin_S[c, 1]
            z = w * skin_S[a, 2] + u * skin_S[b, 2] + v * skin_S[c, 2]
            gap = min(gap, placed_distance(kind, size, X, x, y, z))
    return gap
