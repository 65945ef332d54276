"""A run folder as a scan on soft tissue would leave it, drawn from formulas, for the tests of
the report.
"""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import polars
import trimesh

from breastscan.geometry import se3
from breastscan.run.trajectory import Trajectory

PERIOD = 0.002
LOOP_RADIUS = 0.062
LOOP_CENTRE_B = np.array([0.5, 0.0, 0.1075])
NORMAL_ELEVATION = np.deg2rad(40.0)
"""Elevation of the skin's normal at half height [rad]."""
SET_POINT = 5.0
INDENTATION = 0.006
SLIP = 0.0004
"""Amplitude of the error that is not indentation [m]."""
PHASES = (("approach", 3.0), ("settle", 2.0), ("loop", 16.0), ("retreat", 1.5))
"""Phases and how long each takes [s]."""

METRICS = {
    "surface_rmse_mm": 0.0812,
    "surface_p95_mm": 0.171,
    "surface_density": 0.981,
    "normal_mean_deg": 0.74,
    "normal_p95_deg": 1.62,
    "calibration_reprojection_px": 0.113,
    "baseline_error_mm": 0.021,
    "handeye_error_mm": 0.19,
    "handeye_error_deg": 0.018,
    "path_surface_rmse_mm": 0.143,
    "speed_fluctuation_pct": 2.1e-8,
    "tracking_mean_abs_mm": [2.81, 2.79, 3.77],
    "tracking_std_mm": [3.2, 3.1, 0.41],
    "tracking_tangential_rmse_mm": 0.72,
    "tracking_normal_rmse_mm": 5.9,
    "executed_truth_mean_abs_mm": [0.31, 0.28, 0.22],
    "executed_truth_rms_mm": 0.52,
    "normal_tilt_mean_deg": 1.31,
    "clearance_body_min_mm": 6.1,
    "breathing_amplitude_mm": 0.0,
    "joint_speed_peak_rad_s": [0.21, 0.18, 0.25, 0.17, 0.09, 0.47],
    "force_rmse_n": 0.064,
    "force_peak_n": 5.21,
    "force_min_n": 4.79,
    "force_any_peak_n": 5.24,
    "contact_fraction": 1.0,
    "scan_time_s": 22.5,
    "realtime_factor": 3.21,
    "wall_s": {"perceive": 1.32, "plan": 0.61, "execute": 7.02, "truth": 0.44},
}

CONFIG = {
    "seed": 7,
    "scan": {
        "contact": {"force": SET_POINT, "damping": 60.0},
        "feedrate": {"speed": 0.025},
        "denoise_neighbours": 15,
    },
    "scene": {"phantom": "soft", "youngs_modulus": 30e3},
    "versions": {"python": "3.11.2", "mujoco": "4.0.0", "numpy": "2.3.1"},
}


def write_run(
    folder: Path, *, with_truth: bool = True, with_loop: bool = True, seed: int = 0
) -> Path:
    """Write a whole run folder but for its video, and return it."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "metrics.json").write_text(json.dumps(METRICS), encoding="utf-8")
    (folder / "config.json").write_text(json.dumps(CONFIG), encoding="utf-8")
    _write_pictures(folder, rng)
    _write_cloud(folder / "cloud.ply", rng)
    _write_path(folder / "path.csv")
    log = synthetic_log(rng, with_truth=with_truth, with_loop=with_loop)
    log.save(folder / "trajectory.parquet", seed=seed)
    return folder


def loop_pose(angle: np.ndarray) -> np.ndarray:
    """Planned tip poses `X_BP` at angles around the loop [rad], the probe's axis into the skin."""
    outwards = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    tangent = np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)
    normal = np.cos(NORMAL_ELEVATION) * outwards + np.sin(NORMAL_ELEVATION) * np.array(
        [0.0, 0.0, 1.0]
    )
    R_BP = np.stack([tangent, np.cross(-normal, tangent), -normal], axis=-1)
    ripple = np.stack(
        [0.003 * np.cos(2 * angle), 0.004 * np.sin(3 * angle), 0.001 * np.sin(2 * angle)], axis=-1
    )
    return se3.pose(R_BP, LOOP_CENTRE_B + LOOP_RADIUS * outwards + ripple)


