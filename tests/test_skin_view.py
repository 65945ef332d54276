from dataclasses import replace

import numpy as np
import pytest

from breastscan import skin_view
from breastscan.cloud.segment import segment_breast
from breastscan.errors import PerceptionError
from breastscan.geometry import se3
from breastscan.vision.refine import refine
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments.ray_cast_dome import DomeScene

SCENE = DomeScene(texture="skin")


@pytest.fixture(scope="module")
def pair():
    return SCENE.pair()


@pytest.fixture(scope="module")
def refined(pair):
    matched = disparity_map(pair.left, pair.right, StereoConfig(consistency_px=2, mean_px=1))
    breast = segment_breast(triangulate(matched, pair))
    return refine(pair.left, pair.right, matched, breast.mask), breast


@pytest.fixture(scope="module")
def seen(pair, refined):
    return skin_view.see_skin(pair, *refined)


def above_foot() -> np.ndarray:
    """Pixels that both see the dome, 2 mm above the plate and higher."""
    return SCENE.on_dome & SCENE.seen_twice & (SCENE.points[..., 2] < SCENE.plate_distance - 2e-3)


def test_nearly_every_pixel_that_sees_skin_has_a_point_and_hardly_any_other(seen):
    _, disparity = seen
    found = np.isfinite(disparity)
    assert found[above_foot()].mean() > 0.985
    assert (found & ~SCENE.on_dome).sum() < 0.02 * SCENE.on_dome.sum()


def test_pixels_are_left_out_that_the_right_camera_sees_where_the_skin_ends():
    """Ten pixels of a row, of which the last three crowd within .6 px of the right view."""
    disparity = np.full((2, 12), np.nan)
    disparity[0, 1:11] = 20.0 - np.array([0, 0, 0, 0, 0, 0, 0, -0.8, -1.6, -2.4])
    kept = skin_view._off_right_rim(disparity)
    assert np.isfinite(kept[0]).tolist() == [*[False] * 2, *[True] * 6, *[False] * 4]
    assert not np.isfinite(kept[1]).any()


def test_the_skin_is_the_dome_within_a_fraction_of_a_tenth_of_a_millimetre(seen):
    skin, _ = seen
    p_L = SCENE.points[above_foot()]
    off = np.linalg.norm(skin.points(skin.chart(p_L)) - SCENE.sphere_centre, axis=1)
    assert np.sqrt(np.mean((off - SCENE.sphere_radius) ** 2)) * 1e3 < 0.06


def test_normals_are_right_within_a_third_of_a_degree(seen):
    skin, _ = seen
    p_L = SCENE.points[above_foot()]
    true_L = p_L - SCENE.sphere_centre
    tilt = se3.angle_between(skin.normals(skin.chart(p_L)), true_L)
    assert np.degrees(tilt).mean() < 0.35


def test_pixels_behind_others_in_the_right_view_are_hidden():
    disparity = np.array([[10.0, 10.0, 13.0, np.nan, 10.0]])
    # at 0, -1 .. the third lies before the second: 2 - 13 < 1 - 10
    hidden = skin_view._hidden_from_right(disparity)
    assert hidden.tolist() == [[True, True, False, False, False]]


def test_a_breast_of_which_hardly_anything_is_refined_shows_no_skin(pair, refined):
    first, breast = refined
    nothing = replace(first, applied=np.zeros_like(first.applied))
    with pytest.raises(PerceptionError, match="got 0"):
        skin_view.see_skin(pair, nothing, breast)
