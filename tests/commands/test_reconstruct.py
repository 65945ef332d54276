"""A pair on disk against the ray-cast truth, and every way in which a pair can be unusable."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from breastscan.camera.grey import read_grey
from breastscan.commands.reconstruct import reconstruct
from breastscan.errors import PerceptionError
from breastscan.scan import PerceptionConfig
from breastscan.vision.camera import Intrinsics, StereoRig
from experiments.depth_edges import edge_pair
from experiments.ray_cast_dome import DomeScene

SCENE = DomeScene()


def ideal_rig() -> StereoRig:
    (cx, cy), f = SCENE.centre_px, SCENE.focal_px
    camera = Intrinsics(
        K=np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]], float),
        distortion=np.zeros(5),
        width=SCENE.width_px,
        height=SCENE.height_px,
    )
    X_RL = np.eye(4)
    X_RL[0, 3] = -SCENE.baseline
    return StereoRig(left=camera, right=camera, X_RL=X_RL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """left.png, right.png and rig.yaml of the dome."""
    folder = tmp_path_factory.mktemp("dome")
    pair = SCENE.pair()
    cv2.imwrite(str(folder / "left.png"), pair.left)
    cv2.imwrite(str(folder / "right.png"), pair.right)
    ideal_rig().save(folder / "rig.yaml")
    return folder


def run(folder: Path, out: Path, left: str = "left.png", right: str = "right.png"):
    return reconstruct(folder / left, folder / right, folder / "rig.yaml", out, PerceptionConfig())


def test_depth_map_is_the_depth_in_metres_to_a_fifth_of_a_millimetre(folder, tmp_path):
    result = run(folder, tmp_path)
    depth = cv2.imread(str(tmp_path / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.float32
    assert depth.shape == (SCENE.height_px, SCENE.width_px)
    from_axis = np.linalg.norm(SCENE.points[..., :2] - SCENE.sphere_centre[:2], axis=-1)
    skin = result.breast.mask & (from_axis < 0.065)
    assert 1e3 * np.sqrt(np.mean((depth - SCENE.points[..., 2])[skin] ** 2)) < 0.2
    np.testing.assert_array_equal(np.isnan(depth), np.isnan(result.disparity))
    assert np.isnan(depth[:, :64]).all()


def test_cloud_on_disk_lies_on_the_sphere(folder, tmp_path):
    run(folder, tmp_path)
    cloud = trimesh.load(tmp_path / "cloud.ply")
    distance = (
        np.linalg.norm(np.asarray(cloud.vertices) - SCENE.sphere_centre, axis=-1)
        - SCENE.sphere_radius
    )
    assert 1e3 * np.sqrt(np.mean(distance**2)) < 0.2
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "cloud.ply",
        "config.json",
        "depth.tiff",
        "disparity.png",
    ]


def test_view_without_a_breast_gives_a_cloud_of_all_that_is_seen(folder, tmp_path):
    """The room of boards before a wall: each point lies at one of their depths, a pixel of
    disparity being 1 to 2 %.
    """
    room = edge_pair(width=640, height=448)
    cv2.imwrite(str(folder / "room_left.png"), room.left)
    cv2.imwrite(str(folder / "room_right.png"), room.right)
    view = run(folder, tmp_path, left="room_left.png", right="room_right.png")
    assert view.breast is None
    cloud = trimesh.load(tmp_path / "cloud.ply")
    assert len(cloud.vertices) > 10_000
    disparity = SCENE.focal_px * SCENE.baseline / np.asarray(cloud.vertices)[:, 2]
    known = room.disparity[room.seen_twice]
    assert known.min() - 1 < np.quantile(disparity, 0.01)
    assert np.quantile(disparity, 0.99) < known.max() + 1
    depth = cv2.imread(str(tmp_path / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    off = np.abs(SCENE.focal_px * SCENE.baseline / depth - room.disparity)[
        room.seen_twice & np.isfinite(depth)
    ]
    assert np.mean(off > 1) < 0.02


def test_two_unrelated_images_are_refused(folder, tmp_path):
    rng = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), rng.integers(0, 255, (448, 640)).astype(np.uint8))
    with pytest.raises(PerceptionError, match="nothing in the two images matches"):
        run(folder, tmp_path, left="a.png", right="b.png")


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_any_depth_and_colour_reads_as_the_same_grey(tmp_path, suffix, depth, channels):
    grey = SCENE.pair().left
    scale = 257 if depth == np.uint16 else 1
    image = np.repeat((grey.astype(int) * scale).astype(depth)[..., None], channels, axis=-1)
    path = tmp_path / f"image{suffix}"
    cv2.imwrite(str(path), image)
    assert np.abs(read_grey(path).astype(int) - grey).max() <= 1


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".jpg"])
@pytest.mark.parametrize("fraction", [0.0, 0.4, 0.98])
def test_cut_off_file_is_refused_by_name(tmp_path, suffix, fraction):
    path = tmp_path / f"image{suffix}"
    cv2.imwrite(str(path), SCENE.pair().left)
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    with pytest.raises(
        PerceptionError, match=f"image{suffix} is not an image, or is damaged.*copy it again"
    ):
        read_grey(path)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_a_camera_of_fewer_bits_than_its_file_is_read_in_its_own_range(tmp_path, bits):
    full = 2**bits - 1
    grey = np.linspace(0, full, 64).astype(np.uint16).reshape(8, 8)
    cv2.imwrite(str(tmp_path / "a.png"), grey)
    expected = grey.astype(float) * 255 / full
    assert np.abs(read_grey(tmp_path / "a.png") - expected).max() < 0.51


def test_what_lies_behind_a_jpegs_end_does_no_harm_and_a_preview_no_good(tmp_path):
    """A camera's notes of 5 kB behind the end; before the pixels a preview with an end of its own,
    which does not make a whole picture of one that was cut off.
    """
    whole = cv2.imencode(".jpg", SCENE.pair().left)[1].tobytes()
    preview = b"\xff\xd8\xff\xd9"
    with_preview = whole[:2] + b"\xff\xe1" + (len(preview) + 2).to_bytes(2, "big") + preview
    (tmp_path / "long.jpg").write_bytes(with_preview + whole[2:] + bytes(5000))
    np.testing.assert_array_equal(
        read_grey(tmp_path / "long.jpg"), cv2.imdecode(np.frombuffer(whole, np.uint8), 0)
    )
    (tmp_path / "cut.jpg").write_bytes((with_preview + whole[2:])[: len(whole) // 2])
    with pytest.raises(PerceptionError, match="damaged"):
        read_grey(tmp_path / "cut.jpg")


@pytest.mark.parametrize(
    ("image", "complaint"),
    [
        (np.zeros((448, 640), np.uint8), "other.png is black.*lens cap"),
        (np.full((448, 640), 255, np.uint8), "other.png is saturated.*expose shorter"),
        (np.full((448, 640), 90, np.uint8), "other.png has no texture.*pattern"),
        (SCENE.pair().right[:, :-10], "right image is 630x448 px.*calibrated for 640x448"),
    ],
)
def test_unusable_image_is_named_with_a_cure_and_nothing_is_written(
    folder, tmp_path, image, complaint
):
    cv2.imwrite(str(folder / "other.png"), image)
    out = tmp_path / "out"
    with pytest.raises(PerceptionError, match=complaint):
        run(folder, out, right="other.png")
    assert not out.exists() or not list(out.iterdir())


def test_a_pair_of_another_rig_is_refused_unless_told(folder, tmp_path):
    """The right camera's view hangs 9 px lower than its rig says."""
    pair = SCENE.pair()
    cv2.imwrite(str(folder / "lower.png"), np.roll(pair.right, 9, axis=0))
    with pytest.raises(PerceptionError, match=r"9\.0 px apart in height.*rig file"):
        run(folder, tmp_path, right="lower.png")
    assert not list(tmp_path.iterdir())
    files = (folder / name for name in ("left.png", "lower.png", "rig.yaml"))
    reconstruct(*files, out=tmp_path, accept=True)
    assert (tmp_path / "depth.tiff").is_file()


def test_a_view_of_which_hardly_anything_matches_is_refused_unless_told(folder, tmp_path):
    """Two pictures of noise that have a strip in common."""
    rng = np.random.default_rng(0)
    left, right = rng.integers(0, 255, (2, 448, 640)).astype(np.uint8)
    right[200:230, :-80] = left[200:230, 80:]
    for name, image in (("a.png", left), ("b.png", right)):
        cv2.imwrite(str(folder / name), image)
    with pytest.raises(PerceptionError, match="% of the view matches"):
        run(folder, tmp_path, left="a.png", right="b.png")


def test_what_was_matched_is_told(folder, tmp_path, capsys):
    run(folder, tmp_path)
    told = capsys.readouterr().out
    assert "% of the view matched" in told
    near, far = re.search(r"matched, ([0-9.]+) to ([0-9.]+) m away", told).groups()
    assert 0.3 < float(near) < float(far) < 1.0


def test_exchanged_images_are_recognised_and_nothing_is_written(folder, tmp_path):
    with pytest.raises(
        PerceptionError, match=r"left and the right image are exchanged.*exchange the two files"
    ):
        run(folder, tmp_path, left="right.png", right="left.png")
    assert not list(tmp_path.iterdir())
