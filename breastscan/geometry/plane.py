"""A plane, as the chest plate under the breast is one."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3


@dataclass(frozen=True, kw_only=True)
class Plane:
    """The points p with normal . p = offset, all in one frame."""

    normal: Float[np.ndarray, "3"]
    """Unit normal, towards the side that counts as above."""
    offset: float
    """Signed distance of the plane from the frame's origin along the normal [m]."""

    def heights(self, p: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Heights of points above the plane [m]."""
        return p @ self.normal - self.offset

    def seen_from(self, X_AB: Float[np.ndarray, "4 4"]) -> "Plane":
        """This plane of frame B, in frame A."""
        normal_A = se3.rotate(X_AB, self.normal)
        return Plane(normal=normal_A, offset=self.offset + float(normal_A @ X_AB[:3, 3]))
