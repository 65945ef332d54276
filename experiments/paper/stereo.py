"""Disparity and points of the breast [Zhang, Secs. II-B, II-C, Figs. 6, 7]."""

from collections.abc import Iterator

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from breastscan.report import theme
from breastscan.run.bars import SCAN, bars_of
from breastscan.run.metrics import rms
from breastscan.vision import triangulation
from breastscan.vision.disparity_picture import disparity_picture
from experiments.opencv_stereo import opencv_disparity
from experiments.paper import drawing
from experiments.paper.item import Item, column, coordinates, judged
from experiments.paper.scans import Matched, Scanned
from sim import error_analysis

BARS = bars_of(SCAN)
"""What a scan's surface is held to."""
AROUND_PX = 60
"""What the pictures show around the breast [px]."""
PAIR_ZOOM = 1.0
"""Of two views in space side by side, whose labels need the room between them."""
OPENCV_STEP = 16
"""OpenCV's matcher takes a multiple of so many disparities."""


def items(scan: Scanned, matched: Matched) -> Iterator[Item]:
    """What the reconstruction answers."""
    yield _disparity(scan, matched)
    yield _cloud(scan)


def _disparity(scan: Scanned, matched: Matched) -> Item:
    seen = scan.result.reconstruction
    both = error_analysis.seen_by_both(seen.pair, scan.result.cell.rig, scan.X_SL, scan.truth)
    maps = {
        "matched": matched.disparity,
        "refined": seen.disparity,
        "OpenCV, 8 paths": _opencv(scan, matched),
    }
    rows = {name: _quality(scan, disparity, both) for name, disparity in maps.items()}
    rmse_mm, density = (np.array(values) for values in zip(*rows.values(), strict=True))
    figure, axes = theme.panels(1, 2, height_in=4.0)
    cut = _around(seen.breast.mask)
    for axis, name in zip(axes[0], ("matched", "refined"), strict=True):
        colours = cv2.cvtColor(disparity_picture(maps[name][cut]), cv2.COLOR_BGR2RGB)
        drawing.picture(axis, colours, f"Disparity, {name} [px]")
    return Item(
        heading="Fig. 6",
        ours=f"depth of {100 * density[0]:.1f} % of the skin that both cameras see, off the true "
        f"skin by {rmse_mm[0]:.2f} mm (RMS); refined on the grey levels {rmse_mm[1]:.2f} mm; "
        f"OpenCV's matcher {rmse_mm[2]:.2f} mm at {100 * density[2]:.1f} %",
        verdict=judged(BARS["surface_density"].holds(density[0]), "agrees"),
        why="a dense map of the breast by the paper's steps; its text gives no number to hold "
        "this against.",
        figure=figure,
        shows="Disparity of the breast and the plate around it, by the paper's steps and refined; "
        "black is unknown.",
        data={
            column("map", "how the disparity was found", kind="text"): np.array(list(rows)),
            column("rmse_mm", "distance of the points from the true skin, RMS", "mm"): rmse_mm,
            column("density", "share of the skin seen by both cameras that has a point"): density,
        },
    )


def _quality(
    scan: Scanned, disparity: Float32[np.ndarray, "h w"], both: Bool[np.ndarray, "h w"]
) -> tuple[float, float]:
    """RMS distance from the true skin [mm], and the share of the skin that has a point, within
    the breast.
    """
    points_L = triangulation.triangulate(disparity, scan.result.reconstruction.pair)
    known = np.isfinite(points_L[..., 0])
    judged = known & scan.result.reconstruction.breast.mask & both
    return rms(scan.errors_mm(points_L[judged])), float(known[both].mean())


def _opencv(scan: Scanned, matched: Matched) -> Float32[np.ndarray, "h w"]:
    pair = scan.result.reconstruction.pair
    lowest, highest = np.nanquantile(matched.disparity, (0.005, 0.995))
    first = int(lowest) // OPENCV_STEP * OPENCV_STEP
    count = (int(highest - first) // OPENCV_STEP + 2) * OPENCV_STEP
    return opencv_disparity(pair.left, pair.right, first, count)


def _around(mask: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Rows and columns of the breast and what is around it."""
    rows, columns = (
        slice(max(int(seen[0]) - AROUND_PX, 0), int(seen[-1]) + AROUND_PX)
        for seen in (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    )
    return rows, columns


def _cloud(scan: Scanned) -> Item:
    seen, metrics = scan.result.reconstruction, scan.result.metrics
    points_mm = scan.in_base_mm(seen.sampled_L)
    errors_mm = scan.errors_mm(seen.sampled_L)
    figure, axes = theme.panels(1, 2, height_in=3.8, subplot_kw={"projection": "3d"})
    whole, errors = axes[0]
    drawing.in_space(whole, points_mm, s=2.4, zoom=PAIR_ZOOM)
    theme.title(whole, "Coloured by height")
    limit = float(np.quantile(np.abs(errors_mm), 0.98))
    dots = drawing.in_space(
        errors, points_mm, errors_mm, cmap="RdBu_r", vmin=-limit, vmax=limit, s=2.4, zoom=PAIR_ZOOM
    )
    theme.title(errors, "Distance from the true skin [mm]")
    figure.colorbar(dots, ax=errors, shrink=0.6, pad=0.12)
    found = int(np.isfinite(seen.points_L[..., 0]).sum())
    return Item(
        heading="Fig. 7",
        ours=f"{found} points of the breast, {metrics['surface_rmse_mm']:.2f} mm off the true "
        f"skin (RMS), 95 % within {metrics['surface_p95_mm']:.2f} mm, with every error on",
        verdict=judged(BARS["surface_rmse_mm"].holds(metrics["surface_rmse_mm"]), "agrees"),
        why="the points are reconstructed as in Eqs. 8-11; the paper states no accuracy, and had "
        "no truth.",
        figure=figure,
        shows="The reconstructed breast (down-sampled) with realistic errors, coloured by height "
        "and by the distance from the true skin.",
        data={
            **coordinates("{}_mm", "reconstructed point", points_mm),
            column("error_mm", "signed distance from the true skin", "mm"): errors_mm,
        },
    )
