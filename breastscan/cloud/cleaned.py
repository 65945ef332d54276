"""A cloud or a mesh from whatever source as points on the skin in B, metres, with outward normals;
or why it is none.
"""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.sample import sample_surface_even

from breastscan.cloud import outwards
from breastscan.cloud.cloud_breast import REACH, CloudBreast, breast_in
from breastscan.cloud.filters import grid_sample
from breastscan.cloud.on_surface import CELL, on_surface
from breastscan.cloud.outwards import Oriented
from breastscan.cloud.skin_fit import FEWEST
from breastscan.errors import PerceptionError
from breastscan.geometry import se3
from breastscan.run.clouds import PointFile

SAMPLES = 40_000
"""Points that a mesh becomes: 1.3 mm apart on 260 mm of chest."""
SEED = 0
"""Of where on the mesh they lie."""
MOST = 400_000
"""Points that are thinned out, if a cloud has more."""
BASE = 0.15
"""Radius around the base's origin that the robot stands in [m], and no body can."""
BODY = (0.05, 3.0)
"""Plausible extents of a cloud that holds a body [m]."""
ROOM = 10.0
"""Larger a cloud in metres, with all that stands around, is not [m]."""
MM = 1e-3
OTHER_UNITS = {"centimetres": 0.01, "inches": 0.0254}
"""What else people measure in, in metres: bodies may have the same extents in both, so that they
are not told from one another."""
OFF_AXIS = np.radians(30.0)
"""Largest angle from a camera's line of sight of what it is pointed at [rad]. In B, nothing that a
robot scans faces its base from straight above or below."""
FACING = 0.5
"""Cosine of the angle between a surface and a line of sight, from which on it is seen by it [-]."""
ROBOT_B = np.array([0.0, 0.0, 1.0])
"""Where a robot reaches from, about [m]: over its base, which stands beside the body or over it."""
TURNED = "The file's normals point inwards: turned."


@dataclass(frozen=True, kw_only=True)
class CleanCloud:
    """Points on a surface, one side of which is outwards."""

    points_B: Float[np.ndarray, "n 3"]
    """[m]."""
    oriented: Oriented
    told: tuple[str, ...]
    """What was done to the file's, a sentence each."""

    @property
    def normals_B(self) -> Float[np.ndarray, "n 3"]:
        """Unit normals, outwards as far as is known."""
        return self.oriented.normals

    @property
    def turned(self) -> "CleanCloud":
        """The same with normals to the other side."""
        return replace(self, oriented=self.oriented.turned)


def cleaned(cloud: PointFile) -> CleanCloud:
    """What a file holds of a surface within the robot's reach.

    Raises:
        PerceptionError: Hardly anything, or in another unit or frame than B's.
    """
    points, normals, told = _known(*_sampled(cloud))
    points, unit_told = _in_metres(points)
    near = np.linalg.norm(points, axis=1) < REACH
    told = [*cloud.told, *told, *unit_told]
    points, normals = points[near], None if normals is None else normals[near]
    points, normals, thinned = _single(points, normals)
    _require_some(points)
    surface = outwards.along_surface(points)
    kept = on_surface(points, surface)
    points, normals = points[kept], None if normals is None else normals[kept]
    _require_some(points)
    if not kept.all():
        surface = outwards.along_surface(points)
        told.append(f"{np.sum(~kept)} of {len(kept)} points lie off the surface: left out.")
    oriented = outwards.oriented(points, surface, normals)
    _require_no_sensors(points, oriented)
    told += [*thinned, *_told(oriented, normals is not None, len(points))]
    return CleanCloud(points_B=points, oriented=oriented, told=tuple(told))


def breast_of(cloud: CleanCloud) -> tuple[CloudBreast, CleanCloud]:
    """The one breast in a cloud on the chest around it, and the cloud with the normals outwards
    that show it: turned, where they point inwards or their sign is a guess.

    Raises:
        PerceptionError: As `breast_in` does.
    """
    try:
        breast = breast_in(cloud.points_B, cloud.normals_B)
        if cloud.oriented.is_told:
            return breast, cloud
    except PerceptionError as error:
        if cloud.oriented.is_told and outwards.bulge(cloud.points_B, cloud.normals_B) > 0:
            raise
        told = (TURNED,) if cloud.oriented.is_told else ()
        cloud = replace(cloud.turned, told=(*cloud.told, *told))
        try:
            breast = breast_in(cloud.points_B, cloud.normals_B)
        except PerceptionError:
            raise error from None
    _require_towards_robot(breast, cloud)
    return breast, cloud


def _require_towards_robot(breast: CloudBreast, cloud: CleanCloud) -> None:
    """Refuse a breast that faces away from the robot where no normals of the file say so: it may be
    a hollow, seen from inside of the body.

    Raises:
        PerceptionError: It does.
    """
    normal_B, middle_B = breast.chest.normal, cloud.points_B[breast.skin].mean(axis=0)
    if normal_B @ (ROBOT_B - middle_B) < 0:
        raise PerceptionError(
            f"what bulges like a breast faces {np.round(normal_B, 1).tolist()} in B, away from the "
            "robot, and may be a hollow: give normals that point outwards, or the cloud in the "
            "base's frame if it is not",
            normal_B,
        )


