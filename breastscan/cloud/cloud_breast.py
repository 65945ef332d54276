"""The breast in a cloud in no order, and the chest that its heights count from.

The cloud is laid out as a camera would see it (`cloud.laid_out`), and what tells the breast from
its chest in a picture does so here (`cloud.segment`). Where the cloud ends with the breast, the
chest is the plane through its lower rim, if that is plane.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from breastscan.cloud import segment
from breastscan.cloud.chest_fit import fit_plane
from breastscan.cloud.laid_out import PIXEL, LaidOut
from breastscan.cloud.segment import LOWEST, Breast, NoBreast, SeenAround, SegmentConfig
from breastscan.cloud.skin_fit import FEWEST
from breastscan.errors import NoBreastError, PerceptionError
from breastscan.geometry import robust, se3
from breastscan.geometry.chest import Chest
from breastscan.geometry.plane import Plane

REACH = 1.3
"""Points farther from the robot's base than this are left out [m]: a UR5e reaches .85 m, its tool
and the body that it must keep clear of some more."""
LEAST_FACING = 0.2
"""Length of the mean of the normals below which they face no side [-]."""
VIEWS = 4
"""Directions from which a cloud is looked at, at most, each along the chest found before."""
SQUARE = np.radians(3.0)
"""Angle between chest and line of sight that ends it [rad]."""
COARSE = (1e-2, 5e-3, 2.5e-3)
FINE = segment.REFITS * (segment.REFINED_TOLERANCE,)
"""Largest distances of points from the chest that they support, fit by fit [m]."""
LEAST_RING = 0.2
"""Share of the ring around a breast that must be seen to lie on its chest [-]: a lower flank alone
fills less."""
SMALLEST_RADIUS = 0.08
"""A chest that bends more tightly than this is a flank [m]."""
SMOOTH = 0.9
"""Share of the cloud around a breast that must lie on its chest [-]: of 32 torsos with less, half
had loops that were off by more than 1 mm, of those with more none by more than 1 mm RMS."""
GROWTH_PX = 3
"""How far beyond its mask skin belongs to the breast [px]: the foot is rounded off."""
FILLED = 0.85
"""Share of a cloud that lies on the breast, where it ends with it [-]: with a chest around, at most
half does."""
SECTORS = 36
"""Around a breast without a chest: the lowest point of each is its rim."""
RIM_FITS = 4
"""How often the plane of the rim is found, each time with the lowest points over that before."""
RIM_OUT = 0.7
"""Usual distance of a rim from its middle, over the radius of a circle as large as the cloud [-]:
less, and the cloud is a hollow, as with normals that point inwards."""
RIM_DEVIATION = 7e-4
"""Largest standard deviation of a rim from its plane [m]: the loop is then off by half of that."""


@dataclass(frozen=True, kw_only=True)
class CloudBreast:
    """Which of a cloud's points are the breast's skin, and what it stands on."""

    skin: Bool[np.ndarray, "n"]
    chest: Plane
    """In the cloud's frame; above it is outwards."""
    by_rim: bool = False
    """Whether the chest is but the plane through the skin's lower rim."""


def breast_in(
    points_B: Float[np.ndarray, "n 3"], normals_B: Float[np.ndarray, "n 3"]
) -> CloudBreast:
    """The one breast in a cloud, on the smooth chest around its foot.

    Args:
        points_B: On skin and chest, and on whatever else is near, in B [m].
        normals_B: Their outward unit normals.

    Raises:
        PerceptionError: There is no breast, more than one, or too little of its chest.
    """
    near_B, axis_B = _near(points_B, normals_B)
    view, found, others = _looked_at(near_B, axis_B)
    _require_one([se3.transform(view.X_AC, _middle(view, breast.mask)) for breast in found])
    for breast in found:
        chest, seen = _chest(breast, view)
        enough = LEAST_RING * np.count_nonzero(breast.ring)
        if seen.pixels > enough and chest.radius > SMALLEST_RADIUS:
            _require_all_round(chest, seen, view)
            chest_B = chest.seen_from(view.X_AC)
            return CloudBreast(skin=_skin(points_B, breast.mask, view, chest_B), chest=chest_B)
    rejected = [(other.what, se3.transform(view.X_AC, other.place)) for other in others]
    return _by_rim(points_B, near_B, axis_B, rejected)


