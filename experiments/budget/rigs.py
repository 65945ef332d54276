"""Rigs put together from the errors of several calibrations.

A calibration finds lenses, relative pose and place one after the other, and each makes up for the
errors of those before it: at the breast it errs by .05 mm, but its lenses with the true pose by .3.
The parts of several calibrations make no rig. So a part counts as the error that its own step made:
the pose over that which exact measurements would give with its lenses, and the place likewise.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.vision.camera import Intrinsics, StereoRig

MEASURED_B = np.stack(
    np.meshgrid(np.linspace(0.42, 0.58, 9), np.linspace(-0.08, 0.08, 9), [0.08, 0.1, 0.12, 0.14]),
    axis=-1,
).reshape(-1, 3)
"""Points about the breast in B that an exact calibration sees [m]."""
REFINED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
"""When the search for a camera's pose ends."""


@dataclass(frozen=True)
class Poses:
    """Where two cameras stand."""

    X_RL: Float[np.ndarray, "4 4"]
    X_BL: Float[np.ndarray, "4 4"]


def composed(true: Path, intrinsics: Path, extrinsics: Path, hand_eye: Path) -> StereoRig:
    """The rig that would be found by the errors of three calibrations of the true one: `true` in
    place of one stands for no error.

    Args:
        true: File of the cameras as they are.
        intrinsics: Of the rig whose lenses are seen with.
        extrinsics: Of that with whose error the relative pose is found.
        hand_eye: Of that with whose error the place in the robot's base is found.

    Raises:
        CalibrationError: A file is no rig.
    """
    there, lenses, pose, place = map(StereoRig.load, (true, intrinsics, extrinsics, hand_eye))
    assert place.X_BL is not None, "a cell's cameras have their place"
    exact = exact_poses(there, lenses)
    dX_RR = pose.X_RL @ se3.inverse(exact_poses(there, pose).X_RL)
    dX_LL = se3.inverse(exact_poses(there, place).X_BL) @ place.X_BL
    return StereoRig(
        left=lenses.left, right=lenses.right, X_RL=dX_RR @ exact.X_RL, X_BL=exact.X_BL @ dX_LL
    )


def exact_poses(true: StereoRig, lenses: StereoRig) -> Poses:
    """Where the cameras would be found to stand by exact measurements, were their lenses as
    estimated.
    """
    assert true.X_BL is not None, "the twin's cameras have their place"
    X_LB = se3.inverse(true.X_BL)
    found_LB = _found(lenses.left, _projected(true.left, X_LB))
    found_RB = _found(lenses.right, _projected(true.right, true.X_RL @ X_LB))
    X_BL = se3.inverse(found_LB)
    return Poses(X_RL=found_RB @ X_BL, X_BL=X_BL)


def _projected(camera: Intrinsics, X_CB: Float[np.ndarray, "4 4"]) -> np.ndarray:
    turn = cv2.Rodrigues(X_CB[:3, :3])[0]
    return cv2.projectPoints(MEASURED_B, turn, X_CB[:3, 3], camera.K, camera.distortion)[0]


def _found(camera: Intrinsics, image: np.ndarray) -> Float[np.ndarray, "4 4"]:
    """The base in the camera that saw the points."""
    seen = (MEASURED_B, image, camera.K, camera.distortion)
    _, turn, shift = cv2.solvePnP(*seen)
    turn, shift = cv2.solvePnPRefineLM(*seen, turn, shift, REFINED)
    return se3.pose(cv2.Rodrigues(turn)[0], shift[:, 0])