def _told(oriented: Oriented, given: bool, points: int) -> list[str]:
    if not oriented.is_told:
        why = (
            "The file's normals are not those of one side of the surface" if given
            else "The file has no normals"
        )  # fmt: skip
        return [f"{why}: they are estimated, outwards where the surface bulges."]
    if oriented.estimated:
        return [
            f"{oriented.estimated} of {points} normals are missing or lie off the surface's: "
            "estimated."
        ]
    return []


def _sampled(cloud: PointFile) -> tuple[np.ndarray, np.ndarray | None]:
    """The points of a cloud, or of a mesh's faces, evenly spread."""
    if cloud.triangles is None:
        return cloud.points, cloud.normals
    whole = np.isfinite(cloud.points[cloud.triangles]).all(axis=(1, 2))
    mesh = trimesh.Trimesh(cloud.points, cloud.triangles[whole], process=False)
    if not mesh.area > 0:
        raise PerceptionError(
            f"expected a mesh with faces, those of the {len(cloud.triangles)} that came have no "
            "area: save the mesh anew, or its points as a cloud",
            cloud.triangles,
        )
    points, faces = sample_surface_even(mesh, SAMPLES, seed=SEED)
    return np.asarray(points), np.asarray(mesh.face_normals[faces])


def _known(
    points: np.ndarray, normals: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Without rows that are no point: NaN, or zeros, as depth cameras have them."""
    finite = np.isfinite(points).all(axis=1)
    known = finite & np.any(points != 0, axis=1)
    told = [
        f"{count} of {len(points)} points are {what}: left out."
        for count, what in (
            (np.sum(~finite), "not finite"), (np.sum(finite & ~known), "(0, 0, 0), no depth"),
        )
        if count
    ]  # fmt: skip
    return points[known], None if normals is None else normals[known], told


def _in_metres(points: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """The points in metres, as their distances from the robot's base tell.

    Raises:
        PerceptionError: They tell another unit, or another frame.
    """
    _require_some(points)
    distance = np.linalg.norm(points, axis=1)
    usual = float(np.median(distance))
    extent = float(np.linalg.norm(np.subtract(*np.percentile(points, [95, 5], axis=0))))
    if np.sum(distance < REACH) >= FEWEST and usual < ROOM:
        if usual < BASE:
            raise _elsewhere(f"lie {1e3 * usual:.0f} mm from the origin, where the robot stands")
        return points, []
    if _is_body(MM * usual, MM * extent):
        return MM * points, [
            f"The points lie {usual:.0f} from the robot's base, which no robot reaches in metres: "
            "taken as millimetres, times .001."
        ]
    meant = [
        f"{name} (times {factor:g})"
        for name, factor in OTHER_UNITS.items()
        if _is_body(factor * usual, factor * extent)
    ]
    hint = f"; they may be {' or '.join(meant)}" if meant else ""
    raise _elsewhere(
        f"lie {usual:.3g} away and reach over {extent:.3g}, {REACH} m away at most{hint}"
    )


def _is_body(usual: float, extent: float) -> bool:
    """Whether a body may be as far from the base [m], and as large."""
    return BASE < usual < REACH and BODY[0] < extent < BODY[1]


def _elsewhere(what: str) -> PerceptionError:
    return PerceptionError(
        "expected points on the body within the robot's reach, in its base frame B and in metres; "
        f"most {what}: give them in metres, in the base's frame (transform them by X_BL, the "
        "camera's pose in it, if they are a camera's)",
        what,
    )


def _single(
    points: np.ndarray, normals: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Each place once, and not more of them than are of use."""
    first = np.sort(np.unique(points, axis=0, return_index=True)[1])
    kept, cell = first, CELL
    while len(kept) > MOST:
        kept = first[grid_sample(points[first], cell)]
        cell *= 2
    told = [f"One point in {cell / 2 * 1e3:.0f} mm is used, {len(kept)} of {len(points)}."]
    told = told if len(kept) < len(first) else []
    return points[kept], None if normals is None else normals[kept], told


def _require_some(points: np.ndarray) -> None:
    if len(points) < FEWEST:
        raise PerceptionError(
            f"expected {FEWEST} points or more within {REACH} m of the robot's base, got "
            f"{len(points)}: give a denser cloud, in metres, in the base's frame",
            len(points),
        )


def _require_no_sensors(points: np.ndarray, oriented: Oriented) -> None:
    """Refuse a camera's own frame, whose z axis looks at what is seen, or away from it.

    Raises:
        PerceptionError: It is one.
    """
    middle, axis = np.median(points, axis=0), oriented.normals.mean(axis=0)
    away = middle / np.linalg.norm(middle)
    off_axis = min(se3.angle_between(away, np.array([0.0, 0.0, z])) for z in (1.0, -1.0))
    facing = -away @ axis / max(np.linalg.norm(axis), np.finfo(float).tiny)
    if off_axis < OFF_AXIS and abs(facing) > FACING:  # its normals may point either way
        raise PerceptionError(
            f"the cloud lies at {np.round(1e3 * middle).astype(int).tolist()} mm, square to the z "
            "axis through the origin, as a camera sees it: give it in the robot's base frame, "
            "transformed by X_BL, the camera's pose in it (`breastscan handeye` measures that)",
            middle,
        )
