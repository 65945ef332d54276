"""Figures of merit that a log gives without knowing the truth: tracking, joint speeds, timing."""

import numpy as np

from breastscan.run.trajectory import Trajectory


def of_execution(
    trajectory: Trajectory, speed_fluctuation_pct: float, execution_wall: float
) -> dict[str, object]:
    """Executed minus planned tip at equal path parameter, in B, over the loop; joint speeds; how
    the clock ran.

    On soft tissue the normal part of the tracking error contains the indentation.

    Args:
        trajectory: What was done.
        speed_fluctuation_pct: Of the planned feed [%].
        execution_wall: Wall time that the execution took [s]; of a scan that was resumed, since
            then.

    Returns:
        Metrics named as in `metrics.json`.
    """
    error_mm = trajectory.path_errors_mm()
    parts_s = [float(part[-1] - part[0]) for part in trajectory.parts()]
    scan_time = sum(parts_s)
    return {
        "tracking_mean_abs_mm": np.abs(error_mm).mean(axis=0).tolist(),
        "tracking_std_mm": error_mm.std(axis=0, ddof=1).tolist(),
        "tracking_tangential_rmse_mm": rms(trajectory.tangential_errors_mm()),
        "tracking_normal_rmse_mm": rms(trajectory.normal_errors_mm()),
        "joint_speed_peak_rad_s": np.abs(trajectory.qd[trajectory.in_loop]).max(axis=0).tolist(),
        "speed_fluctuation_pct": speed_fluctuation_pct,
        "scan_time_s": scan_time,
        "realtime_factor": parts_s[-1] / execution_wall,
    }


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
