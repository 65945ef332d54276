"""The pair of cameras from shots of a board [Zhang, Sec. II-A, Figs. 2-5]."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from breastscan.camera.interface import StereoPair
from breastscan.report import calibration_figures
from breastscan.report.paper import PUBLISHED
from breastscan.run.metrics import rms
from breastscan.vision import calibration
from breastscan.vision.board import Board, BoardShot, find_shot
from breastscan.vision.boards import bundle
from breastscan.vision.calibration import Calibration
from breastscan.vision.camera import Intrinsics, RectifiedPair, StereoRig
from experiments.paper.item import Item, column, judged
from sim.cameras.shown_board import ShotConfig, ShownBoard, board_poses

SHOTS = PUBLISHED["calibration"]["shots"]
SHARED_ROW_PX = 0.1
"""Within which the rows of the same corner are one row [px]."""


@dataclass(frozen=True, kw_only=True)
class Calibrated:
    """What the cameras' calibration gave, and the truth."""

    shown: int
    """Pairs of pictures that were taken."""
    pair: StereoPair
    """The first of them."""
    found: tuple[BoardShot, ...]
    """Those that show the whole board to both cameras."""
    result: Calibration
    truth: StereoRig
    corner_errors_px: Float[np.ndarray, "shots 2"]
    """RMS distance of the found corners from where the board was, left and right [px]."""


def measured(seed: int) -> Calibrated:
    """Take the shots and calibrate from them."""
    board, config = Board(), ShotConfig()
    day = ShownBoard(board, seed, config)
    truth = day.scene.rig
    X_LBoard = board_poses(truth, board, config, np.random.default_rng(seed))
    pairs = dict(day)
    found = [find_shot(name, pair.left, pair.right, board) for name, pair in pairs.items()]
    shots = [shot for shot in found if shot is not None]
    places = [X for shot, X in zip(found, X_LBoard, strict=True) if shot is not None]
    return Calibrated(
        shown=len(pairs),
        pair=pairs[shots[0].name],
        found=tuple(shots),
        result=calibration.calibrate(shots, (truth.left.width, truth.left.height), board),
        truth=truth,
        corner_errors_px=corner_errors_px(truth, np.array(places), shots, board),
    )


def items(day: Calibrated) -> Iterator[Item]:
    """What the calibration answers."""
    yield _corners(day)
    yield _residuals(day)
    yield _places(day)
    yield _rectification(day)


def row_differences_px(
    rig: StereoRig, pair: RectifiedPair, shots: tuple[BoardShot, ...]
) -> Float[np.ndarray, "shots"]:
    """How far the same corners' rows lie apart in the rectified pair, RMS of each shot [px]."""
    R_RV = rig.X_RL[:3, :3] @ pair.R_LV
    return np.array(
        [
            rms(
                _rows_px(rig.left, pair.R_LV, pair, s.left)
                - _rows_px(rig.right, R_RV, pair, s.right)
            )
            for s in shots
        ]
    )


def _rows_px(
    camera: Intrinsics, R_CV: Float[np.ndarray, "3 3"], pair: RectifiedPair, pixels: np.ndarray
) -> Float[np.ndarray, "n"]:
    """Rows of the rectified view that pixels of the raw one go to."""
    normalised = cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion)[:, 0]
    rays_V = np.column_stack([normalised, np.ones(len(normalised))]) @ R_CV
    return pair.focal_px * rays_V[:, 1] / rays_V[:, 2] + pair.centre_px[1]


def corner_errors_px(
    rig: StereoRig, X_LBoard: np.ndarray, shots: list[BoardShot], board: Board
) -> Float[np.ndarray, "shots 2"]:
    """From whichever end the corners were counted."""
    both = [
        bundle.residuals(bundle.reprojection(rig, X_LBoard, counted, board))
        for counted in (shots, [shot.half_turned() for shot in shots])
    ]
    return np.minimum(*both)


