import numpy as np
import pytest

from breastscan.errors import CalibrationError
from breastscan.geometry import calibration_file, kinematics
from breastscan.geometry.kinematic_calibration import KinematicCalibration

UR_YAML = """kinematics:
  shoulder:
    x: 0
    y: 0
    z: 0.1625
    roll: -0
    pitch: 0
    yaw: -0
  upper_arm:
    x: 0
    y: 0
    z: 0
    roll: 1.570796327
    pitch: 0
    yaw: -0
  forearm:
    x: -0.425
    y: 0
    z: 0
    roll: -0
    pitch: 0
    yaw: -0
  wrist_1:
    x: -0.3922
    y: 0
    z: 0.1333
    roll: -0
    pitch: 0
    yaw: -0
  wrist_2:
    x: 0
    y: -0.0997
    z: -2.044881182297852e-11
    roll: 1.570796327
    pitch: 0
    yaw: -0
  wrist_3:
    x: 0
    y: 0.0996
    z: -2.042830148012698e-11
    roll: 1.570796326589793
    pitch: 3.141592653589793
    yaw: 3.141592653589793
  hash: calib_12788084448423163542
"""
"""Layout of the file that ur_calibration writes, with the nominal UR5e's numbers."""
CORRECTIONS = {
    name: np.random.default_rng(seed).normal(0.0, 1e-3, 6)
    for seed, name in enumerate(("theta", "d", "a", "alpha"))
}


def random_joint_angles(count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-np.pi, np.pi, (count, 6))


def conf_text(values: dict[str, np.ndarray]) -> str:
    rows = [
        f"delta_{name} = [ {', '.join(f'{v:.17g}' for v in row)}]" for name, row in values.items()
    ]
    return "\n".join(
        ["[mounting]", *rows, "calibration_status = 0", "joint_checksum = [ 0x1, 0x2]", ""]
    )


def test_the_ros_drivers_yaml_of_a_nominal_arm_is_the_nominal_arm(tmp_path):
    path = tmp_path / "my_robot_calibration.yaml"
    path.write_text(UR_YAML)
    q = random_joint_angles(50)
    np.testing.assert_allclose(
        calibration_file.load(path).forward(q), kinematics.forward(q), atol=1e-8
    )


def test_the_controllers_file_gives_its_corrections(tmp_path):
    path = tmp_path / "calibration.conf"
    path.write_text(conf_text(CORRECTIONS))
    arm, q = KinematicCalibration.from_dh_corrections(**CORRECTIONS), random_joint_angles(20)
    np.testing.assert_array_equal(calibration_file.load(path).forward(q), arm.forward(q))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "shoulder has no number x"),
        ("kinematics: 3\n", "shoulder has no number x"),
        (UR_YAML.replace("z: 0.1625", "z: high"), "shoulder has no number z"),
        (UR_YAML.replace("x: -0.425", "x: -0.6127"), "of another arm"),
        (conf_text(CORRECTIONS).replace("delta_alpha", "delta_beta"), "delta_alpha"),
        (
            "[mounting]\ndelta_theta = [0, 0]\ndelta_d = [0]\ndelta_a = [0]\ndelta_alpha = [0]\n",
            "six finite numbers",
        ),
    ],
)
def test_a_file_that_is_no_calibration_says_what_is_wrong(tmp_path, text, why):
    path = tmp_path / "calibration"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=why):
        calibration_file.load(path)


UR3_YAML = UR_YAML
for ours, theirs in (
    ("0.1625", "0.1519"), ("-0.425", "-0.24365"), ("-0.3922", "-0.21325"), ("0.1333", "0.11235"),
    ("-0.0997", "-0.08535"), ("0.0996", "0.0819"),
):  # fmt: skip
    UR3_YAML = UR3_YAML.replace(ours, theirs)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (UR3_YAML, r"shoulder's height is 151\.9 mm, expected a UR5e's, 162\.5 mm within 10 mm"),
        (UR_YAML.replace("-0.425", "-0.24365"), r"upper arm is 243\.7 mm, expected .* 425\.0 mm"),
        (UR_YAML.replace("0.0996", "0.0819"), r"wrist 3 is 81\.9 mm"),
        (UR_YAML.replace("0.1333", "0.11235"), r"wrist 1 is 11\d\.\d mm"),
        (conf_text(CORRECTIONS | {"a": np.array([0, 0, 0.18, 0, 0, 0])}), r"forearm is 212\.\d mm"),
    ],
)
def test_the_file_of_another_model_is_refused_by_its_lengths(tmp_path, text, why):
    path = tmp_path / "calibration"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=why):
        calibration_file.load(path)


def test_offsets_along_parallel_axes_that_cancel_are_no_other_model(tmp_path):
    """As calibrations of real arms have them: metres, which the third axis takes back."""
    path = tmp_path / "calibration.conf"
    small = {name: np.zeros(6) for name in CORRECTIONS}
    path.write_text(conf_text(small | {"d": np.array([0, 5.0, -8.0, 3.0, 0, 0])}))
    q = random_joint_angles(5)
    np.testing.assert_allclose(
        calibration_file.load(path).forward(q), kinematics.forward(q), atol=1e-9
    )


def test_comments_and_document_markers_are_read_over(tmp_path):
    plain, commented = tmp_path / "plain", tmp_path / "commented"
    plain.write_text(UR_YAML)
    text = UR_YAML.replace("z: 0.1625", "z: 1.625e-01  # metres").replace("x: -0.425", "x: -425e-3")
    commented.write_text(f"%YAML 1.1\n# of ur_calibration\n---\n{text}...\n")
    q = random_joint_angles(5)
    np.testing.assert_array_equal(
        calibration_file.load(commented).forward(q), calibration_file.load(plain).forward(q)
    )
    plain.write_text(conf_text(CORRECTIONS))
    lines = conf_text(CORRECTIONS).splitlines()
    commented.write_text("# of the arm\n" + "\n".join(f"{line} # its own" for line in lines))
    np.testing.assert_array_equal(
        calibration_file.load(commented).forward(q), calibration_file.load(plain).forward(q)
    )


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CalibrationError, match="nowhere"):
        calibration_file.load(tmp_path / "nowhere.conf")
