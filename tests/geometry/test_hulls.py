"""Gaps between hulls, held against dense points on their surfaces."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.geometry.hulls import SIZES, HullTable, Shape, hull_distance, signed_distance

POINTS = 40_000
LENGTHS = {
    "sphere": (0.05,),
    "capsule": (0.03, 0.08),
    "cylinder": (0.05, 0.04),
    "box": (0.06, 0.03, 0.09),
}
PAIRS = [(a, b) for a in SIZES for b in SIZES if a <= b]


def shape(kind: str, X: np.ndarray | None = None) -> Shape:
    return Shape(name=kind, kind=kind, size=LENGTHS[kind], X=np.eye(4) if X is None else X)


def surface(kind: str) -> np.ndarray:
    """Points all over a hull."""
    size = LENGTHS[kind]
    mesh = {
        "sphere": lambda: trimesh.creation.icosphere(4, size[0]),
        "capsule": lambda: trimesh.creation.capsule(2 * size[-1], size[0], count=(64, 64)),
        "cylinder": lambda: trimesh.creation.cylinder(size[0], 2 * size[-1], 256),
        "box": lambda: trimesh.creation.box(2 * np.array(size)),
    }[kind]()
    if kind == "capsule":
        mesh.vertices -= mesh.bounds.mean(axis=0)
    return np.asarray(trimesh.sample.sample_surface(mesh, POINTS, seed=0)[0])


def random_pose(rng: np.random.Generator, reach: float) -> np.ndarray:
    direction = rng.standard_normal(3)
    p = reach * direction / np.linalg.norm(direction)
    return se3.pose(Rotation.random(random_state=rng).as_matrix(), p)


def gap(a: str, X_a: np.ndarray, b: str, X_b: np.ndarray) -> float:
    table = HullTable.of([shape(a), shape(b)])
    return hull_distance(table.arrays, 0, X_a, 1, X_b, 1.0)


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_the_gap_of_hulls_apart_is_that_between_points_on_them(a, b):
    rng = np.random.default_rng(0)
    tree, other = KDTree(surface(a)), surface(b)
    found = 0
    for _ in range(8):
        X = random_pose(rng, 0.22)
        between = float(tree.query(se3.transform(X, other))[0].min())
        if gap(a, np.eye(4), b, X) > 0:
            found += 1
            assert gap(a, np.eye(4), b, X) == pytest.approx(between, abs=1.2e-3)
    assert found > 4


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_hulls_that_hold_a_common_point_overlap(a, b):
    """Whatever their poses: a point well inside of both makes the gap negative, however deep."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        p = rng.uniform(-0.02, 0.02, 3)
        X_a, X_b = (se3.pose(Rotation.random(random_state=rng).as_matrix(), p) for _ in range(2))
        assert gap(a, X_a, b, X_b) < -0.005


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_the_gap_is_the_same_from_either_side_and_from_any_frame(a, b):
    rng = np.random.default_rng(2)
    X_a, X_b, X = (random_pose(rng, 0.15) for _ in range(3))
    first = gap(a, X_a, b, X_b)
    assert gap(b, X_b, a, X_a) == pytest.approx(first, abs=2e-5)
    assert gap(a, X @ X_a, b, X @ X_b) == pytest.approx(first, abs=2e-5)


def test_a_capsule_deep_under_a_table_is_as_deep():
    """Where `mj_geomDistance` (MuJoCo 4.0.0) tells of 46 mm of room."""
    table = Shape(name="table", kind="box", size=(0.7, 0.5, 0.3), X=np.eye(4))
    link = Shape(name="link", kind="capsule", size=(0.06, 0.2), X=np.eye(4))
    lying = se3.from_rotation_vector(np.array([0.0, np.pi / 2, 0.0]), np.array([0, 0, 0.3 - 0.141]))
    hulls = HullTable.of([table, link])
    assert hull_distance(hulls.arrays, 0, np.eye(4), 1, lying, 1.0) == pytest.approx(-0.201)


@pytest.mark.parametrize("kind", SIZES)
def test_the_signed_distance_vanishes_on_the_surface(kind):
    hull = HullTable.of([shape(kind)])
    found = [signed_distance(hull.kinds[0], hull.sizes[0], *p) for p in surface(kind)[:500]]
    assert np.abs(found).max() < 2e-4


@pytest.mark.parametrize("size", [(0.1, 0.1), (0.1, -0.1, 0.1), (0.1, np.nan, 0.1)])
def test_lengths_that_no_box_has_are_refused(size):
    with pytest.raises(ConfigError, match="3 positive lengths"):
        Shape(name="box", kind="box", size=size, X=np.eye(4))
