from dataclasses import replace

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.planning import coverage
from breastscan.planning.coverage import Dome
from breastscan.planning.pattern import Path
from tests.skins import ellipsoid

RADIUS = 0.070
CENTRE_B = np.array([0.5, 0.05, 0.08])
LOWEST = np.radians(70.0)


@pytest.fixture(scope="module")
def dome() -> Dome:
    """Half a ball on the plate."""
    return Dome(skin=ellipsoid(np.full(3, RADIUS), CENTRE_B))


def polar_angles(path: Path) -> np.ndarray:
    from_centre = path.points_B - CENTRE_B
    return np.arccos(from_centre[:, 2] / np.linalg.norm(from_centre, axis=1))


def assert_on_skin(path: Path) -> None:
    from_centre = path.points_B - CENTRE_B
    distance = np.linalg.norm(from_centre, axis=1)
    assert np.abs(distance - RADIUS).max() * 1e3 < 1e-3
    cosine = np.sum(from_centre / distance[:, None] * path.normals_B, axis=1)
    assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() < 0.01


def test_loops_lie_at_their_angles_and_close(dome):
    angles = np.radians([25.0, 45.0, 65.0])
    for path, angle in zip(coverage.loops(dome, angles, 15), angles, strict=True):
        assert_on_skin(path)
        np.testing.assert_allclose(polar_angles(path), angle, atol=1e-9)
        assert path.curve.closed


def test_spiral_goes_from_the_inside_out_in_even_steps(dome):
    path = coverage.spiral(dome, np.radians(10.0), LOWEST, turns=4.0, spacing=0.15)
    assert_on_skin(path)
    assert np.all(np.diff(polar_angles(path)) > 0)
    steps = np.linalg.norm(np.diff(path.points_B, axis=0), axis=1)
    assert np.ptp(steps) / steps.mean() < 0.1
    azimuth = np.unwrap(np.arctan2(*(path.points_B - CENTRE_B)[:, 1::-1].T))
    assert np.ptp(azimuth) == pytest.approx(8 * np.pi, abs=0.1)


def test_radial_strokes_pass_over_the_top(dome):
    paths = coverage.radial(dome, LOWEST, strokes=4, points=9)
    for path in paths:
        assert_on_skin(path)
        assert polar_angles(path)[4] < 1e-9
        np.testing.assert_allclose(polar_angles(path)[[0, -1]], LOWEST, atol=1e-9)


def test_raster_strokes_run_to_and_fro_inside_the_outermost_angle(dome):
    paths = coverage.raster(dome, LOWEST, strokes=6, points=12)
    chords = np.array([path.points_B[-1] - path.points_B[0] for path in paths])
    assert np.all(np.sum(chords[1:] * chords[:-1], axis=1) < 0)
    for path in paths:
        assert_on_skin(path)
        assert polar_angles(path).max() < LOWEST + 1e-9


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, -0.1])
def test_angles_off_the_breast_are_refused(dome, angle):
    with pytest.raises(PlanningError, match="between 0 and pi / 2"):
        coverage.loops(dome, np.array([angle]), 15)


def test_skin_that_was_not_seen_is_not_crossed(dome):
    unseen = replace(dome.skin, support=np.zeros_like(dome.skin.support))
    with pytest.raises(PlanningError, match="no skin was seen over 100% of the path"):
        coverage.loops(Dome(skin=unseen), np.radians([45.0]), 15)
