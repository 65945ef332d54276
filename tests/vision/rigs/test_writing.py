import re

import numpy as np

from breastscan.vision.rigs.writing import write_camera_info
from tests.vision.board_shots import make_rig


def data(text, name):
    rows, columns, numbers = re.search(
        rf"^{name}:\n  rows: (\d+)\n  cols: (\d+)\n  data: \[(.*)\]$", text, re.M
    ).groups()
    return np.array(numbers.split(","), float).reshape(int(rows), int(columns))


def test_ros_reads_the_intrinsics_and_the_baseline(tmp_path):
    rig = make_rig()
    write_camera_info(tmp_path, rig)
    left, right = (
        (tmp_path / f"{side}_camera_info.yaml").read_text() for side in ("left", "right")
    )
    np.testing.assert_array_equal(data(left, "camera_matrix"), rig.left.K)
    np.testing.assert_array_equal(data(right, "distortion_coefficients")[0], rig.right.distortion)
    P_left, P_right = data(left, "projection_matrix"), data(right, "projection_matrix")
    assert P_left[0, 3] == 0
    np.testing.assert_allclose(-P_right[0, 3] / P_right[0, 0], rig.baseline, rtol=1e-12)
    np.testing.assert_allclose(P_left[:, :3], P_right[:, :3])
    R = data(left, "rectification_matrix")
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert "distortion_model: plumb_bob" in left
