"""From where the arm stands, clear of the skin, to above the row of the plan at which contact is
made: from far away, or from where an earlier scan has left it, in contact or above.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.planning.motion import Motion
from breastscan.robot.interface import Robot

TRANSFER_SPEED = 0.6
"""Top joint speed of the free motions to and from the breast [rad/s]."""
TRANSFER_ACCELERATION = 0.8
"""Joint acceleration of the free motions [rad/s^2]."""
NEAR = 0.05
"""Joint distance within which a robot still stands where an earlier scan left it [rad]."""
BESIDE_STEP = 25
"""Rows from one place of the path to the next at which a robot is looked for."""
HOP_LENGTH = 0.025
"""Of a free motion above the path [m], which the skin does not meet."""


@dataclass(frozen=True)
class Place:
    """Where an earlier scan has left the arm: on the path, or above it."""

    row: int
    """Of the plan, the nearest."""
    q_lifted: Float[np.ndarray, "6"]
    """Joint angles clear of the skin above it [rad]."""
    touching: bool
    """Whether the probe is nearer to the skin there than to being clear of it."""


def place(robot: Robot, motion: Motion) -> Place | None:
    """Where on the plan a robot stands; None for anywhere else."""
    q, last = robot.state().q, len(motion.q) - 1
    rows = np.array([*range(0, last, BESIDE_STEP), last])
    lifted = np.array([_lifted(robot, motion, row) for row in rows.tolist()])
    distance = np.stack([np.abs(motion.q[rows] - q), np.abs(lifted - q)]).max(axis=2).min(axis=0)
    nearest = int(np.nan_to_num(distance, nan=np.inf).argmin())
    if not distance[nearest] < NEAR:
        return None
    row = _row_under(robot, motion, int(rows[nearest]))
    q_lifted = _lifted(robot, motion, row)
    if np.isnan(q_lifted).any():
        return None
    on_path, above = (float(np.abs(q - other).max()) for other in (motion.q[row], q_lifted))
    return Place(row, q_lifted, touching=on_path < above)


def _row_under(robot: Robot, motion: Motion, near: int) -> int:
    """The row whose place on the path the probe's axis passes, near another one."""
    first = max(near - 2 * BESIDE_STEP, 0)
    X_BP = robot.calibration.forward(robot.state().q) @ robot.X_FP
    path = motion.q[first : near + 2 * BESIDE_STEP + 1]
    offset = (robot.calibration.forward(path) @ robot.X_FP)[:, :3, 3] - X_BP[:3, 3]
    across = offset - np.outer(offset @ X_BP[:3, 2], X_BP[:3, 2])
    return first + int(np.linalg.norm(across, axis=1).argmin())


def go_above(robot: Robot, motion: Motion, beside: Place | None, start: int) -> int:
    """Bring the probe clear of the skin above the row at which contact is to be made, or above one
    from which its stroke leads there; which one.

    Args:
        robot: The twin or the real arm.
        motion: Its plan.
        beside: Where it stands on the plan; None for anywhere else.
        start: The row.

    Raises:
        RobotError: The robot refused.
    """
    if beside is not None and (start > 0 or beside.touching):
        transfer(robot, beside.q_lifted)  # up the normal
        way = float(motion.s[start] - motion.s[beside.row])
        if way > HOP_LENGTH and motion.stroke_of(beside.row) == motion.stroke_of(start):
            return beside.row
        hops = math.ceil(abs(way) / HOP_LENGTH)
        for row in np.linspace(beside.row, start, hops + 1).round().astype(int)[1:].tolist():
            transfer(robot, _lifted(robot, motion, row))
        return start
    if np.abs(robot.state().q - _lifted(robot, motion, start)).max() < NEAR:
        transfer(robot, _lifted(robot, motion, start))
        return start
    first = motion.starts[motion.stroke_of(start)]
    transfer(robot, _lifted(robot, motion, first) if first else motion.q_approach)
    return first


def follow_way(robot: Robot, motion: Motion, stroke: int) -> None:
    """Move freely on the way that leads to a stroke, or after the last one home, but to its end.

    Raises:
        RobotError: The robot refused.
    """
    for q in (q for way in motion.ways[stroke : stroke + 1] for q in way):
        transfer(robot, q)


def transfer(robot: Robot, q: Float[np.ndarray, "6"]) -> None:
    """Move freely to joint angles [rad].

    Raises:
        RobotError: The robot refused.
    """
    robot.move_joint(q, TRANSFER_SPEED, TRANSFER_ACCELERATION)


def _lifted(robot: Robot, motion: Motion, row: int) -> Float[np.ndarray, "6"]:
    """Joint angles clear of the skin above a row [rad]; NaN where there are none."""
    return motion.lifted(row, robot.X_FP, robot.calibration)
