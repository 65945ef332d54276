"""How pressing drags the skin along, by the laws it must keep; tests/sim/tissue/test_drag.py holds
it against the twin's tissue.
"""

import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.tissue.drag import PressedBreast, TissueConfig
from tests.tissue.shapes import CHEST, dome, dome_cloud, probes, tilted

CONFIG = TissueConfig()
HALF_HEIGHT = np.pi / 3
"""Angle of the half-ball from its top that has half the dome's height [rad]."""
AT_6_MM = 0.006**1.5
"""What makes of the drag that of an indentation of 6 mm [m^(3/2)]."""


@pytest.fixture(scope="module")
def pressed() -> PressedBreast:
    return PressedBreast(dome, CONFIG)


def test_on_a_flank_the_skin_moves_up_and_across_the_axis(pressed):
    X_AP = probes(HALF_HEIGHT, 12)
    drag = pressed.drag(X_AP)
    uphill = -X_AP[:, :3, 1]
    assert uphill[:, 2].min() > 0.5
    assert 1e3 * AT_6_MM * np.sum(drag * uphill, axis=1) == pytest.approx(1.0, abs=0.4)
    np.testing.assert_allclose(np.sum(drag * X_AP[:, :3, 2], axis=1), 0.0, atol=1e-9)


def test_on_the_top_of_a_body_of_revolution_it_stays(pressed):
    """What is left is the mesh, which has no such symmetry."""
    drag = pressed.drag(probes(1e-6, 4))
    assert 1e3 * AT_6_MM * np.linalg.norm(drag.mean(axis=0)) < 0.1


def test_round_a_body_of_revolution_it_is_the_same_everywhere(pressed):
    X_AP = probes(HALF_HEIGHT, 12)
    up = 1e3 * AT_6_MM * np.sum(-X_AP[:, :3, 1] * pressed.drag(X_AP), axis=1)
    assert up.std() < 0.1


def test_turning_the_probe_about_its_axis_hardly_changes_it(pressed):
    """The touched skin is the same; only the patch lies otherwise."""
    X_AP = probes(HALF_HEIGHT, 12)
    quarter = se3.from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]), np.zeros(3))
    change = pressed.drag(X_AP @ quarter) - pressed.drag(X_AP)
    assert 1e3 * AT_6_MM * np.linalg.norm(change.mean(axis=0)) < 0.3


@pytest.mark.parametrize("force", [1.0, 5.0])
def test_a_point_of_a_flank_is_touched_from_above_it_in_proportion_to_the_force(pressed, force):
    X_AP = probes(HALF_HEIGHT, 12)
    points_A, uphill_A = X_AP[:, :3, 3], -X_AP[:, :3, 1]
    up_A = np.array([0.0, 0.0, 1.0])
    off_mm = 1e3 * (pressed.places(points_A, -X_AP[:, :3, 2], up_A, force) - points_A)
    assert np.sum(off_mm * uphill_A, axis=1) == pytest.approx(force / 5.0, abs=0.4 * force / 5.0)
    np.testing.assert_allclose(off_mm, 1e3 * AT_6_MM * force / 5.0 * pressed.drag(X_AP), atol=1e-9)


def path_of(X_BA):
    """Probes all round, at every degree, and the length along their path [m]."""
    X_BP = X_BA @ probes(HALF_HEIGHT, 360)
    steps = np.linalg.norm(np.diff(X_BP[:, :3, 3], axis=0), axis=1)
    return X_BP, np.concatenate([[0.0], np.cumsum(steps)])


def test_along_a_path_it_is_smooth_and_does_not_care_how_the_chest_lies():
    found = []
    for X_BA in (np.eye(4), tilted()):
        X_BP, s = path_of(X_BA)
        points_B = se3.transform(X_BA, dome_cloud(0))
        breast = PressedBreast.perceived(points_B, CHEST.seen_from(X_BA), CONFIG)
        drag_B = breast.along_path(X_BP, s)
        np.testing.assert_allclose(np.sum(drag_B * X_BP[:, :3, 2], axis=1), 0.0, atol=1e-9)
        found.append(1e3 * AT_6_MM * np.einsum("kca,kc->ka", X_BP[:, :3, :3], drag_B))
    assert np.abs(np.diff(found[0], axis=0)).max() < 0.02
    assert np.abs(found[0] - found[1]).max() < 0.2


@pytest.mark.parametrize("poisson", [0.5, -0.1])
def test_a_ratio_that_no_solid_has_is_refused(poisson):
    with pytest.raises(ConfigError, match=r"planning\.tissue\.poisson"):
        TissueConfig(poisson=poisson)
