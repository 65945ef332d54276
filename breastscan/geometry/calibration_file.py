"""What Universal Robots measured on one arm, as its files give it: the controller's, or the ROS
driver's.
"""

import configparser
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""Names of the joints' frames in the YAML file of Universal Robots' ROS driver (`ur_calibration`),
base first."""


def load(path: str | Path) -> KinematicCalibration:
    """Read the controller's `calibration.conf`, or the YAML of `ur_calibration`.

    Raises:
        CalibrationError: The file is missing, is neither, or belongs to another kind of arm.
    """
    path = Path(path)
    if not path.is_file():
        raise CalibrationError(
            f"no kinematic calibration at {path}: expected calibration.conf or ur_calibration's "
            "YAML",
            path,
        )
    text = path.read_text(encoding="utf-8", errors="replace")
    return _from_conf(text, path) if "delta_theta" in text else _from_yaml(text, path)


def _from_conf(text: str, path: Path) -> KinematicCalibration:
    """The controller's own file: corrections of the DH parameters as lists in a section
    [mounting].
    """
    parser = configparser.ConfigParser(inline_comment_prefixes=("#", ";"))
    try:
        parser.read_string(text)
        rows = {name: parser["mounting"][f"delta_{name}"] for name in ("theta", "d", "a", "alpha")}
        values = {name: np.array(json.loads(row), float) for name, row in rows.items()}
    except (configparser.Error, KeyError, ValueError, TypeError) as error:
        raise _not_a_calibration(path, str(error)) from error
    for name, row in values.items():
        if row.shape != (6,) or not np.isfinite(row).all():
            raise _not_a_calibration(
                path, f"delta_{name} must be six finite numbers, got {rows[name]}"
            )
    return KinematicCalibration.from_dh_corrections(**values)


def _from_yaml(text: str, path: Path) -> KinematicCalibration:
    """The ROS driver's file: each joint's frame as x, y, z [m] and roll, pitch, yaw [rad]; the
    last one is F.
    """
    try:
        root = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise _not_a_calibration(path, f"it cannot be parsed: {error}") from error
    frames = root.get("kinematics") if isinstance(root, dict) else None
    X_joints = np.stack([_frame(frames, name, path) for name in LINKS])
    return KinematicCalibration(X_joints=X_joints, X_6F=np.eye(4))


def _frame(frames: Any, name: str, path: Path) -> np.ndarray:
    numbers = []
    for key in ("x", "y", "z", "roll", "pitch", "yaw"):
        try:
            number = float(frames[name][key])  # YAML takes 1e-05 for a word
        except (KeyError, TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number):
            raise _not_a_calibration(path, f"{name} has no number {key}")
        numbers.append(number)
    return se3.pose(Rotation.from_euler("xyz", numbers[3:]).as_matrix(), np.array(numbers[:3]))


def _not_a_calibration(path: Path, reason: str) -> CalibrationError:
    return CalibrationError(
        f"{path} is not a kinematic calibration ({reason}): expected the controller's "
        "calibration.conf or the YAML file of ur_calibration",
        path,
    )