def breast_over(points_B: Float[np.ndarray, "n 3"], plate: Plane) -> CloudBreast:
    """The one breast in a cloud over a plate that is given: the largest object above it.

    Raises:
        PerceptionError: Nothing rises above the plate, or two breasts do.
    """
    _require_some(points_B)
    view = LaidOut.along(plate.normal, points_B)
    masks = _above(view, plate)
    if not masks:
        raise NoBreastError(
            "nothing of the cloud rises above the chest plate that is given, its points lie "
            f"{1e3 * plate.heights(points_B).max():.0f} mm over it at most: give a lower plate",
            plate,
        )
    _require_one([se3.transform(view.X_AC, _middle(view, mask)) for mask in masks])
    return CloudBreast(skin=_skin(points_B, masks[0], view, plate), chest=plate)


def _near(
    points_B: Float[np.ndarray, "n 3"], normals_B: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "3"]]:
    """The points within the robot's reach, and the side that they face."""
    distance = np.linalg.norm(points_B, axis=1)
    near = distance < REACH
    if not near.any():
        raise PerceptionError(
            f"expected points within {REACH} m of the robot's base, the nearest of the "
            f"{len(points_B)} in the cloud is {distance.min():.3g} m away: give them in metres, in "
            "the base's frame",
            float(distance.min()),
        )
    _require_some(points_B[near])
    mean = normals_B[near].mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < LEAST_FACING:
        raise PerceptionError(
            f"expected normals that face one side, their mean has a length of {length:.2f}: let "
            "all point outwards, and leave the side of the body out that carries no breast",
            length,
        )
    return points_B[near], mean / length


def _require_some(points_B: Float[np.ndarray, "n 3"]) -> None:
    if len(points_B) < FEWEST:
        raise PerceptionError(
            f"expected {FEWEST} points or more, got {len(points_B)}: give a denser cloud",
            len(points_B),
        )


def _looked_at(
    points_B: Float[np.ndarray, "n 3"], axis_B: Float[np.ndarray, "3"]
) -> tuple[LaidOut, list[Breast], list[NoBreast]]:
    """The cloud as seen squarely to the chest, the breasts in it and whatever else."""
    config = SegmentConfig()
    view = LaidOut.along(axis_B, points_B)
    found, others = segment.breasts_in(view.points, config)
    for _ in range(VIEWS - 1 if found else 0):
        chest, _ = _chest(found[0], view)
        normal_B = se3.rotate(view.X_AC, chest.normal)
        if len(found) > 1 or se3.angle_between(normal_B, axis_B) < SQUARE:
            break
        axis_B = normal_B
        closer = LaidOut.along(axis_B, points_B)
        again, _ = segment.breasts_in(closer.points, config)
        if not again:
            break
        view, found = closer, again
    return view, found, others


def _chest(breast: Breast, view: LaidOut) -> tuple[Chest, SeenAround]:
    """The chest around a breast, from what was found near its foot or from all that is around it,
    whichever more of that lies on.
    """
    near, all_around = (
        segment.chest_around(breast, view.points, (*first, *FINE)) for first in ((), COARSE)
    )
    return max(near, all_around, key=lambda found: found[1].share)


def _skin(
    points_B: Float[np.ndarray, "n 3"],
    mask: Bool[np.ndarray, "h w"],
    view: LaidOut,
    chest_B: Plane,
) -> Bool[np.ndarray, "n"]:
    """Which points belong to the breast that a mask covers."""
    grown = cv2.dilate(mask.astype(np.uint8), segment.CROSS, iterations=GROWTH_PX) > 0
    return view.inside(grown, points_B) & (chest_B.heights(points_B) > LOWEST)


def _middle(view: LaidOut, mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "3"]:
    return np.nanmean(view.points[mask], axis=0)


def _above(view: LaidOut, plate_B: Plane) -> list[Bool[np.ndarray, "h w"]]:
    """What rises above a plate and is as wide as a breast, the largest first; the largest object in
    any case.
    """
    config = SegmentConfig()
    X_CA = se3.inverse(view.X_AC)
    masks = segment.regions_above(plate_B.seen_from(X_CA).heights(view.points), config)
    least_px = np.pi / 4 * (config.width_range[0] / PIXEL) ** 2
    return [mask for k, mask in enumerate(masks) if k == 0 or np.count_nonzero(mask) > least_px]


def _require_one(places_B: list[Float[np.ndarray, "3"]]) -> None:
    """Refuse to choose among several breasts."""
    if len(places_B) > 1:
        raise NoBreastError(
            f"expected one breast in the cloud, found {len(places_B)} (near "
            f"{', '.join(_told(place) for place in places_B)} mm in B): leave in the cloud the one "
            "to be scanned and the chest around it",
            places_B,
        )


