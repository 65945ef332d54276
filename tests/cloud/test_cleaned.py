"""Clouds and meshes of the kinds that people have: each ends in the half-height loop of the breast
that it was drawn from, or is refused with the cause.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay, KDTree
from scipy.spatial.transform import Rotation

from breastscan.cloud import skin_fit
from breastscan.cloud.cleaned import breast_of, cleaned
from breastscan.errors import PerceptionError
from breastscan.planning.pattern import PatternConfig, half_height_loop
from breastscan.run.clouds import PointFile
from tests.cloud import clouds

COUNT = 16_000
DRAWN = clouds.cloud(count=COUNT)
TOP_B = np.array([0.5, 0.0, 0.1 + clouds.HEIGHT])
UP = np.array([0.0, 0.0, 1.0])
EVERY = np.arange(COUNT)[:, None]
FACES = Delaunay(DRAWN.along).simplices
BEFORE_CAMERA = clouds.cloud(X_BS=clouds.tilted(np.pi, at=(0.02, 0.05, 0.5)), count=COUNT)
"""In the frame of a camera half a metre over it."""

HOLLOW = clouds.cloud(heights=lambda u, v: -clouds.bump(u, v), count=COUNT)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A file's content, and what must come of it."""

    cloud: Callable[[], PointFile]
    told: str = ""
    """Said of it, as a pattern; empty where nothing is."""
    refused: str = ""
    """Why, as a pattern; empty for one that is planned on."""


def points(p=DRAWN.points_B, n=DRAWN.normals_B) -> Callable[[], PointFile]:
    return lambda: PointFile(points=np.array(p), normals=None if n is None else np.array(n))


def mesh(corners=DRAWN.points_B, faces=FACES) -> Callable[[], PointFile]:
    return lambda: PointFile(points=np.array(corners), triangles=np.array(faces))


def more(extra: np.ndarray) -> Callable[[], PointFile]:
    """With more points, whose normals point up."""
    return points(
        np.vstack([DRAWN.points_B, extra]),
        np.vstack([DRAWN.normals_B, np.broadcast_to(UP, extra.shape)]),
    )


def over_top(count: int, height_mm: float, spread_mm: float = 1.0) -> np.ndarray:
    scatter = np.random.default_rng(count).standard_normal((count, 3)) * [spread_mm, spread_mm, 0.1]
    return TOP_B + 1e-3 * (scatter + height_mm * UP)


def flying() -> np.ndarray:
    """Between a breast's edge and what lies behind it, as where a pixel sees two depths."""
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(0, np.pi, 300)
    edge = TOP_B - 0.03 * UP + 0.05 * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], 1)
    camera = TOP_B + np.array([-0.3, -0.3, 0.4])
    return edge + rng.uniform(-0.3, 0.3, (300, 1)) * (edge - camera)


def solid() -> PointFile:
    closed = trimesh.creation.icosphere(5, 0.07)
    return PointFile(points=closed.vertices + TOP_B, triangles=closed.faces)


