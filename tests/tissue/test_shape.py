"""The shape on which the tissue is modelled, against a shape that is known."""

from dataclasses import dataclass

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from breastscan.tissue.mesh import half_shell
from breastscan.tissue.shape import FEWEST_POINTS, StarShape
from tests.tissue.shapes import CHEST, dome_cloud, off_the_dome, tilted

DIRECTIONS = half_shell(0.1, rotation=0.0)


def worst(shape: StarShape) -> float:
    """Farthest that the shape's skin lies from the dome's [mm]."""
    return 1e3 * float(np.abs(off_the_dome(shape.embed(DIRECTIONS))).max())


def test_a_smooth_shape_is_found_to_a_tenth_of_a_millimetre_down_to_its_foot():
    assert worst(StarShape.fit(dome_cloud(0), CHEST)) < 0.1


def test_noise_and_outliers_hardly_move_it():
    rng = np.random.default_rng(1)
    points = dome_cloud(0) + 3e-4 * rng.standard_normal((len(dome_cloud(0)), 3))
    points[:30] += 0.01
    assert worst(StarShape.fit(points, CHEST)) < 0.5


def test_a_flank_that_was_not_seen_is_carried_on_to_the_chest():
    """60 degrees of azimuth are missing below two fifths of the height."""
    points = dome_cloud(0)
    hole = (np.abs(np.arctan2(points[:, 1], points[:, 0])) < 0.5) & (points[:, 2] < 0.022)
    assert worst(StarShape.fit(points[~hole], CHEST)) < 1.0


def test_the_base_lies_on_the_chest():
    foot = StarShape.fit(dome_cloud(0), CHEST).embed(DIRECTIONS[DIRECTIONS[:, 2] == 0])
    np.testing.assert_allclose(CHEST.heights(foot), 0.0, atol=1e-12)


def test_it_stands_square_on_a_chest_that_leans():
    X_BA = tilted()
    shape = StarShape.fit(se3.transform(X_BA, dome_cloud(0)), CHEST.seen_from(X_BA))
    in_its_frame = se3.transform(se3.inverse(X_BA), shape.embed(DIRECTIONS))
    assert np.abs(off_the_dome(in_its_frame)).max() < 1e-4


@dataclass(frozen=True, kw_only=True)
class Cylinder(Plane):
    """A chest that is curved across, its highest line along y."""

    radius: float

    def elevation(self, p: np.ndarray) -> np.ndarray:
        return np.sqrt(self.radius**2 - p[..., 0] ** 2) - self.radius

    def heights(self, p: np.ndarray) -> np.ndarray:
        return p[..., 2] - self.elevation(p)


def test_on_a_curved_chest_foot_and_skin_follow_it():
    chest = Cylinder(normal=CHEST.normal, offset=0.0, radius=0.15)
    points = dome_cloud(0)
    points[:, 2] += chest.elevation(points)
    shape = StarShape.fit(points, chest)
    found = shape.embed(DIRECTIONS)
    foot = found[DIRECTIONS[:, 2] == 0]
    np.testing.assert_allclose(chest.heights(foot), 0.0, atol=1e-6)
    found[:, 2] -= chest.elevation(found)
    assert np.abs(off_the_dome(found)).max() < 2e-4


def test_too_few_points_are_refused():
    with pytest.raises(PlanningError, match=f"expected {FEWEST_POINTS} points"):
        StarShape.fit(dome_cloud(0)[:100], CHEST)


def test_skin_that_passes_through_the_middle_of_its_foot_is_refused():
    """A sixth of the breast is missing, as by a wall close to its middle."""
    points = dome_cloud(0)
    cut = np.abs(np.arctan2(points[:, 1], -points[:, 0])) < 0.5
    points[cut] *= 0.02
    with pytest.raises(PlanningError, match="all around"):
        StarShape.fit(points, CHEST)
