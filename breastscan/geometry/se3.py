"""Rigid poses as 4x4 matrices, and the letters of every frame.

Monogram notation: `X_AB` is the pose of frame B in frame A, so `p_A = transform(X_AB, p_B)`,
`X_AC = X_AB @ X_BC`, and adjacent letters must match. A vector names its basis last: `n_B`.

| letter | frame | origin and axes |
|---|---|---|
| W | world | on the table top under the robot's base; z up |
| B | robot base | as Universal Robots define it, z up |
| D | a joint | as Denavit and Hartenberg place it, z along the next joint's axis |
| 6 | joint 6 | rotates with joint 6 |
| F | tool flange | z out of the flange |
| P | probe tip | centre of its face; z out of it into tissue, x along the array, y in elevation |
| Q | probe tip before its roll | that of P; z that of P |
| H | a hull of arm or tool | its centre; axes of its shape |
| M | mount and probe | their centre of mass; axes of P |
| T | tool centre point | as the controller is told; P where that is the probe tip |
| L, R | left and right camera | optical centre; OpenCV: x right, y down, z forward |
| C | a camera | L or R, or another that is named; axes of OpenCV |
| G | a camera in OpenGL | that of C; x right, y up, z backward |
| V | rectified left view | that of L; rows along the baseline |
| Board | calibration board | first inner corner; x along a row, y along a column, z into it |
| N | chart of the skin | middle of the breast's foot as seen; z along the chest's outward normal |
| S | phantom | centre of the breast's base on the chest plate; z along its outward normal |
| A | any frame | in what holds for all; B and C beside it likewise |

All functions are batched over leading axes. Lengths in metres, angles in radians.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


def pose(
    R: Float[np.ndarray, "*b 3 3"], p: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*b 4 4"]:
    """The pose with rotation `R` and translation `p` [m]."""
    X = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    X[..., :3, :3] = R
    X[..., :3, 3] = p
    X[..., 3, 3] = 1.0
    return X


def inverse(X_AB: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 4 4"]:
    """`X_BA`, by transposing the rotation (exact for rigid poses)."""
    R_BA = np.swapaxes(X_AB[..., :3, :3], -1, -2)
    return pose(R_BA, -np.einsum("...ij,...j->...i", R_BA, X_AB[..., :3, 3]))


def transform(
    X_AB: Float[np.ndarray, "4 4"], p_B: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3"]:
    """Points given in B, expressed in A [m]."""
    return p_B @ X_AB[:3, :3].T + X_AB[:3, 3]


def rotate(
    X_AB: Float[np.ndarray, "4 4"], v_B: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3"]:
    """Free vectors given in basis B, expressed in basis A."""
    return v_B @ X_AB[:3, :3].T


def from_rotation_vector(
    r: Float[np.ndarray, "*b 3"], p: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*b 4 4"]:
    """The pose with rotation vector `r` [rad] (axis times angle) and translation `p` [m]."""
    R = Rotation.from_rotvec(r.reshape(-1, 3)).as_matrix().reshape(*r.shape[:-1], 3, 3)
    return pose(R, p)


def rotation_vector(X_AB: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 3"]:
    """Rotation vector [rad] of each pose, of length pi at most."""
    R = X_AB[..., :3, :3]
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(*R.shape[:-2], 3)


def quaternion(X_AB: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4"]:
    """Unit quaternions (w x y z) of poses, each on its predecessor's side; NaN where the pose is.

    A quaternion and its negative are the same rotation: of the two the nearer to the row before
    is taken, so that smooth motions have smooth numbers.
    """
    q = np.full((len(X_AB), 4), np.nan)
    known = np.isfinite(X_AB).all(axis=(1, 2))
    if known.any():
        q[known] = Rotation.from_matrix(X_AB[known, :3, :3]).as_quat(scalar_first=True)
    turned = np.sum(q[known][1:] * q[known][:-1], axis=1) < 0
    q[known] *= np.cumprod(np.r_[1.0, np.where(turned, -1.0, 1.0)])[: known.sum(), None]
    return q


def from_quaternion(
    q: Float[np.ndarray, "n 4"], p: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 4 4"]:
    """The poses with quaternions `q` (w x y z), of any length but 0, and translations `p` [m]; NaN
    where either is.
    """
    X_AB = np.full((len(q), 4, 4), np.nan)
    known = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1)
    if known.any():
        R = Rotation.from_quat(q[known], scalar_first=True).as_matrix()
        X_AB[known] = pose(R, p[known])
    return X_AB


def pose_vector(X_AB: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 6"]:
    """Each pose as controllers write it: position [m], then rotation vector [rad]."""
    return np.concatenate([X_AB[..., :3, 3], rotation_vector(X_AB)], axis=-1)


def axes_along(n: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """A right-handed basis, in rows, whose third axis is the unit vector `n`."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(n))], n)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(n, x), n])


def across(
    v: Float[np.ndarray, "*b 3"], axis: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*b 3"]:
    """What of vectors goes across unit axes."""
    return v - np.sum(v * axis, axis=-1, keepdims=True) * axis


def angle_between(
    a: Float[np.ndarray, "*b 3"], b: Float[np.ndarray, "*b 3"]
) -> Float[np.ndarray, "*b"]:
    """Angle between vectors [rad], accurate near 0 and pi as well."""
    cross = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.arctan2(cross, np.sum(a * b, axis=-1)))
