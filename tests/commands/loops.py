"""Random closed loops and clouds for `plan`, and whether an arm that follows them runs through
itself, its tool or the body: poses by MuJoCo, distances of points on each hull by closed forms.
"""

from functools import cached_property

import mujoco
import numpy as np
import trimesh

from breastscan.geometry import se3
from sim.arm.ur5e import joint_names
from sim.room.describe import ARM_BIT
from sim.scene import Scene, SceneConfig
from tests.cloud import clouds

POINTS = 1500
"""On each hull."""
ROWS = 25
"""Periods of 2 ms from one posture to the next."""
YIELDING = 0.03
"""Around the tip, skin is pushed away [m]."""
KINDS = {
    "CAPSULE": lambda s: trimesh.creation.capsule(2 * s[1], s[0]),
    "CYLINDER": lambda s: trimesh.creation.cylinder(s[0], 2 * s[1]),
    "BOX": lambda s: trimesh.creation.box(2 * s),
    "SPHERE": lambda s: trimesh.creation.icosphere(3, s[0]),
}


def path(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Twenty points of an ellipse around a bump that may lie anywhere and lean anyhow, and normals
    in between outwards and along its axis.
    """
    angle = 2 * np.pi * np.arange(20) / 20
    radii = rng.uniform(0.02, 0.09, 2)
    lean = rng.uniform(0.2, 1.2)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    normals = np.sin(lean) * ring + np.cos(lean) * np.array([0.0, 0.0, 1.0])
    X_BS = _pose(rng)
    return se3.transform(X_BS, ring * [*radii, 1.0]), se3.rotate(X_BS, normals)


def cloud(rng: np.random.Generator) -> clouds.Cloud:
    """A breast on a flat or a bent chest that may lie anywhere and lean anyhow."""
    chest = clouds.flat if rng.uniform() < 0.5 else clouds.cylinder(rng.uniform(0.2, 0.6))
    return clouds.cloud(chest, _pose(rng), seed=int(rng.integers(1000)))


def _pose(rng: np.random.Generator) -> np.ndarray:
    reach, side = rng.uniform(0.25, 0.8), rng.uniform(-np.pi, np.pi)
    at = reach * np.cos(side), reach * np.sin(side), rng.uniform(-0.1, 0.5)
    return clouds.tilted(rng.uniform(0, np.radians(60)), rng.uniform(-np.pi, np.pi), at)


class Arm:
    """The twin's arm and tool as points on their hulls."""

    @cached_property
    def _model(self) -> mujoco.MjModel:
        return Scene(SceneConfig()).physics

    @cached_property
    def _hulls(self) -> dict[int, tuple[int, np.ndarray]]:
        """Of each: the link that it moves with, 6 with what the flange carries, and its points."""
        hulls = {}
        for geom in np.flatnonzero(self._model.geom_contype == ARM_BIT).tolist():
            body = self._model.body(self._model.geom_bodyid[geom]).name
            link = int(body.removeprefix("link")) if "link" in body else 7
            mesh = KINDS[self._kind(geom)](self._model.geom_size[geom])
            hulls[geom] = link, trimesh.sample.sample_surface_even(mesh, POINTS, seed=0)[0]
        return hulls

    def gaps(self, q: np.ndarray, skin_B: np.ndarray, tip_B: np.ndarray) -> tuple[float, ...]:
        """The least gaps [m] of the arm to itself, of the tool to the arm, of the arm to skin, and
        of the tool to skin that the tip does not push away, negative where they overlap.
        """
        data = mujoco.MjData(self._model)
        data.qpos[[self._model.joint(name).qposadr[0] for name in joint_names()]] = q
        mujoco.mj_kinematics(self._model, data)
        base = self._model.body("base").id
        X_WB = se3.pose(data.xmat[base].reshape(3, 3), data.xpos[base])
        X_BW = se3.inverse(X_WB)
        placed = {
            geom: (link, X_BW @ se3.pose(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]))
            for geom, (link, _) in self._hulls.items()
        }
        still_B = skin_B[np.linalg.norm(skin_B - tip_B, axis=1) > YIELDING]
        least = {"arm": 1.0, "tool": 1.0, "body": 1.0, "tool to body": 1.0}
        for a, (of_a, X_BA) in placed.items():
            is_tool = of_a == 7
            if of_a > 1:
                skin = still_B if is_tool else skin_B
                what = "tool to body" if is_tool else "body"
                least[what] = min(least[what], self._gap(a, X_BA, skin))
            for b, (of_b, X_BB) in placed.items():
                if min(of_b, 6) - min(of_a, 6) > 1:
                    of = "tool" if of_b == 7 else "arm"
                    p_A, p_B = (
                        se3.transform(X, self._hulls[k][1]) for k, X in ((a, X_BA), (b, X_BB))
                    )
                    gap = min(self._gap(a, X_BA, p_B), self._gap(b, X_BB, p_A))
                    least[of] = min(least[of], gap)
        return tuple(least.values())

    def _kind(self, geom: int) -> str:
        return mujoco.mjtGeom(self._model.geom_type[geom]).name.removeprefix("mjGEOM_")

    def _gap(self, geom: int, X_BH: np.ndarray, p_B: np.ndarray) -> float:
        """The least signed distance of points in B from a hull [m]."""
        if not len(p_B):
            return 1.0
        p = se3.transform(se3.inverse(X_BH), p_B)
        kind, size = self._kind(geom), self._model.geom_size[geom]
        if kind == "SPHERE":
            return float(np.linalg.norm(p, axis=1).min() - size[0])
        if kind == "CAPSULE":
            p[:, 2] -= np.clip(p[:, 2], -size[1], size[1])
            return float(np.linalg.norm(p, axis=1).min() - size[0])
        off = np.abs(p) - size
        if kind == "CYLINDER":
            off = np.stack(
                [np.hypot(p[:, 0], p[:, 1]) - size[0], np.abs(p[:, 2]) - size[1]], axis=1
            )
        outside = np.linalg.norm(np.maximum(off, 0.0), axis=1)
        return float((outside + np.minimum(off.max(axis=1), 0.0)).min())


def postures(planned) -> np.ndarray:
    """Joint angles along a motion and on its way down to the skin [rad]."""
    down = np.linspace(planned.q_approach, planned.q[0], 4)
    return np.concatenate([down, planned.q[::ROWS], planned.q[-1:]])
