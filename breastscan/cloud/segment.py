"""Tell the breast from the chest it stands on, the table below and whatever else is in view.

Planes are sought from the most to the least extended, and bent where more points then lie on them:
the table comes first, the chest after it. A breast is a connected bump of plausible size that rises
without a step, which a chest above a table does not, from a chest that goes on around it, which a
cut through the breast itself does not. The chest around its foot is what its heights count from.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_fill_holes

from breastscan.checks import require_positive, require_seed
from breastscan.cloud.chest_fit import fit_chest, lie_as_well
from breastscan.errors import ConfigError, NoBreastError
from breastscan.geometry.chest import Chest
from breastscan.geometry.plane import Plane

PLANE_SAMPLE = 50_000
"""Points that the planes are sought in: a plate on a tenth of them is known to some micrometres."""
PROPOSALS = 300
"""Planes proposed at a time: one that holds a third of the points is missed once in 80 000
times."""
JURY = 3000
"""Points that judge the proposals."""
CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
EDGE_PX = 2
"""How far from its core a bump may grow to its foot [px]."""
RING_WIDTH = 0.25
"""Width of the ring around a bump that must be chest, as a fraction of the bump's own."""
FIT_WIDTH = 0.4
"""Width of the ring that the chest is fitted to, as a fraction of the bump's own."""
FIT_POINTS = 6000
"""Points of it that are."""
REFINED_TOLERANCE = 5e-4
"""Largest distance of a refined point from the chest that it supports [m]."""
LOWEST = 5e-4
"""Height over the chest below which refined points of skin are not told from it [m]."""
FIT_DEPTH = 4.0
"""Points of the ring farther from the chest so far than so many times the tolerance are left
out."""
SMALLEST_RING_PX = 500
"""Pixels of the chest around a breast that must be seen."""
LARGEST_GAP_FLAT, LARGEST_GAP_BENT = np.radians(240.0), np.radians(120.0)
"""Angles around a breast over which a flat and a bent chest need not be seen [rad]."""
SIDES = (
    "right", "lower right", "lower side", "lower left", "left", "upper left", "upper side",
    "upper right",
)  # fmt: skip
"""Of a picture, clockwise from the right."""
SETTLINGS = 6
"""How often bump and chest around it are found anew, at most."""
LEEWAY = 1.5
"""Factor by which a bump may be too small or too wide for its foot to be looked for."""
REFITS = 3
"""How often the chest is fitted to refined points, each time to those near the one before."""
SETTLED = 0.002
"""Change of the bump's pixels that ends it [-]."""
GROWTHS = 8
"""How often a plane is bent to the points that then lie on it."""
GROWN = 1.15
"""Points that a bent plane must hold, over those that it holds flat [-]."""
BUMPS = 5
"""Objects on one plane that are looked at, the largest in the image first."""
SMALLEST_PX = 2000
"""An object seen by fewer pixels, some 50 across, cannot be measured, whatever it is."""
SEEN_RIM = 0.2
"""Share of a breast's rim that must be seen down to the plane: of 200 drawn breasts at least a
quarter is, of a plate above a table nothing."""
LISTED = 3
"""Objects that an error names, the most extended planes' first."""


@dataclass(frozen=True, kw_only=True)
class SegmentConfig:
    """What counts as plane, as breast and as noise."""

    cut_height: float = 2.5e-3
    """Skin lower than this over the plate is left out [m]: below it plate and skin cannot be told
    apart."""
    plane_tolerance: float = 2.5e-3
    """Largest distance of a point from the plane or chest it supports [m]."""
    width_range: tuple[float, float] = (0.06, 0.25)
    """Plausible diameters of the breast's base [m], as a circle of equal area."""
    height_range: tuple[float, float] = (0.01, 0.12)
    """Plausible heights of the breast over the plate [m]."""
    step_height: float = 0.02
    """The rim of a bump that rises from its plane lies lower than this [m]; a fifth of it must: on
    other sides the flank may be too steep to be seen."""
    planes: int = 4
    """Number of planes to look for before giving up."""
    seed: int = 0
    """Of the random choice of points that propose a plane."""

    def __post_init__(self) -> None:
        require_positive(self, "perception.segment", but=("seed",))
        require_seed(self.seed, "perception.segment.seed")
        for name in ("width_range", "height_range"):
            low, high = getattr(self, name)
            if not 0 < low < high:
                option = f"perception.segment.{name}"
                raise ConfigError(
                    f"{option} must be two rising lengths [m], got {(low, high)}", (low, high)
                )


