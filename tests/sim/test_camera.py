import os
import subprocess
import sys

import cv2
import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.vision.camera import Intrinsics
from sim import picture
from sim.camera import SimStereoCamera
from sim.lens import CameraConfig, Lens, canvas, expose, mujoco_camera
from sim.picture import Picture

SUPERSAMPLING = 2
X_WC = se3.from_rotation_vector(np.array([2.9, 0.1, -0.2]), np.array([0.1, 0.2, 0.7]))
TARGET_RADIUS = 0.005
"""Radius of the test's luminous balls [m]."""


def target_grid(camera):
    """Points in C [m] in front of a grid of pixels, the rim of the image included as far as the lens lets rays in."""
    u, v = np.meshgrid(np.linspace(30, camera.width - 31, 10), np.linspace(30, camera.height - 31, 8))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    rim = np.linalg.norm((pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], axis=1)
    rays = cv2.undistortPoints(pixels[rim < 1.05][:, None], camera.K, camera.distortion)[:, 0]
    depth = np.random.default_rng(0).uniform(0.5, 0.65, (len(rays), 1))
    return np.hstack([rays, np.ones_like(depth)]) * depth


def image_of_balls(camera, points_C):
    root = mjcf.RootElement()
    root.visual.map.znear = 0.01
    root.visual.headlight.set_attributes(ambient=(0, 0, 0), diffuse=(0, 0, 0), specular=(0, 0, 0))
    lamp = root.asset.add("material", name="lamp", emission=0.8)
    for point_W in se3.transform(X_WC, points_C):
        root.worldbody.add("geom", type="sphere", size=(TARGET_RADIUS,), pos=point_W, material=lamp)
    pinhole = canvas(camera, SUPERSAMPLING)
    root.worldbody.add("camera", name="camera", **mujoco_camera(pinhole, X_WC))
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    model.vis.global_.offwidth, model.vis.global_.offheight = pinhole.width, pinhole.height
    with mujoco.Renderer(model, pinhole.height, pinhole.width) as renderer:
        renderer.update_scene(data, "camera")
        return Lens(camera, SUPERSAMPLING).bend(renderer.render())


def ball_centres(points_C, camera):
    """Pixels of the middles of the balls' outlines, which perspective moves outwards from their centres."""
    across = np.linalg.norm(points_C[:, :2], axis=1)
    off_axis, half_width = (
        np.arctan2(across, points_C[:, 2]),
        np.arcsin(TARGET_RADIUS / np.linalg.norm(points_C, axis=1)),
    )
    middle = (np.tan(off_axis + half_width) + np.tan(off_axis - half_width)) / 2
    rays = np.column_stack([points_C[:, :2] * (middle / across)[:, None], np.ones(len(middle))])
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0][:, 0]


def centroid(image, around, half=14):
    x, y = np.rint(around).astype(int)
    left, top = max(x - half, 0), max(y - half, 0)
    patch = image[top : y + half + 1, left : x + half + 1].astype(float)
    rows, columns = np.indices(patch.shape)
    return np.array([left + (patch * columns).sum() / patch.sum(), top + (patch * rows).sum() / patch.sum()])


@pytest.mark.parametrize("side", ["left", "right"])
def test_small_targets_appear_where_opencv_projects_them(quiet_scene, side):
    camera = getattr(quiet_scene.rig, side)
    points_C = target_grid(camera)
    image = image_of_balls(camera, points_C)
    expected = ball_centres(points_C, camera)
    errors_px = np.array([centroid(image, pixel) - pixel for pixel in expected])
    assert np.abs(errors_px.mean(axis=0)).max() < 0.01
    assert np.sqrt((errors_px**2).sum(axis=1).mean()) < 0.05
    assert np.linalg.norm(errors_px, axis=1).max() < 0.15


