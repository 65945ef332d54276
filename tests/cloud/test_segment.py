"""Segmentation of ray-cast scenes, where every pixel's surface is known."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.cloud.segment import SegmentConfig, on_refined, segment_breast
from breastscan.errors import ConfigError, PerceptionError
from breastscan.geometry.chest import Chest
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments.ray_cast_dome import DomeScene

SCENE = DomeScene()


def noisy_points(scene: DomeScene, noise: float = 0.4e-3, seed: int = 0) -> np.ndarray:
    """The scene as a matcher sees it: depth noise, and no points where only one camera looks."""
    depth = scene.points[..., 2]
    points = (
        scene.points
        * (1 + noise * np.random.default_rng(seed).standard_normal(depth.shape) / depth)[..., None]
    )
    return np.where(scene.seen_twice[..., None], points, np.nan)


@cache
def matched_points() -> np.ndarray:
    """The scene through the real matcher."""
    pair = SCENE.pair()
    return triangulate(disparity_map(pair.left, pair.right, StereoConfig()), pair)


@pytest.mark.parametrize("table_drop", [0.08, 0.12])
def test_breast_is_found_on_its_plate_above_the_table(table_drop):
    scene = DomeScene(table_drop=table_drop)
    breast = segment_breast(noisy_points(scene))
    assert abs(breast.height - 0.055) < 1.5e-3
    assert abs(breast.width - 0.150) < 8e-3
    assert abs(breast.plate.offset + scene.plate_distance) < 0.2e-3
    assert np.degrees(np.arccos(-breast.plate.normal[2])) < 0.1


def test_mask_covers_visible_skin_and_nothing_else_on_matched_images():
    """A surface counts as covered only where there is a point: at least .95 of the skin that
    both cameras see.
    """
    points = matched_points()
    mask = segment_breast(points).mask
    visible_skin = SCENE.on_dome & SCENE.seen_twice
    covered = mask & np.isfinite(points).all(axis=-1)
    assert covered[visible_skin].mean() > 0.96
    assert (mask & ~SCENE.on_dome).sum() < 0.01 * mask.sum()


def test_cameras_may_look_from_the_side():
    """Plate and normal rotate with the cameras; the mask does not care."""
    points = noisy_points(SCENE)
    R = Rotation.from_euler("xyz", [20.0, -10.0, 35.0], degrees=True).as_matrix()
    rotated = segment_breast(points @ R.T)
    straight = segment_breast(points)
    assert (rotated.mask ^ straight.mask).sum() < 0.01 * straight.mask.sum()
    np.testing.assert_allclose(rotated.plate.normal, R @ straight.plate.normal, atol=2e-3)


def test_an_arm_beside_the_breast_is_left_out():
    """A bar 40 mm thick lies over the plate's edge, 20 mm above it, and is larger in the image
    than the breast.
    """
    points = noisy_points(SCENE)
    bar = np.abs(points[..., 1] - 0.13) < 0.035
    points[bar] *= (SCENE.plate_distance - 0.06) / points[bar][:, 2:]
    breast = segment_breast(points)
    assert not (breast.mask & bar).any()
    assert abs(breast.height - 0.055) < 1.5e-3


def test_holes_inside_the_breast_belong_to_it():
    points = noisy_points(SCENE)
    points[215:225, 375:390] = np.nan
    assert segment_breast(points).mask[215:225, 375:390].all()


def test_same_seed_gives_the_same_plate():
    points = noisy_points(SCENE)
    first, second = segment_breast(points), segment_breast(points)
    np.testing.assert_array_equal(first.plate.normal, second.plate.normal)
    np.testing.assert_array_equal(first.mask, second.mask)


def test_heights_are_measured_from_the_plate_towards_the_camera():
    plate = segment_breast(noisy_points(SCENE)).plate
    apex = np.array([[SCENE.baseline / 2, 0.0, SCENE.plate_distance - SCENE.dome_height]])
    assert abs(plate.heights(apex)[0] - SCENE.dome_height) < 0.2e-3


@pytest.mark.parametrize(
    ("scene", "found"),
    [
        (dataclasses.replace(SCENE, dome_radius=0.02, dome_height=0.015), "3[0-9] mm wide"),
        (dataclasses.replace(SCENE, dome_radius=0.12, dome_height=0.118), "11[0-9] mm high"),
    ],
    ids=["too small", "too high"],
)
def test_bumps_of_implausible_size_are_reported_with_their_size(scene, found):
    config = SegmentConfig(height_range=(0.01, 0.1))
    with pytest.raises(PerceptionError, match=found):
        segment_breast(noisy_points(scene), config)


def test_breast_seen_by_too_few_pixels_is_refused():
    far = DomeScene(focal_px=137.0, width_px=128, height_px=90, samples=1)
    with pytest.raises(PerceptionError, match=r"seen by only 1[0-9]+ px"):
        segment_breast(far.points)


def test_flat_scene_has_no_breast():
    flat = dataclasses.replace(SCENE, dome_height=1e-6)
    with pytest.raises(PerceptionError, match="expected a breast 60 to 250 mm wide"):
        segment_breast(noisy_points(flat))


def test_cloud_without_points_has_no_breast():
    with pytest.raises(PerceptionError, match="nothing that stands on a plane"):
        segment_breast(np.full((40, 50, 3), np.nan))


@pytest.mark.parametrize(
    "wrong",
    [{"cut_height": 0.0}, {"plane_tolerance": -1.0}, {"width_range": (0.2, 0.1)}, {"planes": 0}],
)
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        SegmentConfig(**wrong)


def bent_points(radius: float, noise: float = 0.0) -> np.ndarray:
    """The scene sheared along its depth, so that the dome stands on a parabolic cylinder whose
    crest runs down the picture; it is seen to 160 mm on both sides.
    """
    points = noisy_points(SCENE, noise) if noise else SCENE.points.copy()
    x = points[..., 0] - SCENE.baseline / 2
    points[..., 2] += x**2 / (2 * radius)
    points[np.abs(x) > 0.16] = np.nan
    return points


def bent_chest(radius: float) -> Chest:
    middle = np.array([SCENE.baseline / 2, 0.0, SCENE.plate_distance])
    bend = np.diag([1 / radius, 0.0, 0.0])
    return Chest(
        normal=np.array([0.0, 0, -1]), offset=-SCENE.plate_distance, middle=middle, bend=bend
    )


@pytest.mark.parametrize("radius", [0.15, 0.4])
def test_a_breast_on_a_bent_chest_is_found_and_its_heights_count_from_it(radius):
    points = bent_points(radius, noise=0.4e-3)
    breast = segment_breast(points)
    assert breast.plate.radius == pytest.approx(radius, rel=0.05)
    skin = points[breast.mask & np.isfinite(points[..., 0])]
    expected = bent_chest(radius).heights(skin)
    np.testing.assert_allclose(breast.plate.heights(skin), expected, atol=0.4e-3)
    on_dome = SCENE.on_dome & np.isfinite(points).all(axis=-1)
    assert breast.mask[on_dome].mean() > 0.93
    assert (breast.mask & ~SCENE.on_dome).sum() < 0.02 * breast.mask.sum()


def test_refined_points_around_the_breast_mend_the_chest():
    """The matched ones, tilted by what they have in common, are off; the ring's refined ones are
    true.
    """
    wrong = bent_points(0.2)
    wrong[..., 2] += 0.3e-3 + 2e-3 * wrong[..., 0]
    breast = segment_breast(wrong)
    mended = on_refined(breast, np.where(breast.ring[..., None], bent_points(0.2), np.nan))
    top = np.array([[SCENE.baseline / 2, 0.0, SCENE.plate_distance - SCENE.dome_height]])
    assert mended.plate.heights(top)[0] == pytest.approx(SCENE.dome_height, abs=0.05e-3)
    np.testing.assert_array_equal(mended.mask, breast.mask)


def test_a_bent_chest_of_which_one_side_is_not_seen_is_refused_with_the_side():
    points = bent_points(0.15)
    breast = segment_breast(points)
    hidden = points[..., 0] - SCENE.baseline / 2 > -0.01
    points[hidden & ~breast.mask] = np.nan
    with pytest.raises(PerceptionError, match=r"not seen over 1[5-9]\d degrees .* the right of"):
        on_refined(breast, points)


def test_a_chest_that_is_not_seen_around_the_breast_is_refused():
    breast = segment_breast(SCENE.points)
    nothing = np.where(breast.mask[..., None], SCENE.points, np.nan)
    with pytest.raises(PerceptionError, match="only 0 px around the breast"):
        on_refined(breast, nothing)


def test_two_breasts_are_refused_with_their_places():
    """The scene beside itself, at the same depth."""
    points = np.concatenate([SCENE.points, SCENE.points + np.array([0.5, 0, 0])], axis=1)
    with pytest.raises(PerceptionError, match=r"found 2 \(one 1\d\d mm wide at column \d+, row"):
        segment_breast(points)


def test_a_breast_that_the_picture_cuts_off_is_refused_with_the_border():
    left = int(np.nonzero(SCENE.on_dome)[1].min())
    with pytest.raises(PerceptionError, match="cut off by the left border"):
        segment_breast(SCENE.points[:, left + 60 :])
