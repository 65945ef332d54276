"""Rig files as each tool writes them: one rig, in the words of all."""

import gzip
import json
from contextlib import suppress

import cv2
import numpy as np
import pytest
import scipy.io

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.camera import StereoRig
from tests.vision.test_camera import toed_in_rig

RIG = toed_in_rig()
R, T = RIG.X_RL[:3, :3], RIG.X_RL[:3, 3]
K1, K2 = RIG.left.K, RIG.right.K
D1, D2 = RIG.left.distortion, RIG.right.distortion
SIZE = (320, 240)
FROM_1 = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
"""Of pixels that are counted from 1."""
MIRRORED = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
OFF_CENTRE = np.array([[0.0, 0.0, 400.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def storage(path, **values):
    """As cv2.FileStorage writes it: YAML, XML, JSON, packed or not."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


def opencv(folder, name="stereo.yml", **changes):
    values = {
        "K1": K1, "D1": D1[None], "K2": K2, "D2": D2[None], "R": R.copy(), "T": T[:, None].copy(),
        "image_width": 320, "image_height": 240,
    }  # fmt: skip
    return [storage(folder / name, **values | changes)]


def opencv_in_two(folder):
    """As OpenCV's own stereo_calib sample leaves them, with the size added."""
    intrinsics = storage(
        folder / "intrinsics.yml", M1=K1, D1=D1[None], M2=K2, D2=D2[None],
        image_Width=320, image_Height=240,
    )  # fmt: skip
    return [
        intrinsics,
        storage(folder / "extrinsics.yml", R=R.copy(), T=T[:, None].copy(), Q=np.eye(4)),
    ]


def lists(folder):
    """As people dump them from Python."""
    values = {
        "cameraMatrix1": K1.tolist(), "distCoeffs1": D1.tolist(), "cameraMatrix2": K2.tolist(),
        "distCoeffs2": [D2.tolist()], "R": R.tolist(), "T": T.tolist(), "image_size": list(SIZE),
    }  # fmt: skip
    (folder / "rig.json").write_text(json.dumps(values))
    return [folder / "rig.json"]


def rotation_vector(folder):
    values = {
        "mtxL": K1, "distL": D1, "mtxR": K2, "distR": D2, "rvec": cv2.Rodrigues(R)[0], "tvec": T,
        "imageSize": np.array(SIZE),
    }  # fmt: skip
    np.savez(folder / "rig.npz", **values)
    return [folder / "rig.npz"]


def packed(folder):
    (plain,) = opencv(folder, "stereo.json")
    (folder / "stereo.json.gz").write_bytes(gzip.compress(plain.read_bytes()))
    return [folder / "stereo.json.gz"]


def yaml_matrix(name, value):
    rows, columns = np.atleast_2d(value).shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: {np.ravel(value).tolist()}\n"


def ros_parts():
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K1, D1, K2, D2, SIZE, R, T, alpha=0)
    return {"left": (K1, D1, R1, P1), "right": (K2, D2, R2, P2)}


def ros(folder):
    """As camera_calibration's `cameracalibrator` saves them; the right one first."""
    for side, (K, D, R_rect, P) in ros_parts().items():
        (folder / f"{side}.yaml").write_text(
            f"image_width: 320\nimage_height: 240\ncamera_name: narrow/{side}\n"
            + yaml_matrix("camera_matrix", K)
            + "distortion_model: plumb_bob\n"
            + yaml_matrix("distortion_coefficients", D)
            + yaml_matrix("rectification_matrix", R_rect)
            + yaml_matrix("projection_matrix", P)
        )
    return [folder / "right.yaml", folder / "left.yaml"]


def ros_messages(folder):
    """As `ros2 topic echo --once` prints them; the right one lies beside."""
    for side, (K, D, R_rect, P) in ros_parts().items():
        rows = {"d": D, "k": K, "r": R_rect, "p": P}
        text = "header:\n  frame_id: cam\nheight: 240\nwidth: 320\ndistortion_model: plumb_bob\n"
        for name, value in rows.items():
            text += f"{name}:\n" + "".join(f"- {number!r}\n" for number in np.ravel(value).tolist())
        (folder / f"{side}_info.yaml").write_text(text + "binning_x: 0\n---\n")
    return [folder / "left_info.yaml"]


def kalibr(folder):
    text = ""
    for k, (K, D) in enumerate(((K1, D1), (K2, D2))):
        pinhole = [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
        text += f"cam{k}:\n  camera_model: pinhole\n  intrinsics: {np.array(pinhole).tolist()}\n"
        text += f"  distortion_model: radtan\n  distortion_coeffs: {D[:4].tolist()}\n"
        text += "  resolution: [320, 240]\n  rostopic: /cam/image_raw\n"
        if k:
            rows = RIG.X_RL.tolist()
            text += "  T_cn_cnm1:\n" + "".join(f"  - {row}\n" for row in rows)
    (folder / "camchain.yaml").write_text(text)
    return [folder / "camchain.yaml"]


def matlab_camera(K, D):
    return {
        "RadialDistortion": D[[0, 1, 4]], "TangentialDistortion": D[[2, 3]], "Skew": 0.0,
        "ImageSize": np.array([240.0, 320.0]), "WorldUnits": "millimeters",
        "IntrinsicMatrix": (K + FROM_1).T,
    }  # fmt: skip


def matlab(folder):
    """As `toStruct(stereoParams)` gives them up to R2021b: for row vectors, pixels from 1, mm."""
    struct = {
        "CameraParameters1": matlab_camera(K1, D1), "CameraParameters2": matlab_camera(K2, D2),
        "RotationOfCamera2": R.T, "TranslationOfCamera2": 1e3 * T, "Version": "1",
    }  # fmt: skip
    scipy.io.savemat(folder / "rig.mat", {"s": struct})
    return [folder / "rig.mat"]


def matlab_json(folder):
    """As `jsonencode(toStruct(stereoParams))` gives them since R2022b."""
    cameras = {}
    for k, (K, D) in enumerate(((K1, D1), (K2, D2)), 1):
        camera = {
            n: v.tolist() if isinstance(v, np.ndarray) else v
            for n, v in matlab_camera(K, D).items()
        }
        camera["K"] = np.transpose(camera.pop("IntrinsicMatrix")).tolist()
        cameras[f"CameraParameters{k}"] = camera
    pose = {"Translation": (1e3 * T).tolist(), "R": R.tolist(), "Dimensionality": 3}
    (folder / "rig.json").write_text(json.dumps({**cameras, "PoseCamera2": pose}))
    return [folder / "rig.json"]


FILES = [
    opencv,
    lambda folder: opencv(folder, "stereo.xml"),
    lambda folder: opencv(folder, "stereo.json"),
    lambda folder: opencv(folder, "stereo.xml.gz"),
    opencv_in_two, lists, rotation_vector, packed, ros, ros_messages, matlab, matlab_json,
]  # fmt: skip


@pytest.mark.parametrize("written", FILES)
def test_a_rig_is_the_same_whoever_wrote_it(tmp_path, written):
    rig = StereoRig.load(*written(tmp_path))
    np.testing.assert_allclose(rig.X_RL, RIG.X_RL, atol=1e-12)
    for read, true in ((rig.left, RIG.left), (rig.right, RIG.right)):
        np.testing.assert_allclose(read.K, true.K, atol=1e-12)
        np.testing.assert_allclose(read.distortion, true.distortion, atol=1e-12)
        assert (read.width, read.height) == SIZE


def test_a_camera_chain_has_lenses_of_four_coefficients(tmp_path):
    rig = StereoRig.load(*kalibr(tmp_path))
    np.testing.assert_allclose(rig.X_RL, RIG.X_RL, atol=1e-12)
    np.testing.assert_allclose(rig.left.distortion, [*D1[:4], 0.0], atol=1e-12)
    np.testing.assert_allclose(rig.right.K, K2, atol=1e-12)


def test_a_rectified_set_is_in_millimetres(tmp_path):
    (tmp_path / "calib.txt").write_text(
        "cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]\n"
        "cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]\n"
        "doffs=131.111\nbaseline=193.001\nwidth=2964\nheight=1988\nndisp=280\nisint=0\n"
    )
    rig = StereoRig.load(tmp_path / "calib.txt")
    np.testing.assert_allclose(rig.X_RL, se3.pose(np.eye(3), np.array([-0.193001, 0, 0])))
    assert rig.right.K[0, 2] - rig.left.K[0, 2] == pytest.approx(131.111)
    assert (rig.left.width, rig.left.height) == (2964, 1988)


def test_single_precision_makes_a_proper_rotation(tmp_path):
    rig = StereoRig.load(*opencv(tmp_path, R=R.astype(np.float32), K1=K1.astype(np.float32)))
    np.testing.assert_allclose(rig.X_RL[:3, :3] @ rig.X_RL[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(rig.X_RL, RIG.X_RL, atol=1e-6)


@pytest.mark.parametrize("count", [8, 12, 14])
def test_a_lens_of_many_coefficients_is_kept_and_rectified_with(tmp_path, count):
    D = np.array([0.3, 0.1, 1e-3, -2e-3, 0.02, 0.5, 0.2, 0.03, *np.full(6, 1e-3)])[:count]
    rig = StereoRig.load(*opencv(tmp_path, D1=D[None], D2=D[None]))
    np.testing.assert_array_equal(rig.left.distortion, D)
    rig.save(tmp_path / "ours.yaml")
    np.testing.assert_array_equal(StereoRig.load(tmp_path / "ours.yaml").right.distortion, D)
    point = np.array([[0.03, -0.02, 0.5]])
    images = []
    for camera, X in ((rig.left, np.eye(4)), (rig.right, rig.X_RL)):
        seen = cv2.projectPoints(se3.transform(X, point), np.zeros(3), np.zeros(3), camera.K, D)[0]
        rows, columns = np.mgrid[:240, :320]
        x, y = seen.ravel()
        spot = 200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 8.0)
        images.append(np.rint(spot).astype(np.uint8))
    pair = rig.rectify(*images)
    row_of = [
        np.average(np.arange(240), weights=view.sum(axis=1)) for view in (pair.left, pair.right)
    ]
    assert abs(row_of[0] - row_of[1]) < 0.1


def test_lengths_in_millimetres_are_named_and_taken_when_told(tmp_path):
    files = opencv(tmp_path, T=1e3 * T[:, None])
    with pytest.raises(CalibrationError, match=r"baseline is 98\.99 m.*--unit mm"):
        StereoRig.load(*files)
    np.testing.assert_allclose(StereoRig.load(*files, unit=1e-3).X_RL, RIG.X_RL, atol=1e-12)


REFUSED = {
    "transposed matrix": ({"K1": K1.T.copy()}, "row 0 0 1: is it transposed"),
    "negative focal length": ({"K2": K2 * MIRRORED}, "focal lengths of -343"),
    "centre outside": ({"K1": K1 + OFF_CENTRE}, "lies outside of"),
    "inverted": ({"T": -T[:, None]}, "exchanged, or R and T.*inverted, or.*upside down"),
    "vertical": ({"T": np.array([[0.001], [-0.1], [0.0]])}, "above or below the left one"),
    "mirrored": ({"R": R @ np.diag([1.0, 1.0, -1.0])}, "the rotation of X_RL"),
    "count": ({"D1": np.zeros((1, 6))}, "6 coefficients, and lenses have 4, 5, 8, 12, 14"),
    "no number": ({"T": np.full((3, 1), np.nan)}, "T holds a number that is not finite"),
    "one place": ({"T": np.zeros((3, 1))}, "baseline is below 1 mm"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "reason"), REFUSED.values(), ids=REFUSED)
def test_what_no_rig_can_be_is_refused_with_the_reason(tmp_path, changes, reason):
    with pytest.raises(CalibrationError, match=reason):
        StereoRig.load(*opencv(tmp_path, **changes))


def test_what_is_missing_is_named(tmp_path):
    intrinsics, _ = opencv_in_two(tmp_path)
    with pytest.raises(CalibrationError, match="R and T, are missing: give the file of the extr"):
        StereoRig.load(intrinsics)
    left = ros(tmp_path)[1].rename(tmp_path / "alone.yaml")
    with pytest.raises(CalibrationError, match="1 camera_info given, and a rig takes two"):
        StereoRig.load(left)
    bare = storage(tmp_path / "bare.yml", K1=K1, D1=D1, K2=K2, D2=D2, R=R.copy(), T=T.copy())
    with pytest.raises(CalibrationError, match="the size of the pictures is missing"):
        StereoRig.load(bare)


def test_lenses_that_are_not_known_are_named(tmp_path):
    (chain,) = kalibr(tmp_path)
    text = chain.read_text()
    chain.write_text(text.replace("radtan", "equidistant"))
    with pytest.raises(CalibrationError, match="the left camera has an equidistant"):
        StereoRig.load(chain)
    chain.write_text(text.replace("pinhole", "omni"))
    with pytest.raises(CalibrationError, match="cam0 is omni-radtan"):
        StereoRig.load(chain)


def test_an_object_of_matlabs_own_is_refused_with_the_command_that_makes_a_struct(tmp_path):
    scipy.io.savemat(tmp_path / "rig.mat", {"stereoParams": np.zeros((1, 6), np.uint32)})
    with pytest.raises(CalibrationError, match=r"s = toStruct\(stereoParams\)"):
        StereoRig.load(tmp_path / "rig.mat")


@pytest.mark.parametrize("written", [*FILES, kalibr])
def test_mutated_files_end_in_the_products_own_error(tmp_path, written):
    rng = np.random.default_rng(5)
    files = written(tmp_path)
    data = files[0].read_bytes()
    for _ in range(60):
        mutated = bytearray(data)
        for _ in range(rng.integers(1, 6)):
            place = rng.integers(len(mutated))
            match rng.integers(3):
                case 0:
                    mutated[place] = rng.integers(256)
                case 1:
                    del mutated[place : place + rng.integers(1, 40)]
                case _:
                    mutated[place:place] = mutated[: rng.integers(1, 30)]
            if not mutated:
                break
        files[0].write_bytes(mutated)
        with suppress(CalibrationError):
            StereoRig.load(*files)
