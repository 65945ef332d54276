"""What hangs on the wrist sensor: the wrench of its weight and inertia, and how poses tell its
mass and centre.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError

GRAVITY_B = np.array([0.0, 0.0, -9.80665])
"""Standard gravity over a robot that stands upright [m/s^2]."""
MIN_POSES = 4
"""Static poses with which mass, centre and the sensor's zero can be told apart."""
MIN_SPREAD = 0.1
"""Least singular value, per pose, of the centred directions of gravity: about 20 degrees of tilt to
every side [-]."""


@dataclass(frozen=True, kw_only=True)
class Payload:
    """What hangs on the measuring side of the wrist sensor."""

    mass: float
    """[kg]"""
    centre_F: Float[np.ndarray, "3"]
    """Centre of mass in the flange's frame [m]."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """A payload found from what the sensor read in several poses at rest."""

    payload: Payload
    zero_F: Float[np.ndarray, "6"]
    """What the sensor reads without any load, force first [N, N m]."""
    force_rms: float
    """What the fit leaves of the force readings, RMS of a component [N]."""
    torque_rms: float
    """Of the torque readings [N m]."""


def load_map(payload: Payload, at_F: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 3"]:
    """The map from gravity less the centre's acceleration, in basis F [m/s^2], to the payload's
    wrench about `at_F`.

    The wrench is what the payload does to its sensor, force first [N, N m]. What its turning about
    its own centre takes is left out: a probe's moment of inertia makes a milli-newton-metre of it.
    """
    return payload.mass * np.vstack([np.eye(3), cross_matrix(payload.centre_F - at_F)])


def identify(
    wrenches_F: Float[np.ndarray, "n 6"],
    R_BF: Float[np.ndarray, "n 3 3"],
    at_F: Float[np.ndarray, "3"],
    gravity_B: Float[np.ndarray, "3"] = GRAVITY_B,
) -> Identified:
    """Mass, centre and the sensor's zero by least squares, from readings at rest with nothing
    touching.

    Args:
        wrenches_F: What the sensor read in each pose, averaged, force first [N, N m].
        R_BF: Orientation of the flange in each pose.
        at_F: The sensor's measuring point in the flange's frame [m].
        gravity_B: Gravity in the robot's base [m/s^2].

    Raises:
        CalibrationError: Too few poses, too little tilt between them, a reading that is not finite,
            or no positive mass.
    """
    if not np.isfinite(wrenches_F).all():
        raise CalibrationError(
            "a wrench reading is not finite: check the sensor's cable and power", wrenches_F
        )
    gravity_F = np.swapaxes(R_BF, 1, 2) @ gravity_B
    _check_poses(gravity_F)
    # unknown: mass, mass times the lever of the centre, zero of the force, zero of the torque
    A = np.zeros((len(gravity_F), 6, 10))
    A[:, :3, 0] = gravity_F
    A[:, 3:, 1:4] = -cross_matrix(gravity_F)
    A[:, :, 4:] = np.eye(6)
    found = np.linalg.lstsq(A.reshape(-1, 10), wrenches_F.ravel(), rcond=None)[0]
    if not found[0] > 0:
        raise CalibrationError(
            f"the readings fit a mass of {found[0]:.3f} kg: is the sensor mounted the other way "
            "round, or its sign turned?",
            found[0],
        )
    left = wrenches_F - A @ found
    force_rms, torque_rms = np.sqrt((left**2).mean(axis=0)).reshape(2, 3).mean(axis=1)
    payload = Payload(mass=float(found[0]), centre_F=at_F + found[1:4] / found[0])
    return Identified(
        payload=payload, zero_F=found[4:], force_rms=float(force_rms), torque_rms=float(torque_rms)
    )


def _check_poses(gravity_F: np.ndarray) -> None:
    if len(gravity_F) < MIN_POSES:
        raise CalibrationError(
            f"{len(gravity_F)} poses do not tell the payload from the sensor's zero: take "
            f"{MIN_POSES} or more",
            len(gravity_F),
        )
    directions = gravity_F / np.linalg.norm(gravity_F, axis=1, keepdims=True)
    spread = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False) / np.sqrt(
        len(directions)
    )
    if spread[1] < MIN_SPREAD:
        raise CalibrationError(
            f"the poses tilt the flange too little (spread {spread[1]:.2f}, expected "
            f"{MIN_SPREAD}): tilt it by 30 degrees or more to several sides",
            spread[1],
        )


def cross_matrix(v: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """The matrix whose product with a vector is the cross product of `v` with it."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape, 3)
