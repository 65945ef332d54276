"""Joint angles and speeds over time, and how much of their limits a scan takes."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from breastscan.report import theme
from breastscan.run.trajectory import Trajectory

JOINTS = ("1 base", "2 shoulder", "3 elbow", "4 wrist 1", "5 wrist 2", "6 wrist 3")
ANGLE_LIMITS_DEG = (360.0, 360.0, 180.0, 360.0, 360.0, 360.0)
"""Largest joint angles either way, from Universal_Robots_ROS2_Description,
config/ur5e/joint_limits.yaml."""
SPEED_LIMIT_DEG_S = 180.0
"""Largest joint speed, same source."""
SAMPLES_SHOWN = 1000
"""Samples drawn a line: about one for each pixel of the page."""


def joint_angles(trajectory: Trajectory) -> Figure:
    """Six joint angles, measured and planned [Zhang, Fig. 19b]."""
    return _six_joints(trajectory, trajectory.q, trajectory.q_plan, "angle [°]")


def joint_speeds(trajectory: Trajectory) -> Figure:
    """Six joint speeds, measured and planned [Zhang, Fig. 19c]."""
    return _six_joints(trajectory, trajectory.qd, trajectory.qd_plan, "speed [°/s]")


def joint_limits(trajectory: Trajectory) -> Figure:
    """The range of angles and the highest speed of each joint, as shares of the limits."""
    lowest, highest = np.rad2deg(trajectory.q).min(axis=0), np.rad2deg(trajectory.q).max(axis=0)
    limit = np.array(ANGLE_LIMITS_DEG)
    speed = np.abs(np.rad2deg(trajectory.qd)).max(axis=0)
    figure, ((angles, speeds),) = theme.panels(1, 2, height_in=2.5, sharey=True)
    angles.barh(
        JOINTS,
        100 * (highest - lowest) / limit,
        left=100 * lowest / limit,
        color=theme.MEASURED,
        height=0.55,
    )
    theme.title(angles, "Angles used")
    angles.set(xlabel="share of the angle limit [%]", xlim=(-100, 100))
    speeds.barh(JOINTS, 100 * speed / SPEED_LIMIT_DEG_S, color=theme.MEASURED, height=0.55)
    theme.title(speeds, "Highest speed")
    speeds.set(xlabel="share of the speed limit [%]", xlim=(0, 100))
    angles.invert_yaxis()
    return figure


def _six_joints(
    trajectory: Trajectory,
    measured: Float[np.ndarray, "n 6"],
    planned: Float[np.ndarray, "n 6"],
    ylabel: str,
) -> Figure:
    figure, axes = theme.panels(3, 2, height_in=6.0, sharex=True)
    shown = slice(None, None, max(1, len(trajectory.elapsed) // SAMPLES_SHOWN))
    time, spans = trajectory.elapsed[shown], trajectory.spans()
    for joint, axis in enumerate(axes.flat):
        axis.plot(time, np.rad2deg(measured[shown, joint]), **theme.MEASURED_LINE, label="measured")
        axis.plot(time, np.rad2deg(planned[shown, joint]), **theme.PLANNED_LINE, label="planned")
        theme.shade_phases(axis, spans, named=joint == 0)
        theme.title(axis, f"Joint {JOINTS[joint]}")
    for axis in axes[:, 0]:
        axis.set_ylabel(ylabel)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    theme.legend_above(axes[0, 1])
    return figure