def synthetic_log(
    rng: np.random.Generator, *, with_truth: bool = True, with_loop: bool = True
) -> Trajectory:
    """The log of a scan, a row a control period."""
    phases = [(name, length) for name, length in PHASES if with_loop or name != "loop"]
    phase = np.repeat(
        [name for name, _ in phases], [round(length / PERIOD) for _, length in phases]
    )
    t = PERIOD * np.arange(len(phase))
    in_loop = phase == "loop"
    angle = np.where(phase == "retreat", 2 * np.pi, 0.0)
    angle[in_loop] = np.linspace(0.0, 2 * np.pi, in_loop.sum())
    depth = _depth(phase, t)
    X_plan = loop_pose(angle)
    X_BP = X_plan.copy()
    X_BP[:, :3, 3] += depth[:, None] * X_plan[:, :3, 2]
    X_BP[:, :3, 3] += SLIP * np.stack(
        [np.sin(5 * angle), np.cos(4 * angle), np.sin(7 * angle)], axis=-1
    )
    force = SET_POINT * np.maximum(depth, 0) / INDENTATION + 0.06 * np.sin(9 * angle)
    wrench = 0.05 * rng.standard_normal((len(t), 6))
    wrench[:, 2] -= force
    q_plan = _joint_angles(angle)
    qd_plan = np.gradient(q_plan, PERIOD, axis=0) * in_loop[:, None]

    def planned(values: np.ndarray) -> np.ndarray:
        return np.where(in_loop.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)

    log = Trajectory(
        t=t,
        phase=tuple(phase.tolist()),
        s=np.where(in_loop, LOOP_RADIUS * angle, np.nan),
        q=q_plan + np.deg2rad(0.5),
        qd=qd_plan + 0.003 * rng.standard_normal((len(t), 6)),
        target=q_plan,
        q_plan=planned(q_plan),
        qd_plan=planned(qd_plan),
        X_BP=X_BP,
        X_BP_plan=planned(X_plan),
        wrench_P=wrench,
        contact=depth > 0,
    )
    if not with_truth:
        return log
    tilt = np.deg2rad(1.3 + 0.4 * np.sin(6 * angle))
    depth = np.maximum(depth, 0.0)
    return replace(log, true_force=force, true_depth=depth, true_tilt=tilt)


def _depth(phase: np.ndarray, t: np.ndarray) -> np.ndarray:
    """How far the tip stands below the undeformed skin [m]: down in the approach, pressed in, up
    in the retreat.
    """
    settle, retreat = t[phase == "settle"][0], t[phase == "retreat"][0]
    press = INDENTATION * (1 - np.exp(-np.maximum(t - settle, 0) / 0.4))
    return press + 0.01 * np.minimum(t - settle, 0) - 0.03 * np.maximum(t - retreat, 0)


def _joint_angles(angle: np.ndarray) -> np.ndarray:
    """Smooth joint angles that swing as the loop does [rad]."""
    swing, centre = (
        np.array([0.5, 0.4, 0.6, 0.7, 0.12, 0.0]),
        np.array([0.0, -1.4, 1.8, -1.9, -1.57, 0.0]),
    )
    q = centre + swing * np.sin(angle[:, None] + np.arange(6))
    q[:, 5] = angle - np.pi + 0.2 * np.sin(angle)
    return q


def _write_pictures(folder: Path, rng: np.random.Generator) -> None:
    row, column = np.mgrid[:1024, :1280]
    height = np.sqrt(np.maximum(1 - (np.hypot(row - 512, column - 640) / 420) ** 2, 0))
    texture = cv2.GaussianBlur(rng.standard_normal((1024, 1280)), (0, 0), 2.0)
    for name, shift in (("left.png", 0), ("right.png", -60)):
        grey = np.roll(110 + 70 * height + 90 * texture, shift, axis=1) + rng.standard_normal(
            (1024, 1280)
        )
        cv2.imwrite(str(folder / name), np.clip(grey, 0, 255).astype(np.uint8))
    colours = cv2.applyColorMap((255 * height).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    colours[rng.random((1024, 1280)) < 0.01] = 0
    cv2.imwrite(str(folder / "disparity.png"), colours)


def _write_cloud(path: Path, rng: np.random.Generator, count: int = 4000) -> None:
    radius, angle = 0.075 * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    height = 0.055 * np.sqrt(1 - (radius / 0.0751) ** 2)
    offset = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    normals = offset / [0.075**2, 0.075**2, 0.055**2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = trimesh.Trimesh(
        vertices=offset + np.array([0.5, 0.0, 0.08]), vertex_normals=normals, process=False
    )
    path.write_bytes(trimesh.exchange.ply.export_ply(cloud, vertex_normal=True))


def _write_path(path: Path) -> None:
    X_BP = loop_pose(2 * np.pi * np.arange(15) / 15)
    values = np.hstack([X_BP[:, :3, 3], -X_BP[:, :3, 2]])
    names = ("x_m", "y_m", "z_m", "nx", "ny", "nz")
    polars.DataFrame(dict(zip(names, values.T, strict=True))).write_csv(path)