@dataclass(frozen=True, kw_only=True)
class Breast:
    """Where in the image the breast is, and what it stands on."""

    mask: Bool[np.ndarray, "h w"]
    """Pixels that see the breast; pixels without a point that it surrounds are included."""
    plate: Chest
    """The chest in L, above it is towards the camera."""
    width: float
    """Diameter of a circle with the area of its base [m]."""
    height: float
    """Height of its top over the chest [m]."""

    @property
    def ring(self) -> Bool[np.ndarray, "h w"]:
        """Pixels around it, most of which see the chest."""
        return _ring(self.mask, RING_WIDTH)


@dataclass(frozen=True, kw_only=True)
class NoBreast:
    """Something that stands on a chest and is no breast."""

    what: str
    """In words: what it is, and why it is none."""
    chest: Chest
    """What it stands on."""
    place: Float[np.ndarray, "3"]
    """The middle of its foot [m]."""


def segment_breast(
    points: Float[np.ndarray, "h w 3"], config: SegmentConfig | None = None
) -> Breast:
    """Find the breast in an organised cloud in L [m], NaN where unknown.

    Raises:
        NoBreastError: No chest in view carries a bump of plausible size, or several do.
    """
    config = config or SegmentConfig()
    found, others = breasts_in(points, config)
    if found:
        _require_one(found)
        return found[0]
    rejected = [f"{other.what} (plane at {-1e3 * other.chest.offset:.0f} mm)" for other in others]
    low, high = (1e3 * width for width in config.width_range)
    raise NoBreastError(
        f"expected a breast {low:.0f} to {high:.0f} mm wide on a chest, found "
        f"{', '.join(rejected[:LISTED]) or 'nothing that stands on a plane'}: move the cameras "
        "until breast and chest are in view of both, and look at the disparity for missing depth",
        rejected,
    )


def breasts_in(
    points: Float[np.ndarray, "h w 3"], config: SegmentConfig
) -> tuple[list[Breast], list[NoBreast]]:
    """The breasts on the most extended chest that carries any, none that overlap, and all that
    stands on others and is none, the most extended planes' first.

    Args:
        points: An organised cloud in L [m], NaN where unknown; the camera is on the upper side of
            every chest.
        config: What counts as a breast.
    """
    others: list[NoBreast] = []
    for chest in _chests(points, config):
        found: list[Breast] = []
        for box, core in _bumps(chest.heights(points), config):
            breast, fault = _judged(points, box, core, chest, config)
            if fault:
                place = _middle(points[box], core, chest)
                others.append(NoBreast(what=f"an object {fault}", chest=chest, place=place))
            elif not any((breast.mask & other.mask).any() for other in found):
                found.append(breast)
        if found:
            return found, others
    return [], others


def _require_one(found: list[Breast]) -> None:
    """Refuse to choose among several breasts."""
    if len(found) > 1:
        places = []
        for breast in found:
            row, column = (int(np.median(pixels)) for pixels in np.nonzero(breast.mask))
            places.append(f"one {1e3 * breast.width:.0f} mm wide at column {column}, row {row}")
        raise NoBreastError(
            f"expected one breast in view, found {len(found)} ({', '.join(places)} of the left "
            "picture): cover all but the one to be scanned",
            places,
        )


def on_refined(breast: Breast, points: Float[np.ndarray, "h w 3"]) -> Breast:
    """The breast on the chest through the refined points of its ring, in L [m]: those that the
    matcher alone finds have errors in common, up to .5 mm where the disparity hardly changes.
    """
    chest, seen = chest_around(breast, points)
    if seen.pixels < SMALLEST_RING_PX:
        raise NoBreastError(
            f"only {seen.pixels} px around the breast lie on one smooth chest, and its heights "
            "count from there: move the cameras or whatever covers it",
            seen.pixels,
        )
    if seen.gap > largest_gap(chest):
        raise NoBreastError(
            f"the chest is not seen over {np.degrees(seen.gap):.0f} degrees around the breast, "
            f"towards the {_side(seen.azimuth)} of the left picture, and its heights count from "
            "there: let the cameras look more squarely at the chest, or move what covers it",
            seen.gap,
        )
    return replace(breast, plate=chest)


