"""A planned motion as a program that needs nothing but the robot's controller.

It carries the trajectory with it, at `KNOT_PERIOD`, and interpolates it there by cubics at the
controller's 500 Hz.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.robot.ur.ur5e import PERIOD, SERVO

KNOT_PERIOD = 0.04
"""Time between the trajectory's points in the program [s]: a loop has some 400, a program of 120
kB."""
GAIN = 1200
"""Of servoj, 100 to 2000: what lags little without noise (UR client library)."""
JOINT_SPEED, JOINT_ACCELERATION = 0.5, 0.5
"""Of the movej to the approach pose [rad/s, rad/s^2]."""
TOOL_SPEED, TOOL_ACCELERATION = 0.02, 0.1
"""Of the movel onto the skin and off it [m/s, m/s^2]."""
STOP_DECELERATION = 2.0
"""Of stopj at the end of the path [rad/s^2]."""

PROGRAM = """\
# Written by breastscan. Follows a planned path with the probe's tip on the planned skin,
# WITHOUT force control.
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


def urscript(
    q: Float[np.ndarray, "n 6"],
    qd: Float[np.ndarray, "n 6"],
    q_approach: Float[np.ndarray, "6"],
    q_retreat: Float[np.ndarray, "6"],
    X_FP: Float[np.ndarray, "4 4"],
) -> str:
    """A program for the controller: to the approach pose, onto the skin, along the path, off the
    skin.

    Args:
        q: Joint angles on the path, one row a period of the controller [rad].
        qd: Their speeds [rad/s].
        q_approach: Joint angles clear of the skin before the path [rad].
        q_retreat: And after it [rad].
        X_FP: Probe tip in the flange, which the program sets as the tool's centre point.
    """
    return PROGRAM.format(
        tcp="p" + _list(se3.pose_vector(X_FP)),
        knot_period=KNOT_PERIOD,
        steps=round(KNOT_PERIOD / PERIOD),
        servo_period=PERIOD,
        lookahead_time=SERVO.lookahead_time,
        gain=GAIN,
        q_approach=_list(q_approach),
        q_first=_list(q[0]),
        q_retreat=_list(q_retreat),
        segments="\n".join(_segments(q, qd)),
        joint_speed=JOINT_SPEED,
        joint_acceleration=JOINT_ACCELERATION,
        tool_speed=TOOL_SPEED,
        tool_acceleration=TOOL_ACCELERATION,
        stop_deceleration=STOP_DECELERATION,
    )


def _segments(q: Float[np.ndarray, "n 6"], qd: Float[np.ndarray, "n 6"]) -> Iterator[str]:
    """One call of the program's `follow` for each pair of knots."""
    t = PERIOD * np.arange(len(q))
    knots = np.linspace(0.0, t[-1], int(np.ceil(t[-1] / KNOT_PERIOD)) + 1)
    # whole segments: a little slower than planned
    stretched = knots[-1] / ((len(knots) - 1) * KNOT_PERIOD)
    q = np.stack([np.interp(knots, t, column) for column in q.T], axis=1)
    qd = stretched * np.stack([np.interp(knots, t, column) for column in qd.T], axis=1)
    for k in range(len(knots) - 1):
        yield f"  follow({_list(q[k])}, {_list(qd[k])}, {_list(q[k + 1])}, {_list(qd[k + 1])})"


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{value:.7f}" for value in values) + "]"