def _corners(day: Calibrated) -> Item:
    result = day.result
    names = np.array([int(shot.name) for shot in day.found])
    used = [int(shot.name) for shot in result.shots]
    first, error_px = result.shots[0], rms(day.corner_errors_px)
    return Item(
        heading="Fig. 2",
        ours=f"{len(day.found)} of {day.shown} shots show the whole board of 8 × 6 "
        f"squares to both cameras; a found corner is off the true one by {error_px:.3f} px (RMS)",
        verdict=judged(len(day.found) >= SHOTS, "agrees"),
        why="the same number of shots of the same board; the paper prints no figure for the "
        "corners.",
        figure=calibration_figures.corners(
            (day.pair.left, day.pair.right), (first.left, first.right), ("Left", "Right")
        ),
        shows="The corners found in the first shot, left and right, in their order from the "
        "framed one on.",
        data={
            column("shot", "number of the shot"): names,
            **{
                column(f"{side}_px", f"RMS distance of found from true corners, {side}", "px"): off
                for side, off in zip(("left", "right"), day.corner_errors_px.T, strict=True)
            },
            column("used", "whether the calibration used it", kind="yes or no"): np.isin(
                names, used
            ),
        },
    )


def _residuals(day: Calibrated) -> Item:
    result = day.result
    return Item(
        heading="Fig. 3",
        ours=f"{result.reprojection_px:.3f} px over all pictures (RMS), largest shot "
        f"{result.residuals_px.max():.3f} px; {len(result.dropped)} outlier shots dropped; shots "
        f"held out of a second calibration: {result.quality.held_out_px:.3f} px",
        verdict="not comparable",
        why="the text prints no number for the bars. Outliers are dropped and the calibration "
        "repeated, as it says.",
        figure=calibration_figures.residual_bars(
            [s.name for s in result.shots], result.residuals_px
        ),
        shows="RMS re-projection residual of every shot, left and right, and over all.",
        data={
            column("shot", "number of the shot"): np.array([int(s.name) for s in result.shots]),
            column("left_px", "RMS residual, left", "px"): result.residuals_px[:, 0],
            column("right_px", "RMS residual, right", "px"): result.residuals_px[:, 1],
        },
    )


def _places(day: Calibrated) -> Item:
    result, quality = day.result, day.result.quality
    p_L = result.X_LBoard[:, :3, 3]
    coverage = " and ".join(f"{100 * share:.0f} %" for share in quality.coverage)
    return Item(
        heading="Fig. 4",
        ours=f"{len(result.shots)} places of the board, {1e3 * p_L[:, 2].min():.0f} to "
        f"{1e3 * p_L[:, 2].max():.0f} mm before the cameras; corners in {coverage} of the images' "
        f"cells; normals spread by {np.degrees(quality.tilt_spread):.0f}° (one sigma)",
        verdict=judged(len(result.shots) >= SHOTS, "agrees"),
        why="as many shots at different angles all over both fields of view.",
        figure=calibration_figures.board_places(
            result.X_LBoard, result.board.points, result.rig.X_RL
        ),
        shows="Where the board was, before both cameras.",
        data={
            column("shot", "number of the shot"): np.array([int(s.name) for s in result.shots]),
            **{
                column(f"{axis}_mm", "first corner of the board", "mm", "L"): 1e3 * values
                for axis, values in zip("xyz", p_L.T, strict=True)
            },
        },
    )


def _rectification(day: Calibrated) -> Item:
    result = day.result
    pair = result.rig.rectify(day.pair.left, day.pair.right)
    after = row_differences_px(result.rig, pair, result.shots)
    before = np.array([rms(s.left[:, 1] - s.right[:, 1]) for s in result.shots])
    return Item(
        heading="Fig. 5",
        ours=f"rows of the same corner differ by {rms(before):.1f} px before and {rms(after):.3f} "
        "px after (RMS over all shots)",
        verdict=judged(rms(after) < SHARED_ROW_PX, "agrees"),
        why="corresponding points share a row, to a small part of a pixel.",
        figure=calibration_figures.rectified(
            (day.pair.left, day.pair.right), (pair.left, pair.right)
        ),
        shows="The first shot as taken and as rectified, with lines that corresponding points "
        "share only after it.",
        data={
            column("shot", "number of the shot"): np.array([int(s.name) for s in result.shots]),
            column(
                "before_px", "RMS difference of the rows of the same corner, as taken", "px"
            ): before,
            column("after_px", "the same, rectified", "px"): after,
        },
    )