def test_a_lens_without_distortion_only_crops_the_canvas():
    K = np.array([[70.0, 0, 31], [0, 70, 23], [0, 0, 1]])
    camera = Intrinsics(K=K, distortion=np.zeros(5), width=64, height=48)
    wide = canvas(camera, 1)
    drawn = np.repeat(
        np.random.default_rng(0).integers(0, 256, (wide.height, wide.width, 1), dtype=np.uint8), 3, axis=2
    )
    assert (wide.width, wide.height) == (80, 60)
    np.testing.assert_allclose(Lens(camera, 1).bend(drawn), drawn[6:-6, 8:-8, 0], atol=0.01)


def test_pixels_beyond_the_turning_point_of_the_distortion_are_dark():
    """The radius r (1 - r^2 / 3) never exceeds 2/3, so a corner at .8 focal lengths has no ray."""
    K = np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]])
    camera = Intrinsics(K=K, distortion=np.array([-1 / 3, 0, 0, 0, 0]), width=65, height=49)
    wide = canvas(camera, 1)
    grey = Lens(camera, 1).bend(np.full((wide.height, wide.width, 3), 200, np.uint8))
    assert grey[0, 0] == 0
    assert grey[24, 32] == pytest.approx(200, abs=0.5)


def test_exposure_has_the_configured_noise_and_saturates():
    grey = np.full((200, 300), 100.0, np.float32)
    noisy = expose(grey, 1.0, np.random.default_rng(0)).astype(float)
    assert noisy.mean() == pytest.approx(100, abs=0.02)
    assert noisy.std() == pytest.approx(np.hypot(1.0, np.sqrt(1 / 12)), rel=0.02)
    assert expose(np.full((2, 2), 300.0, np.float32), 1.0, np.random.default_rng(0)).min() == 255


@pytest.fixture(scope="module")
def pairs(quiet_scene):
    """One pair of two cameras each, set up alike."""
    taken = []
    for _ in range(2):
        camera = SimStereoCamera(quiet_scene)
        taken.append(camera.capture())
        camera.close()
    return taken


def test_pairs_have_the_rigs_size_and_repeat_to_the_last_bit(quiet_scene, pairs):
    first, second = pairs
    assert first.left.shape == (quiet_scene.rig.left.height, quiet_scene.rig.left.width)
    np.testing.assert_array_equal(first.left, second.left)
    np.testing.assert_array_equal(first.right, second.right)


def test_the_skin_is_well_exposed_in_both_views(quiet_scene, pairs):
    """Neither black nor burnt out: stereo needs its texture."""
    skin_B = se3.transform(quiet_scene.X_BS, quiet_scene.phantom.skin.vertices_S)
    rig = quiet_scene.rig
    for image, camera, X_BC in (
        (pairs[0].left, rig.left, quiet_scene.X_BL),
        (pairs[0].right, rig.right, quiet_scene.X_BR),
    ):
        X_CB = se3.inverse(X_BC)
        rotation, _ = cv2.Rodrigues(X_CB[:3, :3])
        pixels, _ = cv2.projectPoints(skin_B, rotation, X_CB[:3, 3], camera.K, camera.distortion)
        x, y = np.rint(pixels[:, 0]).astype(int).T
        grey = image[y, x]
        assert 60 < np.median(grey) < 200
        assert np.percentile(grey, 99.5) < 250


@pytest.mark.parametrize(
    "wrong", [{"noise": -1.0}, {"noise": float("nan")}, {"supersampling": 0}, {"supersampling": 9}]
)
def test_cameras_that_cannot_be_are_refused(wrong):
    with pytest.raises(ConfigError):
        CameraConfig(**wrong)


def test_missing_opengl_is_said_in_words(quiet_scene, monkeypatch):
    def no_context(*_):
        raise RuntimeError("no EGL display")

    monkeypatch.setattr(picture.mujoco, "Renderer", no_context)
    with pytest.raises(ConfigError, match="libegl1") as caught:
        Picture(quiet_scene, 64, 48)
    assert "MUJOCO_GL" in str(caught.value)


def test_importing_the_twin_chooses_headless_drawing_without_a_display():
    environment = {k: v for k, v in os.environ.items() if k not in {"MUJOCO_GL", "DISPLAY"}}
    command = "import sim, os; print(os.environ['MUJOCO_GL'])"
    done = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "egl"