@dataclass(frozen=True, kw_only=True)
class SeenAround:
    """How much of the chest around a breast is seen."""

    pixels: int
    """That lie on it."""
    share: float
    """Of the pixels around the breast that see anything, those that lie within twice the tolerance
    of it [-]."""
    gap: float
    """Widest angle around the breast over which none does [rad]."""
    azimuth: float
    """Of the middle of that, from L's x to its y [rad]."""


def chest_around(
    breast: Breast,
    points: Float[np.ndarray, "h w 3"],
    tolerances: Sequence[float] = REFITS * (REFINED_TOLERANCE,),
) -> tuple[Chest, SeenAround]:
    """The chest through accurate points of a breast's ring, in L [m], and how many of them it
    rests on; the breast's own chest where they are too few.

    Args:
        breast: As it was found.
        points: Of its ring, and of its skin if at hand, in L [m], NaN where unknown.
        tolerances: Largest distances from the chest of points that support it, fit by fit [m].
    """
    chest, ring = breast.plate, np.zeros((0, 3))
    for tolerance in tolerances:
        ring = _around(points, breast.mask, chest, RING_WIDTH, tolerance)
        if len(ring) >= SMALLEST_RING_PX:
            chest = fit_chest(ring, chest.middle, chest.normal, tolerance)
    known = points[breast.ring]
    heights = np.abs(chest.heights(known[np.isfinite(known[:, 0])]))
    share = float(np.mean(heights < 2 * REFINED_TOLERANCE)) if len(heights) else 0.0
    skin_seen = np.isfinite(points[breast.mask][:, 0]).any()
    middle = _middle(points, breast.mask, chest) if skin_seen else chest.middle
    on_chest = ring[np.abs(chest.heights(ring)) < REFINED_TOLERANCE] - middle
    azimuths = np.sort(np.arctan2(on_chest[:, 1], on_chest[:, 0]))
    if not len(azimuths):
        return chest, SeenAround(pixels=0, share=share, gap=2 * np.pi, azimuth=0.0)
    gaps = np.diff(np.append(azimuths, azimuths[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    centre = float(azimuths[widest] + gaps[widest] / 2)
    return chest, SeenAround(
        pixels=len(azimuths), share=share, gap=float(gaps[widest]), azimuth=centre
    )


def largest_gap(chest: Chest) -> float:
    """The angle around a breast over which its chest need not be seen [rad]: it takes all sides to
    tell how a chest bends.
    """
    return LARGEST_GAP_FLAT if chest.is_flat else LARGEST_GAP_BENT


def _side(azimuth: float) -> str:
    """In words, which side of a picture lies at an angle from its right to below [rad]."""
    return SIDES[round(azimuth / (np.pi / 4)) % len(SIDES)]


def _chests(points: Float[np.ndarray, "h w 3"], config: SegmentConfig) -> Iterator[Chest]:
    """The planes that most points support, bent where more then do, the most extended first."""
    rng = np.random.default_rng(config.seed)
    known = points[np.isfinite(points).all(axis=-1)]
    rest = known[rng.integers(len(known), size=PLANE_SAMPLE)] if len(known) else known
    enough = PLANE_SAMPLE // 100
    for _ in range(config.planes):
        if len(rest) < enough:
            return
        plane = _refined(
            _best_proposal(rest, config.plane_tolerance, rng), rest, config.plane_tolerance
        )
        chest = _bent(plane, rest, config.plane_tolerance)
        supported = np.abs(chest.heights(rest)) < 2 * config.plane_tolerance
        if np.count_nonzero(supported) < enough:
            return
        yield chest
        rest = rest[~supported]


def _bent(plane: Plane, rest: Float[np.ndarray, "n 3"], tolerance: float) -> Chest:
    """The plane, bent as the points ask that lie on it, and those that do so then; flat unless
    clearly more do.
    """
    near = np.abs(plane.heights(rest)) < tolerance
    middle = rest[near].mean(axis=0)
    flat = Chest(normal=plane.normal, offset=plane.offset, middle=middle, bend=np.zeros((3, 3)))
    bent, held = flat, near
    for _ in range(GROWTHS):
        some = rest[held][:: max(1, np.count_nonzero(held) // JURY)]
        bent = fit_chest(some, some.mean(axis=0), bent.normal, tolerance)
        held = np.abs(bent.heights(rest)) < tolerance
        if bent.is_flat or not held.any():
            break
    grown = np.count_nonzero(held) > GROWN * np.count_nonzero(near)
    return bent if grown else flat


def _best_proposal(
    rest: Float[np.ndarray, "n 3"], tolerance: float, rng: np.random.Generator
) -> Plane:
    """Of planes through three random points each, the one that most of a random part supports
    (RANSAC).
    """
    corners = rest[rng.integers(len(rest), size=(PROPOSALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    offsets = np.sum(normals * corners[:, 0], axis=1)
    part = rest[:: max(1, len(rest) // JURY)]
    support = np.count_nonzero(np.abs(part @ normals.T - offsets) < tolerance, axis=0)
    best = int(np.argmax(np.where(np.any(normals != 0, axis=1), support, -1)))
    return _towards_camera(normals[best], float(offsets[best]))


def _refined(plane: Plane, rest: Float[np.ndarray, "n 3"], tolerance: float) -> Plane:
    """The least-squares plane of the points near `plane`, found anew as it settles."""
    for _ in range(5):
        near = rest[np.abs(plane.heights(rest)) < tolerance]
        if len(near) < 3:
            return plane
        centroid = near.mean(axis=0)
        local = near - centroid
        normal = np.linalg.eigh(local.T @ local)[1][:, 0]
        plane = _towards_camera(normal, float(normal @ centroid))
    return plane


def _towards_camera(normal: Float[np.ndarray, "3"], offset: float) -> Plane:
    return (
        Plane(normal=-normal, offset=-offset) if offset > 0 else Plane(normal=normal, offset=offset)
    )


def regions_above(
    heights: Float[np.ndarray, "h w"], config: SegmentConfig
) -> list[Bool[np.ndarray, "h w"]]:
    """The connected regions higher than skin is told from a chest [m], the largest `BUMPS` of them
    first.
    """
    _, labels, boxes = _regions(heights, config)
    return [labels == label for label in _largest(boxes)]


def _bumps(
    heights: Float[np.ndarray, "h w"], config: SegmentConfig
) -> Iterator[tuple[tuple[slice, slice], Bool[np.ndarray, "a b"]]]:
    """The connected regions above a chest, the largest first: a box of the image with room around,
    and which of its pixels they are.
    """
    _, labels, boxes = _regions(heights, config)
    for label in _largest(boxes):
        x, y, width, height = boxes[label, :4].tolist()
        margin = EDGE_PX + 1 + round(FIT_WIDTH * max(width, height))
        box = (
            slice(max(y - margin, 0), y + height + margin),
            slice(max(x - margin, 0), x + width + margin),
        )
        yield box, labels[box] == label


def _largest(boxes: Int[np.ndarray, "r 5"]) -> Int[np.ndarray, "b"]:
    """Labels of the largest regions, the first of which is what lies around all of them."""
    return 1 + np.argsort(-boxes[1:, cv2.CC_STAT_AREA], kind="stable")[:BUMPS]


def _regions(heights: Float[np.ndarray, "h w"], config: SegmentConfig) -> tuple:
    """Number, labels and boxes of the connected regions above a chest."""
    above = cv2.morphologyEx((heights > config.cut_height).astype(np.uint8), cv2.MORPH_OPEN, CROSS)
    return cv2.connectedComponentsWithStats(above, connectivity=4)[:3]


def _judged(
    points: Float[np.ndarray, "h w 3"],
    box: tuple[slice, slice],
    core: Bool[np.ndarray, "a b"],
    chest: Chest,
    config: SegmentConfig,
) -> tuple[Breast, str]:
    """A bump on the chest around its own foot, and why it is no breast; empty if it may be one."""
    near = points[box]
    heights = chest.heights(near)
    breast = _breast(near, heights, core, chest, config)
    fault = _fault(breast, heights, config)
    low, high = config.width_range
    plausible = low / LEEWAY < breast.width < LEEWAY * high
    for _ in range(SETTLINGS if plausible and breast.mask.sum() >= SMALLEST_PX else 0):
        ring = _around(near, breast.mask, chest, FIT_WIDTH, config.plane_tolerance)
        if len(ring) >= SMALLEST_RING_PX:
            found = fit_chest(
                ring, _middle(near, breast.mask, chest), chest.normal, config.plane_tolerance
            )
            chest = chest if lie_as_well(ring, chest, found, config.plane_tolerance) else found
        heights = chest.heights(near)
        before, core = core, _most_of(core, heights, config)
        breast = _breast(near, heights, core, chest, config)
        fault = _fault(breast, heights, config)
        if np.count_nonzero(before ^ core) < SETTLED * np.count_nonzero(core):
            break
    mask = np.zeros(points.shape[:2], bool)
    mask[box] = breast.mask
    return replace(breast, mask=mask), fault or _cut_off(mask)


def _cut_off(mask: Bool[np.ndarray, "h w"]) -> str:
    """That a border of the picture cuts a bump off; empty if none does."""
    borders = {"upper": mask[0], "lower": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
    touched = [name for name, pixels in borders.items() if pixels.any()]
    return f"cut off by the {' and '.join(touched)} border of the left picture" if touched else ""


def _around(
    points: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    chest: Chest,
    width: float,
    tolerance: float,
) -> Float[np.ndarray, "n 3"]:
    """Points near the chest in the ring around a bump."""
    ring = points[_ring(mask, width)]
    ring = ring[np.abs(chest.heights(ring)) < FIT_DEPTH * tolerance]
    return ring[:: max(1, len(ring) // FIT_POINTS)]


def _middle(
    points: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], chest: Chest
) -> Float[np.ndarray, "3"]:
    """The middle of a bump's foot, about on the chest."""
    centre = points[mask & np.isfinite(points[..., 0])].mean(axis=0)
    return centre - chest.heights(centre[None])[0] * chest.normal


def _most_of(
    core: Bool[np.ndarray, "h w"], heights: Float[np.ndarray, "h w"], config: SegmentConfig
) -> Bool[np.ndarray, "h w"]:
    """The region above a chest that holds most of a bump's core; the core itself if none does."""
    count, labels, _ = _regions(heights, config)
    held = np.bincount(labels[core], minlength=count)
    held[0] = 0
    return labels == held.argmax() if held.any() else core


def _breast(
    points: Float[np.ndarray, "h w 3"],
    heights: Float[np.ndarray, "h w"],
    core: Bool[np.ndarray, "h w"],
    chest: Chest,
    config: SegmentConfig,
) -> Breast:
    # The matcher rounds off the foot: what is near the core and more likely skin than chest belongs
    # to it.
    near = cv2.dilate(core.astype(np.uint8), CROSS, iterations=EDGE_PX) > 0
    area = float(_base_areas(points, chest)[core].sum())
    filled = binary_fill_holes(core | (near & (heights > config.cut_height / 2)))
    return Breast(
        mask=np.asarray(filled, bool),
        plate=chest,
        width=float(np.sqrt(4 * area / np.pi)),
        height=float(np.percentile(heights[core], 99.5)),
    )


def _ring(mask: Bool[np.ndarray, "h w"], width: float) -> Bool[np.ndarray, "h w"]:
    """Pixels around a bump, as far as a fraction of its own width."""
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    return (away > 0) & (away <= width * np.sqrt(np.count_nonzero(mask)))


def _base_areas(points: Float[np.ndarray, "h w 3"], plane: Plane) -> Float[np.ndarray, "h w"]:
    """Area of `plane` under each pixel's point [m^2]: of the parallelogram spanned by the steps
    to the next pixels.
    """
    across = np.gradient(points, axis=1)
    down = np.gradient(points, axis=0)
    return np.nan_to_num(np.abs(np.cross(across, down) @ plane.normal))


def _fault(breast: Breast, heights: Float[np.ndarray, "h w"], config: SegmentConfig) -> str:
    """Why this bump is not a breast; empty if it may be one."""
    if not config.width_range[0] <= breast.width <= config.width_range[1]:
        return f"{1e3 * breast.width:.0f} mm wide"
    if not config.height_range[0] <= breast.height <= config.height_range[1]:
        return f"{1e3 * breast.height:.0f} mm high"
    if np.count_nonzero(breast.mask) < SMALLEST_PX:
        return f"seen by only {np.count_nonzero(breast.mask)} px"
    inside = cv2.erode(breast.mask.astype(np.uint8), CROSS) > 0
    rim_height = float(np.nanquantile(heights[breast.mask & ~inside], SEEN_RIM))
    if rim_height > config.step_height:
        return f"that begins {1e3 * rim_height:.0f} mm above its plane with a step"
    around = heights[_ring(breast.mask, RING_WIDTH)]
    known = around[np.isfinite(around)]
    if not len(known) or np.median(np.abs(known)) > config.plane_tolerance:
        return "whose chest does not go on around it"
    return ""
