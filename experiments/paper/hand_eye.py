"""The cameras' place in the robot's base, from a board on the flange [Zhang, Sec. V-A, Figs. 16,
17, Eq. 32].
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from breastscan.geometry import se3
from breastscan.report import calibration_figures
from breastscan.report.paper import PUBLISHED
from breastscan.vision.board import Board, find_shot
from breastscan.vision.camera import StereoRig
from breastscan.vision.hand_eye import HandEye, hand_eye
from experiments.paper.item import Item, column, judged
from sim.cameras.held_board import HeldBoard, PoseConfig
from sim.rig_errors import rig_errors

SHOWN = 4
"""Positions that the paper shows."""


@dataclass(frozen=True, kw_only=True)
class Placed:
    """What the hand-eye calibration gave, and the truth."""

    poses: int
    """Poses at which the board was shown."""
    result: HandEye
    truth: StereoRig
    pictures: list[UInt8[np.ndarray, "h w"]]
    """Of the left camera, at some of the poses."""
    shown: list[int]
    """Which poses these are."""


def measured(rig: StereoRig, seed: int) -> Placed:
    """Let the arm show its board to the cameras, and find them with a calibrated rig."""
    board, config = Board(), PoseConfig()
    day = HeldBoard(board, seed, config)
    found = [
        (shot, X_BF, pair.left)
        for name, pair, X_BF in day
        if (shot := find_shot(name, pair.left, pair.right, board)) is not None
    ]
    shots, stated, pictures = (list(values) for values in zip(*found, strict=True))
    shown = list(range(0, len(shots), max(len(shots) // SHOWN, 1)))[:SHOWN]
    return Placed(
        poses=config.poses,
        result=hand_eye(shots, np.stack(stated), rig, board),
        truth=day.scene.rig,
        pictures=[pictures[number] for number in shown],
        shown=shown,
    )


def items(day: Placed) -> Iterator[Item]:
    """What the hand-eye calibration answers."""
    yield _schematic(day)
    yield _positions(day)
    yield _transformation(day)


def _schematic(day: Placed) -> Item:
    rig = day.result.rig
    assert rig.X_BL is not None, "the hand-eye calibration places the rig"
    cameras = (rig.X_BL, rig.X_BL @ se3.inverse(rig.X_RL))
    flange_mm = 1e3 * day.result.X_BF[:, :3, 3]
    return Item(
        heading="Fig. 16",
        ours=f"base, flange and board at {len(day.result.shots)} poses, and both cameras where "
        "they were found",
        verdict="agrees",
        why="an illustration. Eye-to-hand as in the paper; it asks for two poses at least.",
        figure=calibration_figures.hand_eye_frames(
            day.result.X_BF, day.result.X_FBoard, cameras, Board().points
        ),
        shows="The robot's base, the flange with its board at every pose, and the cameras.",
        data={
            column(f"{axis}_mm", "flange at a pose", "mm", "B"): values
            for axis, values in zip("xyz", flange_mm.T, strict=True)
        },
    )


def _positions(day: Placed) -> Item:
    result = day.result
    some = [result.shots[number] for number in day.shown]
    return Item(
        heading="Fig. 17",
        ours=f"{len(result.shots)} of {day.poses} positions show the whole board to both cameras; "
        f"the flange's rotations spread by {np.degrees(result.tilt_spread):.0f}° (one sigma about "
        "the second axis)",
        verdict=judged(len(result.shots) >= SHOWN, "agrees"),
        why="the same board in the same hand, at more positions; those at which a camera does not "
        "see all of it are left out.",
        figure=calibration_figures.corners(
            day.pictures, [shot.left for shot in some], [f"Position {s.name}" for s in some]
        ),
        shows="The board on the flange at four positions, seen by the left camera, with the "
        "corners found.",
        data={
            column("position", "number of the pose"): np.array([int(s.name) for s in result.shots]),
            column("left_px", "RMS residual, left", "px"): result.residuals_px[:, 0],
            column("right_px", "RMS residual, right", "px"): result.residuals_px[:, 1],
        },
    )


def _transformation(day: Placed) -> Item:
    rig, printed = day.result.rig, np.array(PUBLISHED["hand_eye"]["X"], float)
    assert rig.X_BL is not None, "the hand-eye calibration places the rig"
    assert day.truth.X_BL is not None, "the twin knows where its cameras stand"
    errors = rig_errors(rig, day.truth)
    lengths = np.linalg.norm(printed[:3, :3], axis=0)
    turn_deg = nearest_turn_deg(printed[:3, :3])
    entries = [f"({row + 1}, {entry + 1})" for row in range(4) for entry in range(4)]
    return Item(
        heading="Eq. 32",
        ours=f"the cameras' pose is found to {errors['handeye_error_mm']:.2f} mm and "
        f"{errors['handeye_error_deg']:.4f}° with an arm that repeats to .05 mm and .01°; two "
        f"closed forms agree to {1e3 * day.result.disagreement[0]:.2f} mm",
        verdict="not comparable",
        why=f"the paper gives no error, and its columns have lengths of {lengths.min():.3f} to "
        f"{lengths.max():.3f}: no rotation (the nearest turns by {turn_deg:.1f}°). Read as X_BL "
        "it stands .54 m below the base.",
        data={
            column("entry", "row and column", kind="text"): np.array(entries),
            column("paper", "as printed", "1 or m"): printed.ravel(),
            column("ours", "cameras in the base, found", "1 or m"): rig.X_BL.ravel(),
            column("truth", "cameras in the base, as built", "1 or m"): day.truth.X_BL.ravel(),
        },
    )


def nearest_turn_deg(block: np.ndarray) -> float:
    """Angle of the rotation nearest to a 3x3 block [deg]."""
    U, _, Vt = np.linalg.svd(block)
    return float(np.degrees(np.linalg.norm(se3.rotation_vector(se3.pose(U @ Vt, np.zeros(3))))))
