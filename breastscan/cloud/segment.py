"""Tell the breast from the chest plate it stands on, the table below and whatever else is in view.

Planes are sought from the most to the least extended: the table comes first, the plate after it. A
breast is a connected bump of plausible size that rises without a step, which a plate above a table
does not, from a plane that goes on around it, which a cut through the breast itself does not.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_fill_holes

from breastscan.checks import require_positive, require_seed
from breastscan.errors import ConfigError, NoBreastError
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
"""Width of the ring around a bump that must be plate, as a fraction of the bump's own."""
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
    """Largest distance of a point from the plane it supports [m]."""
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
    plate: Plane
    """The chest plate in L, above it is towards the camera."""
    width: float
    """Diameter of a circle with the area of its base [m]."""
    height: float
    """Height of its top over the plate [m]."""


def segment_breast(
    points: Float[np.ndarray, "h w 3"], config: SegmentConfig | None = None
) -> Breast:
    """Find the breast in an organised cloud in L [m], NaN where unknown.

    Raises:
        NoBreastError: No plane in view carries a bump of plausible size.
    """
    config = config or SegmentConfig()
    rejected = []
    for plane in _planes(points, config):
        heights = plane.heights(points)
        for breast in _bumps(points, heights, plane, config):
            fault = _fault(breast, heights, config)
            if not fault:
                return breast
            rejected.append(f"an object {fault} (plane at {-1e3 * plane.offset:.0f} mm)")
    low, high = (1e3 * width for width in config.width_range)
    raise NoBreastError(
        f"expected a breast {low:.0f} to {high:.0f} mm wide on a flat chest plate, found "
        f"{', '.join(rejected[:LISTED]) or 'nothing that stands on a plane'}: move the cameras "
        "until breast and plate are in view of both, and look at the disparity for missing depth",
        rejected,
    )


def _planes(points: Float[np.ndarray, "h w 3"], config: SegmentConfig) -> Iterator[Plane]:
    """The planes that most points support, the most extended first."""
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
        supported = np.abs(plane.heights(rest)) < 2 * config.plane_tolerance
        if np.count_nonzero(supported) < enough:
            return
        yield plane
        rest = rest[~supported]


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


def _bumps(
    points: Float[np.ndarray, "h w 3"],
    heights: Float[np.ndarray, "h w"],
    plane: Plane,
    config: SegmentConfig,
) -> Iterator[Breast]:
    """The connected regions above `plane`, the largest first."""
    above = cv2.morphologyEx((heights > config.cut_height).astype(np.uint8), cv2.MORPH_OPEN, CROSS)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(above, connectivity=4)
    for label in 1 + np.argsort(-boxes[1:count, cv2.CC_STAT_AREA], kind="stable")[:BUMPS]:
        box = _with_margin(*boxes[label, :4].tolist())
        core = labels[box] == label
        # The matcher rounds off the foot: what is near the core and more likely skin than plate
        # belongs to it.
        near = cv2.dilate(core.astype(np.uint8), CROSS, iterations=EDGE_PX) > 0
        mask = np.zeros(heights.shape, bool)
        mask[box] = binary_fill_holes(core | (near & (heights[box] > config.cut_height / 2)))
        area = float(_base_areas(points[box], plane)[core].sum())
        yield Breast(
            mask=mask,
            plate=plane,
            width=float(np.sqrt(4 * area / np.pi)),
            height=float(np.percentile(heights[box][core], 99.5)),
        )


def _with_margin(x: int, y: int, width: int, height: int) -> tuple[slice, slice]:
    """The image region of a box, with room for its foot and for differences."""
    margin = EDGE_PX + 1
    return slice(max(y - margin, 0), y + height + margin), slice(
        max(x - margin, 0), x + width + margin
    )


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
    from_breast = cv2.distanceTransform((~breast.mask).astype(np.uint8), cv2.DIST_L2, 3)
    around = heights[(from_breast > 0) & (from_breast <= RING_WIDTH * np.sqrt(breast.mask.sum()))]
    known = around[np.isfinite(around)]
    if not len(known) or np.median(np.abs(known)) > config.plane_tolerance:
        return "whose plane does not go on around it"
    return ""
