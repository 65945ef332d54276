"""The rigid print against Hertz's law, a search over its mesh, and the laws of mechanics."""

import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.printed import STIFFNESS, PrintedBreast
from sim.wrist.probe_face import ProbeFace, distance
from tests.sim.tissue.press_poses import REST, loop_pose


@pytest.fixture(scope="module")
def phantom() -> Phantom:
    return Phantom(PhantomConfig(mechanics="printed"))


@pytest.fixture
def printed(phantom) -> PrintedBreast:
    return PrintedBreast(phantom)


def test_a_square_press_gives_hertz_force_along_the_axis(phantom, printed):
    for azimuth in (0.0, 2.0, 4.0):
        X_SP = loop_pose(phantom, azimuth, 0.0004)
        contact = printed.press(X_SP, REST)
        force_P = contact.force_S @ X_SP[:3, :3]
        assert -force_P[2] == pytest.approx(STIFFNESS * 0.0004**1.5, rel=0.02)
        assert np.linalg.norm(force_P[:2]) < 0.02 * abs(force_P[2])
        assert np.linalg.norm(contact.centre_S - X_SP[:3, 3]) < 1e-3
        assert contact.depth == 0


def test_five_newtons_take_four_tenths_of_a_millimetre_and_the_skin_stays(phantom, printed):
    X_SP = loop_pose(phantom, 1.0, 0.0004)
    assert np.linalg.norm(printed.press(X_SP, REST).force_S) == pytest.approx(5, abs=0.5)
    assert printed.deformed_skin() is phantom.skin.vertices_S


def test_the_deepest_point_is_the_one_that_a_search_of_the_skin_finds(phantom, printed):
    """Tilted and rolled probes; around the deepest vertex 4000 points of the smooth skin are
    tried.
    """
    rng = np.random.default_rng(0)
    skin_direction = phantom.inverse_map(phantom.skin.vertices_S)
    for azimuth in rng.uniform(0, 2 * np.pi, 12):
        X_SP = loop_pose(phantom, azimuth, 0.0005)
        X_SP[:3, :3] = X_SP[:3, :3] @ Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3)).as_matrix()
        contact = printed.press(X_SP, REST)
        around = skin_direction[_depths(phantom.skin.vertices_S, X_SP).argmax()]
        tried = around + 0.01 * rng.standard_normal((4000, 3))
        tried /= np.linalg.norm(tried, axis=1, keepdims=True)
        overlap = (np.linalg.norm(contact.force_S) / STIFFNESS) ** (2 / 3)
        assert overlap == pytest.approx(_depths(phantom.embed(tried), X_SP).max(), abs=5e-6)


def _depths(
    p_S: Float[np.ndarray, "n 3"], X_SP: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n"]:
    """How deep points lie in the face [m]."""
    return np.array(
        [-distance(ProbeFace().parameters(), *p_P)[0] for p_P in (p_S - X_SP[:3, 3]) @ X_SP[:3, :3]]
    )


def test_force_is_continuous_over_micrometres(phantom, printed):
    X_SP = loop_pose(phantom, 2.0, 0.0004)
    for axis in range(2):
        force = []
        for step in np.arange(200) * 5e-6:
            moved = X_SP.copy()
            moved[:3, 3] += step * X_SP[:3, axis]
            force.append(printed.press(moved, REST).force_S)
        assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 0.02


def test_a_probe_off_the_print_feels_nothing(phantom, printed):
    for height in (1e-5, 0.005, 0.3):
        contact = printed.press(loop_pose(phantom, 1.0, -height), np.array([0.1, 0.0, -0.1]))
        assert contact.vertices == 0
        assert not contact.force_S.any()
        assert len(printed.patch().areas) == 0


def test_the_patch_carries_the_force(phantom, printed):
    contact = printed.press(loop_pose(phantom, 1.0, 0.0004), REST)
    patch = printed.patch()
    assert patch.pressure @ patch.areas == pytest.approx(np.linalg.norm(contact.force_S), rel=1e-6)
    printed.reset()
    assert len(printed.patch().areas) == 0
