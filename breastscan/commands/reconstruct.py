"""A stereo pair on disk to a point cloud and a depth map: the perception of a scan without a robot.

`cloud.ply` holds points in the left camera's frame: of the breast, or of the whole view where there
is none. `disparity.png` is a picture of the whole view, and `depth.tiff` its depth along the axis
of the rectified left view [m], 32-bit float, NaN where unknown.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float, Float32

from breastscan.camera.grey import read_grey
from breastscan.camera.interface import StereoPair
from breastscan.cloud import filters, normals
from breastscan.cloud.segment import Breast
from breastscan.commands.console import Out, console
from breastscan.errors import NoBreastError, PerceptionError
from breastscan.run import writing
from breastscan.scan import PerceptionConfig, Stages, check_sides, match, reconstruct_breast
from breastscan.vision.camera import RectifiedPair, StereoRig
from breastscan.vision.disparity_picture import disparity_picture
from breastscan.vision.matching.pair_check import check_depth, check_exposure
from breastscan.vision.matching.row_check import check_rows
from breastscan.vision.triangulation import depth_map, triangulate

VIEW_POINTS = 100_000
"""Maximum number of points that a view without a breast is thinned to, along the rows and columns
of the image."""
VIEW_ALPHA = 4.0
"""alpha of the denoising filter there [-] [Zhang, Eq. 12]: at 2, steep surfaces would go as well,
whose points lie far apart."""
DEPTHS = (0.01, 0.5, 0.99)
"""Shares of the view up to which it is told how far away it is [-]."""
VIEW_NEIGHBOURS = 15
"""Points that a normal is taken from there; distances are not known before [-]."""


@dataclass(frozen=True, kw_only=True)
class PairReconstruction:
    """What a pair shows."""

    disparity: Float32[np.ndarray, "h w"]
    """Of the rectified left view [px], NaN where unknown; refined on the breast."""
    breast: Breast | None
    """Which pixels are breast; None where there is none."""
    points_L: Float[np.ndarray, "n 3"]
    """Of the breast if there is one, else of all that both cameras see [m]."""
    normals_L: Float[np.ndarray, "n 3"]
    """Unit normals of the points, towards the camera."""


def reconstruct(
    left: tyro.conf.Positional[Path],
    right: tyro.conf.Positional[Path],
    /,
    rig: Path,
    out: Out = Path("out/reconstruct"),
    perception: PerceptionConfig = PerceptionConfig(),  # noqa: B008 (frozen)
    accept: bool = False,
) -> PairReconstruction:
    """Turn a stereo pair on disk into a point cloud of the breast, or of all that is in view where
    there is none.

    Args:
        left: Left image, grey or colour, 8 or 16 bit, as the camera gave it (distorted).
        right: Right image of the same instant.
        rig: The rig file of the two cameras.
        out: Folder for cloud.ply, depth.tiff, disparity.png and config.json.
        perception: Every setting of it.
        accept: Whether to write also what is not trusted: of a pair that does not fit its rig, of
            which hardly anything matches, or that shows nothing near.

    Returns:
        What the pair shows.

    Raises:
        CalibrationError: The rig file is not one.
        PerceptionError: An image cannot be read, shows nothing, has another size than the rig's,
            the two are exchanged, they do not fit the rig, or nothing in them matches.
        ConfigError: `out` cannot be written.
    """
    cameras = StereoRig.load(rig)
    images = StereoPair(left=read_grey(left), right=read_grey(right), time=0.0)
    check_exposure(images.left, str(left))
    check_exposure(images.right, str(right))
    with writing.staged(out) as folder:
        pair, matched = match(images, cameras, perception, Stages())
        if not accept:
            _check_fit(images, pair, matched, cameras, perception)
        try:
            breast = reconstruct_breast(pair, matched, perception, Stages())
            view = PairReconstruction(
                disparity=breast.disparity,
                breast=breast.breast,
                points_L=breast.sampled_L,
                normals_L=breast.normals_L,
            )
        except NoBreastError:
            check_sides(images, matched, cameras, perception)
            view = _whole_view(pair, matched)
        depth = depth_map(view.disparity, pair)
        if view.breast is None and not accept:
            check_depth(depth, pair.baseline)
        writing.write_image(folder / "disparity.png", disparity_picture(view.disparity))
        writing.write_image(folder / "depth.tiff", depth)
        writing.write_cloud(folder / "cloud.ply", view.points_L, view.normals_L)
        writing.write_settings(folder, {"rig": rig, "perception": perception})
    what = "of the breast" if view.breast else "of the whole view, in which there is no breast,"
    console.print(
        f"{len(view.points_L)} points {what} with normals in {out / 'cloud.ply'}", soft_wrap=True
    )
    near, middle, far = np.nanquantile(depth, DEPTHS)
    console.print(
        f"{np.isfinite(depth).mean():.0%} of the view matched, {near:.3f} to {far:.3f} m away "
        f"(98 % of it), half of it nearer than {middle:.3f} m",
        soft_wrap=True,
    )
    return view


def _check_fit(
    images: StereoPair,
    pair: RectifiedPair,
    matched: Float32[np.ndarray, "h w"],
    cameras: StereoRig,
    perception: PerceptionConfig,
) -> None:
    """Refuse a pair that does not fit its rig, with the better reason if there is one."""
    try:
        check_rows(pair.left, pair.right)
    except PerceptionError:
        check_sides(images, matched, cameras, perception)
        raise


def _whole_view(pair: RectifiedPair, matched: Float32[np.ndarray, "h w"]) -> PairReconstruction:
    """All that was matched, as it was matched."""
    step = max(1, int(np.ceil(np.sqrt(np.isfinite(matched).sum() / VIEW_POINTS))))
    points_L = triangulate(matched, pair)[::step, ::step]
    points_L = points_L[np.isfinite(points_L[..., 0])]
    if len(points_L) <= VIEW_NEIGHBOURS:
        raise PerceptionError(
            "nothing in the two images matches: expected two views of one scene, taken together by "
            "the rig's cameras",
            len(points_L),
        )
    points_L = points_L[filters.statistical_inliers(points_L, alpha=VIEW_ALPHA)]
    normals_L = normals.estimate_normals(points_L, k=VIEW_NEIGHBOURS)
    return PairReconstruction(
        disparity=matched, breast=None, points_L=points_L, normals_L=normals_L
    )
