"""A planned motion as files that other software takes: tables of joint angles and tool poses, and a UR program.

The program needs nothing but the robot's controller: it carries the trajectory with it, at `KNOT_PERIOD`, and
interpolates it there by cubics at the controller's 500 Hz.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.planning.motion import Motion
from breastscan.run import writing

KNOT_PERIOD = 0.04
"""Time between the trajectory's points in the program [s]: a loop has some 400, a program of 120 kB."""
SERVO_PERIOD = 0.002
"""Control period of an e-Series controller [s]."""
LOOKAHEAD_TIME = 0.03
"""Of servoj [s]: the shortest, which lags least."""
GAIN = 1200
"""Of servoj, 100 to 2000: what lags little without noise (UR client library)."""
JOINT_SPEED, JOINT_ACCELERATION = 0.5, 0.5
"""Of the movej to the approach pose [rad/s, rad/s^2]."""
TOOL_SPEED, TOOL_ACCELERATION = 0.02, 0.1
"""Of the movel onto the skin and off it [m/s, m/s^2]."""
STOP_DECELERATION = 2.0
"""Of stopj at the end of the path [rad/s^2]."""
COLUMNS = ("t_s", *(f"q{k}_rad" for k in range(1, 7)), "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
"""Of the exported table: time, joint angles, and the tool's pose in B as Universal Robots write it."""

PROGRAM = """\
# Written by breastscan. Follows a planned path with the probe's tip on the planned skin, WITHOUT force control.
# Run it first in the air and at reduced speed; the protective stop is the robot's own.
def breastscan_path():
  set_tcp({tcp})

  # the joint angles from q0 to q1 in {knot_period} s, at speeds v0 and v1 there, by a cubic
  def follow(q0, v0, q1, v1):
    local q = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    local k = 1
    while k <= {steps}:
      s = k / {steps}.0
      a = 1.0 - 3.0 * s * s + 2.0 * s * s * s
      b = {knot_period} * (s - 2.0 * s * s + s * s * s)
      c = 3.0 * s * s - 2.0 * s * s * s
      d = {knot_period} * (s * s * s - s * s)
      j = 0
      while j < 6:
        q[j] = a * q0[j] + b * v0[j] + c * q1[j] + d * v1[j]
        j = j + 1
      end
      servoj(q, t={servo_period}, lookahead_time={lookahead_time}, gain={gain})
      k = k + 1
    end
  end

  movej({q_approach}, a={joint_acceleration}, v={joint_speed})
  movel({q_first}, a={tool_acceleration}, v={tool_speed})
{segments}
  stopj({stop_deceleration})
  movel({q_retreat}, a={tool_acceleration}, v={tool_speed})
end
"""


def table(motion: Motion, X_FP: Float[np.ndarray, "4 4"], X_BF: Float[np.ndarray, "n 4 4"]) -> pl.DataFrame:
    """The motion as a table with `COLUMNS`, one row a control period.

    Args:
        motion: What was planned.
        X_FP: Probe tip in the flange.
        X_BF: Where the arm's own kinematics put the flange in each row.
    """
    X_BP = X_BF @ X_FP
    values = np.hstack([motion.feed.t[:, None], motion.joints.q, X_BP[:, :3, 3], se3.rotation_vector(X_BP)])
    return pl.DataFrame(values, schema=list(COLUMNS))


def write(folder: Path, motion: Motion, X_FP: Float[np.ndarray, "4 4"], X_BF: Float[np.ndarray, "n 4 4"]) -> None:
    """Write `trajectory.csv` and `trajectory.json`; see `table` for the arguments."""
    rows = table(motion, X_FP, X_BF)
    rows.write_csv(folder / "trajectory.csv", float_precision=9)
    joints = motion.joints
    content = {
        "tcp": ur_pose(X_FP),
        "q_approach_rad": joints.q_approach,
        "q_retreat_rad": joints.q_retreat,
        "columns": COLUMNS,
        "rows": rows.to_numpy().round(9),
    }
    writing.write_json(folder / "trajectory.json", content)


def urscript(motion: Motion, X_FP: Float[np.ndarray, "4 4"]) -> str:
    """A program for the controller: to the approach pose, onto the skin, along the path, off the skin.

    Args:
        motion: What was planned.
        X_FP: Probe tip in the flange, which the program sets as the tool's centre point.
    """
    joints = motion.joints
    return PROGRAM.format(
        tcp="p" + _list(ur_pose(X_FP)),
        knot_period=KNOT_PERIOD,
        steps=round(KNOT_PERIOD / SERVO_PERIOD),
        servo_period=SERVO_PERIOD,
        lookahead_time=LOOKAHEAD_TIME,
        gain=GAIN,
        q_approach=_list(joints.q_approach),
        q_first=_list(joints.q[0]),
        q_retreat=_list(joints.q_retreat),
        segments="\n".join(_segments(motion)),
        joint_speed=JOINT_SPEED,
        joint_acceleration=JOINT_ACCELERATION,
        tool_speed=TOOL_SPEED,
        tool_acceleration=TOOL_ACCELERATION,
        stop_deceleration=STOP_DECELERATION,
    )


def ur_pose(X_AB: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6"]:
    """A pose as Universal Robots write it: position [m], then rotation vector [rad]."""
    return np.concatenate([X_AB[:3, 3], se3.rotation_vector(X_AB)])


def _segments(motion: Motion) -> Iterator[str]:
    """One call of the program's `follow` for each pair of knots."""
    t, joints = motion.feed.t, motion.joints
    knots = np.linspace(0.0, t[-1], int(np.ceil(t[-1] / KNOT_PERIOD)) + 1)
    stretched = knots[-1] / ((len(knots) - 1) * KNOT_PERIOD)  # whole segments: a little slower than planned
    q = np.stack([np.interp(knots, t, column) for column in joints.q.T], axis=1)
    qd = stretched * np.stack([np.interp(knots, t, column) for column in joints.qd.T], axis=1)
    for k in range(len(knots) - 1):
        yield f"  follow({_list(q[k])}, {_list(qd[k])}, {_list(q[k + 1])}, {_list(qd[k + 1])})"


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{value:.7f}" for value in values) + "]"
