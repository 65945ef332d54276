"""The chest around a breast: a plane that falls away, or rises, with the square of the distance."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.plane import Plane

NEWTON_STEPS = 6
LEAST_SLOPE = 0.1
"""Of the equation for the closest point, 1 at the surface and 0 at its centre of curvature [-]."""


@dataclass(frozen=True, kw_only=True)
class Chest(Plane):
    """The points p with normal . p - offset + d . bend d / 2 = 0, d = p - middle.

    `normal` and `offset` are those of the plane that touches it in the middle. Heights count along
    the chest's own normals: they do not depend on where its middle is taken to be.
    """

    middle: Float[np.ndarray, "3"]
    """Middle of the breast's foot, on the chest [m]."""
    bend: Float[np.ndarray, "3 3"]
    """How fast it falls away from the plane; symmetric, without a part along the normal [1/m]."""

    def heights(self, p: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distances of points to the chest [m], positive above.

        The foot of p's perpendicular has the coordinates w_i / (1 + k_i t) along the principal
        axes, where p has w_i: t, the perpendicular's length over its normal's, is the root of a
        scalar equation. A point deeper than the centre of curvature gets a bound.
        """
        over_plane = super().heights(p)
        if self.is_flat:
            return over_plane
        curvatures, axes = self._principal
        along = (p - self.middle) @ axes
        falls = curvatures * along**2
        t = over_plane + falls.sum(axis=-1) / 2
        for _ in range(NEWTON_STEPS):
            slope = np.maximum(1 + curvatures * t[..., None], LEAST_SLOPE)
            error = t - over_plane - (falls / slope**2).sum(axis=-1) / 2
            t = t - error / (1 + (curvatures * falls / slope**3).sum(axis=-1))
        slope = np.maximum(1 + curvatures * t[..., None], LEAST_SLOPE)
        return t * np.sqrt(1 + (curvatures * falls / slope**2).sum(axis=-1))

    @property
    def is_flat(self) -> bool:
        """Whether it is a plane."""
        return not self.bend.any()

    @property
    def radius(self) -> float:
        """Smallest radius of curvature in the middle [m]; infinite if it is flat."""
        return np.inf if self.is_flat else 1 / float(np.abs(self._principal[0]).max())

    def seen_from(self, X_AB: Float[np.ndarray, "4 4"]) -> "Chest":
        """This chest of frame B, in frame A."""
        R_AB, plane = X_AB[:3, :3], super().seen_from(X_AB)
        return Chest(
            normal=plane.normal,
            offset=plane.offset,
            middle=se3.transform(X_AB, self.middle),
            bend=R_AB @ self.bend @ R_AB.T,
        )

    @cached_property
    def _principal(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "3 2"]]:
        """Curvatures [1/m] and directions across the normal."""
        values, axes = np.linalg.eigh(self.bend)
        across = np.argsort(np.abs(axes.T @ self.normal))[:2]
        return values[across], axes[:, across]