ESTIMATED, LEFT_OUT = "they are estimated", "of 16[0-9]* points lie off the surface"
KINDS = {
    "as a scan leaves it": Kind(cloud=points()),
    "without normals": Kind(cloud=points(n=None), told="has no normals"),
    "normals inwards": Kind(cloud=points(n=-DRAWN.normals_B), told="point inwards: turned"),
    "normals to both sides": Kind(
        cloud=points(n=np.where(EVERY % 2, 1, -1) * DRAWN.normals_B), told=ESTIMATED
    ),
    "normals all zero": Kind(cloud=points(n=0 * DRAWN.normals_B), told=ESTIMATED),
    "normals of another frame": Kind(
        cloud=points(n=DRAWN.normals_B @ Rotation.from_euler("x", 70, degrees=True).as_matrix()),
        told=ESTIMATED,
    ),
    "a fifth of the normals zero or NaN": Kind(
        cloud=points(
            n=DRAWN.normals_B * np.select([EVERY % 10 == 0, EVERY % 10 == 5], [0, np.nan], 7)
        ),
        told="3200 of 16000 normals are missing",
    ),
    "millimetres": Kind(cloud=points(1e3 * DRAWN.points_B), told="taken as millimetres"),
    "a mesh in millimetres": Kind(cloud=mesh(1e3 * DRAWN.points_B), told="millimetres"),
    "a mesh": Kind(cloud=mesh()),
    "a mesh of faces that face inwards": Kind(cloud=mesh(faces=FACES[:, ::-1])),
    "rows of NaN and of zeros": Kind(
        cloud=more(np.vstack([np.full((900, 3), np.nan), np.zeros((5000, 3))])),
        told=r"900 of 21900 points are not finite.*5000 of 21900 points are \(0, 0, 0\)",
    ),
    "zeros that were moved along": Kind(
        cloud=more(np.repeat(np.array([[0.5, 0.1, 0.7]]), 5000, axis=0)), told=LEFT_OUT
    ),
    "every point twice": Kind(
        cloud=points(np.tile(DRAWN.points_B, (2, 1)), np.tile(DRAWN.normals_B, (2, 1)))
    ),
    "10,000 copies of a point": Kind(cloud=more(np.repeat(DRAWN.points_B[:1], 10_000, axis=0))),
    "three points 10 mm over the top": Kind(cloud=more(over_top(3, 10.0)), told=LEFT_OUT),
    "ten points 10 mm over the top": Kind(cloud=more(over_top(10, 10.0)), told=LEFT_OUT),
    "ten points 5 mm over the top": Kind(cloud=more(over_top(10, 5.0))),
    "ten points 3 mm over the top, apart": Kind(cloud=more(over_top(10, 3.0, 3.0))),
    "points that fly at an edge": Kind(cloud=more(flying()), told=LEFT_OUT),
    "points all over the room": Kind(
        cloud=more(np.random.default_rng(0).uniform(-3, 3, (3000, 3))), told=LEFT_OUT
    ),
    "centimetres": Kind(cloud=points(1e2 * DRAWN.points_B), refused=r"centimetres \(times 0.01\)"),
    "inches": Kind(cloud=points(DRAWN.points_B / 0.0254), refused=r"inches \(times 0.0254\)"),
    "its own frame": Kind(
        cloud=points(DRAWN.points_B - TOP_B), refused="from the origin, where the robot stands"
    ),
    "its own frame in millimetres": Kind(
        cloud=points(1e3 * (DRAWN.points_B - TOP_B)), refused="in its base frame B and in metres"
    ),
    "a camera's frame": Kind(
        cloud=points(BEFORE_CAMERA.points_B, BEFORE_CAMERA.normals_B), refused="as a camera sees it"
    ),
    "a camera's frame without normals": Kind(
        cloud=points(BEFORE_CAMERA.points_B, None), refused="transformed by X_BL"
    ),
    "a camera's frame in millimetres": Kind(
        cloud=points(1e3 * BEFORE_CAMERA.points_B, None), refused="transformed by X_BL"
    ),
    "a whole body's surface": Kind(cloud=solid, refused="leave the side of the body out"),
    "a hollow in a chest": Kind(
        cloud=points(HOLLOW.points_B, HOLLOW.normals_B), refused="may be a hollow"
    ),
    "a hollow in a chest without normals": Kind(
        cloud=points(HOLLOW.points_B, None), refused="may be a hollow"
    ),
    "a few points": Kind(cloud=points(DRAWN.points_B[:50], None), refused="got 50: give a denser"),
    "nothing but NaN": Kind(cloud=points(np.full((500, 3), np.nan), None), refused="got 0"),
    "a mesh of faces without area": Kind(
        cloud=mesh(faces=np.zeros((10, 3), int)), refused="have no area"
    ),
}


def loop_on(cloud: PointFile) -> tuple[np.ndarray, str]:
    """The half-height loop on a cloud, and what was told."""
    breast, clean = breast_of(cleaned(cloud))
    normals_B = clean.normals_B
    assert np.allclose(np.linalg.norm(normals_B, axis=1), 1.0)
    skin = skin_fit.fit_cloud(clean.points_B[breast.skin], normals_B[breast.skin], breast.chest)
    path = half_height_loop(skin, breast.chest, PatternConfig(), 0.0)
    assert (path.normals_B[:, 2] > 0).all(), "the probe comes from outside"
    return path.points_B, " ".join(clean.told)


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if not kind.refused])
def test_the_loop_is_the_true_one(name):
    kind = KINDS[name]
    loop_B, told = loop_on(kind.cloud())
    assert KDTree(DRAWN.loop_B).query(loop_B)[0].max() < 0.5e-3
    assert re.search(kind.told, told)


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if kind.refused])
def test_what_must_not_be_planned_on_is_refused_with_the_cause(name):
    with pytest.raises(PerceptionError, match=KINDS[name].refused):
        loop_on(KINDS[name].cloud())


def test_a_nipple_is_no_outlier():
    """Without it, 4 mm high and some 10 mm wide, the loop were 2 mm lower."""

    def skin(u, v):
        return clouds.bump(u, v) + 4e-3 * np.exp(-(u**2 + v**2) / 5e-3**2)

    drawn = clouds.cloud(heights=skin)
    loop_B, told = loop_on(PointFile(points=drawn.points_B))
    half = (clouds.HEIGHT + 4e-3) / 2
    assert np.abs(loop_B[:, 2] - 0.1 - half).max() < 0.3e-3
    assert LEFT_OUT not in told
