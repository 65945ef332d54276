import cv2
import numpy as np
import pytest

from breastscan.vision.camera import Intrinsics, StereoRig
from experiments.camera_projection import measure
from sim.cameras.camera_errors import CameraErrors
from sim.cameras.lens import Lens, binned, canvases

IDEAL = CameraErrors()


def pinhole(width=64, height=48, focal=70.0, distortion=(0.0, 0.0, 0.0, 0.0, 0.0)):
    K = np.array([[focal, 0, width / 2 - 1], [0, focal, height / 2 - 1], [0, 0, 1]])
    return Intrinsics(K=K, distortion=np.array(distortion), width=width, height=height)


def canvas_of(camera, supersampling=1):
    return canvases(StereoRig(left=camera, right=camera, X_RL=np.eye(4)), supersampling)["left"]


def test_a_lens_is_prepared_by_what_its_camera_is_and_not_by_which_was_first():
    plain, bent = pinhole(), pinhole(distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
    drawn = np.random.default_rng(0).integers(0, 255, (200, 200, 3), np.uint8)

    def light(camera):
        canvas = canvas_of(bent)
        picture = drawn[: canvas.height, : canvas.width].copy()
        return Lens(camera, canvas, 1, IDEAL).bend(picture)

    first = light(bent)
    assert np.abs(light(plain) - first).max() > 1.0
    np.testing.assert_array_equal(light(pinhole(distortion=(-0.2, 0.05, 0, 0, 0))), first)


@pytest.mark.parametrize("side", ["left", "right"])
def test_soft_dots_appear_where_opencv_projects_them(quiet_scene, side):
    found = measure(quiet_scene.rig, side, supersampling=2, seed=0)
    assert found.corner.sum() > 50
    assert found.mean_px < 0.01
    assert found.corner_rms_px < 0.05
    assert np.linalg.norm(found.error_px, axis=1).max() < 0.1


def test_a_lens_without_distortion_only_crops_the_canvas():
    camera = pinhole()
    wide = canvas_of(camera)
    drawn = np.repeat(
        np.random.default_rng(0).integers(0, 256, (wide.height, wide.width, 1), dtype=np.uint8),
        3,
        axis=2,
    )
    left, top = np.rint(wide.K[:2, 2] - camera.K[:2, 2]).astype(int)
    crop = drawn[top : top + camera.height, left : left + camera.width, 0]
    np.testing.assert_allclose(Lens(camera, wide, 1, IDEAL).bend(drawn), crop, atol=0.01)


@pytest.mark.parametrize("k1", [-0.3, 0.0, 0.3])
def test_the_canvas_reaches_as_far_as_the_lens_sees_and_no_farther(k1):
    """A white canvas leaves no dark pixel, unless two of its edges are blackened."""
    camera = pinhole(160, 128, 150.0, (k1, 0, 0, 0, 0))
    wide = canvas_of(camera)
    drawn = np.full((wide.height, wide.width, 3), 200, np.uint8)
    lens = Lens(camera, wide, 1, IDEAL)
    np.testing.assert_allclose(lens.bend(drawn), 200, atol=0.01)
    drawn[:, :16] = drawn[:16] = 0
    assert lens.bend(drawn).min() < 100


def test_pixels_beyond_the_turning_point_of_the_distortion_are_dark():
    """The radius r (1 - r^2 / 3) never exceeds 2/3, so a corner at .8 focal lengths has no ray."""
    camera = pinhole(66, 50, 50.0, (-1 / 3, 0, 0, 0, 0))
    wide = canvas_of(camera)
    grey = Lens(camera, wide, 1, IDEAL).bend(np.full((wide.height, wide.width, 3), 200, np.uint8))
    assert grey[0, 0] == 0
    assert grey[24, 32] == pytest.approx(200, abs=0.5)


def test_binning_keeps_the_view(quiet_scene):
    """A ray meets the binned image at the place of the four pixels that were read out as one."""
    camera = quiet_scene.rig.left
    rays = np.array([[[0.1, -0.2, 1.0], [-0.4, 0.3, 1.0]]])
    full, small = (
        cv2.projectPoints(rays, np.zeros(3), np.zeros(3), each.K, each.distortion)[0][:, 0]
        for each in (camera, binned(camera, 4))
    )
    np.testing.assert_allclose(small, (full + 0.5) / 4 - 0.5, atol=1e-9)


def test_light_falls_off_with_the_power_of_the_off_axis_angles_cosine(quiet_scene):
    camera = quiet_scene.rig.right
    wide = canvas_of(camera)
    white = np.full((wide.height, wide.width, 3), 200, np.uint8)
    light = Lens(camera, wide, 1, CameraErrors(vignetting=4.0)).bend(white)
    pixels = np.array(
        [[649.0, 514.0], [900.0, 514.0], [649.0, 150.0], [1200.0, 900.0], [60.0, 60.0]]
    )
    rays = cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion)[:, 0]
    cosine = 1 / np.sqrt(1 + (rays**2).sum(axis=1))
    x, y = pixels.astype(int).T
    np.testing.assert_allclose(light[y, x] / 200, cosine**4, rtol=1e-3)
    assert light[60, 60] < 0.5 * light[514, 649]


def edge_transfer(light, slope):
    """Frequencies [1/px] and the contrast at which a slanted edge passes them (ISO 12233)."""
    y, x = np.indices(light.shape)
    across = (x - light.shape[1] / 2 - slope * (y - light.shape[0] / 2)) / np.hypot(1, slope)
    bins = np.arange(-20, 20, 0.25)
    where = np.digitize(across.ravel(), bins)
    spread = np.array([light.ravel()[where == i].mean() for i in range(1, len(bins))])
    line = np.diff(spread) * np.hanning(len(spread) - 1)
    spectrum = np.abs(np.fft.rfft(line))
    return np.fft.rfftfreq(len(line), 0.25), spectrum / spectrum[0]


def test_blur_lowers_the_contrast_of_a_slanted_edge_as_a_gaussian_does():
    sigma = 0.8
    slope = 0.13
    finer = 4
    camera = pinhole(160, 128, 150.0)
    wide = canvas_of(camera, finer)
    y, x = (index / finer for index in np.indices((wide.height, wide.width)))
    left, top = wide.K[:2, 2] / finer - camera.K[:2, 2]
    edge = x - left - camera.width / 2 - slope * (y - top - camera.height / 2) > 0
    drawn = np.repeat(np.where(edge, 200, 40).astype(np.uint8)[..., None], 3, axis=2)
    frequency, sharp = edge_transfer(Lens(camera, wide, finer, IDEAL).bend(drawn), slope)
    _, blurred = edge_transfer(
        Lens(camera, wide, finer, CameraErrors(blur_px=sigma)).bend(drawn), slope
    )
    low = (frequency > 0) & (frequency < 0.35)
    gaussian = np.exp(-2 * (np.pi * sigma * frequency[low]) ** 2)
    np.testing.assert_allclose(blurred[low] / sharp[low], gaussian, atol=0.03)