def _require_all_round(chest: Chest, seen: SeenAround, view: LaidOut) -> None:
    """Refuse a chest that is not smooth, or of which a side is missing that it takes to know it."""
    if seen.share < SMOOTH:
        raise NoBreastError(
            f"only {seen.share:.0%} of the cloud around the breast lies within "
            f"{2e3 * segment.REFINED_TOLERANCE:.0f} mm of one smooth chest, {SMOOTH:.0%} must, as "
            "heights count from there: leave what is no chest out of the cloud, or give the chest "
            "plate's height",
            seen.share,
        )
    if seen.gap > segment.largest_gap(chest):
        aside = np.array([np.cos(seen.azimuth), np.sin(seen.azimuth), 0.0])
        towards_B = se3.rotate(view.X_AC, aside)
        raise NoBreastError(
            f"the cloud holds no chest over {np.degrees(seen.gap):.0f} degrees around the breast, "
            f"towards {np.round(towards_B, 1).tolist()} in B, and heights count from there: let "
            "it hold the chest on that side, or give the chest plate's height",
            seen.gap,
        )


def _by_rim(
    points_B: Float[np.ndarray, "n 3"],
    near_B: Float[np.ndarray, "m 3"],
    axis_B: Float[np.ndarray, "3"],
    others: list[tuple[str, Float[np.ndarray, "3"]]],
) -> CloudBreast:
    """The breast that a cloud ends with, on the plane through its lower rim.

    Raises:
        NoBreastError: The cloud is something else, or the rim is no plane.
    """
    plane, rim_B, deviation = _rim(near_B, axis_B)
    view = LaidOut.along(plane.normal, near_B)
    masks = _above(view, plane)
    covered = np.count_nonzero(np.isfinite(view.points[..., 2]))
    outermost = RIM_OUT * PIXEL * np.sqrt(covered / np.pi)
    inside = np.median(np.linalg.norm(rim_B - rim_B.mean(axis=0), axis=1)) < outermost
    if inside or len(masks) != 1 or np.count_nonzero(masks[0]) < FILLED * covered:
        raise _nothing_like_a_breast(others, "")
    if deviation > RIM_DEVIATION:
        rim = (
            f"; nor can heights count from the cloud's own rim, which is off a plane by "
            f"{1e3 * deviation:.1f} mm (standard deviation), {1e3 * RIM_DEVIATION:.1f} mm at most"
        )
        raise _nothing_like_a_breast(others, rim)
    return CloudBreast(skin=_skin(points_B, masks[0], view, plane), chest=plane, by_rim=True)


def _rim(
    points_B: Float[np.ndarray, "n 3"], axis_B: Float[np.ndarray, "3"]
) -> tuple[Chest, Float[np.ndarray, "s 3"], float]:
    """The plane through the lowest points all around, these, and how far they lie from it [m]."""
    middle_B = points_B.mean(axis=0)
    tolerance = SegmentConfig().plane_tolerance
    rim_B = _lowest(points_B, middle_B, axis_B)
    plane = fit_plane(rim_B, rim_B.mean(axis=0), axis_B, tolerance)
    for _ in range(RIM_FITS):
        rim_B = _lowest(points_B, middle_B, plane.normal)
        plane = fit_plane(rim_B, plane.middle, plane.normal, tolerance)
    return plane, rim_B, robust.deviation(plane.heights(rim_B))


def _lowest(
    points_B: Float[np.ndarray, "n 3"],
    middle_B: Float[np.ndarray, "3"],
    axis_B: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "s 3"]:
    """The lowest point of each sector about an axis."""
    x, y, z = se3.axes_along(axis_B) @ (points_B - middle_B).T
    sector = np.floor(np.arctan2(y, x) * SECTORS / (2 * np.pi)).astype(int)
    order = np.argsort(z, kind="stable")
    return points_B[order[np.unique(sector[order], return_index=True)[1]]]


def _nothing_like_a_breast(
    others: list[tuple[str, Float[np.ndarray, "3"]]], rim: str
) -> NoBreastError:
    low, high = (1e3 * width for width in SegmentConfig().width_range)
    found = [f"{what} (near {_told(place_B)} mm in B)" for what, place_B in others]
    return NoBreastError(
        f"expected a breast {low:.0f} to {high:.0f} mm wide on a chest, found "
        f"{', '.join(found[: segment.LISTED]) or 'nothing that stands on a chest'}{rim}: let the "
        "cloud hold the breast and the chest around it, its normals outwards, or give the chest "
        "plate's height",
        others,
    )


def _told(place_B: Float[np.ndarray, "3"]) -> str:
    """A place in whole millimetres."""
    return str(np.round(1e3 * place_B).astype(int).tolist())
