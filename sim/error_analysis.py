"""How far is each stage from the truth? The simulation knows the skin, so every error is told from
every other.

Reads what a scan made and what the twin logged; nothing here flows back into the scan.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from breastscan.geometry import se3
from breastscan.planning.pattern import Path
from breastscan.run.metrics import rms
from breastscan.run.trajectory import Trajectory
from breastscan.scan import Reconstruction
from breastscan.vision.camera import RectifiedPair, StereoRig
from sim.tissue.contact import Mechanics
from sim.truth import Truth
from sim.truth_log import TruthLog

STEADY_AFTER = 1.0
"""Force is judged from this long after the loop starts [s]: until then the contact settles into the
motion."""
REPLAY_STEP = 20
"""Every so many control periods the contact is solved again, to find its place on the skin (every
millimetre)."""
PATH_SAMPLES = 1000
"""Points at which the planned curve is held against the skin."""


@dataclass(frozen=True, kw_only=True)
class ContactPlaces:
    """Where the probe really touched, at some rows of the trajectory."""

    rows: Int[np.ndarray, "k"]
    """Indices into the trajectory."""
    p_S: Float[np.ndarray, "k 3"]
    """The touched point, mapped to the undeformed skin [m]."""
    tilt: Float[np.ndarray, "k"]
    """Angle of the probe's axis against the true normal where it meets the undeformed skin
    [rad]."""


def surface_metrics(
    reconstruction: Reconstruction, rig: StereoRig, X_SL: Float[np.ndarray, "4 4"], truth: Truth
) -> dict[str, float]:
    """Reconstructed points and normals against the true skin.

    Every point counts, also one where no skin is; the density is the fraction of the pixels seeing
    skin that the right camera sees too, that have a point.
    """
    found = np.isfinite(reconstruction.points_L[..., 0])
    error_mm = truth.distance(se3.transform(X_SL, reconstruction.points_L[found])) * 1e3
    _, n_true_S = truth.closest(se3.transform(X_SL, reconstruction.sampled_L))
    n_S = se3.rotate(X_SL, reconstruction.normals_L)
    tilt_deg = np.degrees(se3.angle_between(n_S, n_true_S))
    seen = seen_by_both(reconstruction.pair, rig, X_SL, truth)
    return {
        "surface_rmse_mm": rms(error_mm),
        "surface_p95_mm": float(np.quantile(np.abs(error_mm), 0.95)),
        "surface_density": float(found[seen].mean()),
        "normal_mean_deg": float(tilt_deg.mean()),
        "normal_p95_deg": float(np.quantile(tilt_deg, 0.95)),
    }


def seen_by_both(
    pair: RectifiedPair, rig: StereoRig, X_SL: Float[np.ndarray, "4 4"], truth: Truth
) -> Bool[np.ndarray, "h w"]:
    """Pixels of the rectified left view that see skin which the right camera sees too."""
    (cx, cy), f = pair.centre_px, pair.focal_px
    X_SV = X_SL @ se3.pose(pair.R_LV, np.zeros(3))
    box = _box_of(truth.ball, X_SV, pair)
    rows, columns = np.mgrid[box]
    rays_V = np.stack([(columns - cx) / f, (rows - cy) / f, np.ones(rows.shape)], axis=-1)
    hits_S = truth.cast(X_SL[:3, 3], rays_V.reshape(-1, 3) @ X_SV[:3, :3].T)
    part = np.isfinite(hits_S[:, 0])
    right_S = (X_SL @ se3.inverse(rig.X_RL))[:3, 3]
    part[part] = truth.visible(hits_S[part], right_S)
    seen = np.zeros(pair.left.shape, bool)
    seen[box] = part.reshape(rows.shape)
    return seen


def _box_of(
    ball: tuple[Float[np.ndarray, "3"], float], X_SV: Float[np.ndarray, "4 4"], pair: RectifiedPair
) -> tuple[slice, slice]:
    """Rows and columns of the rectified view outside of which no pixel sees a ball before it: those
    of the corners of a cube around it.
    """
    centre_S, radius = ball
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    corners_V = se3.transform(se3.inverse(X_SV), centre_S) + radius * signs
    places = corners_V[:, 1::-1] / corners_V[:, 2:] * pair.focal_px + pair.centre_px[::-1]
    first, end = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0)) + 1
    sides = np.clip([first, end], 0, pair.left.shape).astype(int)
    return slice(sides[0, 0], sides[1, 0]), slice(sides[0, 1], sides[1, 1])


def path_metrics(
    paths: Sequence[Path], X_BS: Float[np.ndarray, "4 4"], truth: Truth
) -> dict[str, float]:
    """The planned curves against the true skin."""
    u = np.linspace(0.0, 1.0, PATH_SAMPLES // len(paths))
    points_B = np.concatenate([path.curve.evaluate(u) for path in paths])
    return {
        "path_surface_rmse_mm": rms(
            truth.distance(se3.transform(se3.inverse(X_BS), points_B)) * 1e3
        )
    }


def with_truth(
    trajectory: Trajectory, log: TruthLog, places: ContactPlaces | None = None
) -> Trajectory:
    """The trajectory with the true contact beside the measured one.

    Given `places`, the tilt as well: interpolated between them, NaN where there is no contact.
    """
    rows = matching_rows(trajectory, log)
    force = log.force_axial[rows]
    tilt = None
    if places is not None:
        between = np.interp(np.arange(len(force)), places.rows, places.tilt)
        tilt = np.where(force > 0, between, np.nan)
    return replace(trajectory, true_force=force, true_depth=log.depth[rows], true_tilt=tilt)


def matching_rows(trajectory: Trajectory, log: TruthLog) -> Int[np.ndarray, "n"]:
    """Rows of the truth at the trajectory's instants; both run on the robot's clock."""
    rows = np.searchsorted(log.time, trajectory.t)
    assert np.array_equal(log.time[rows], trajectory.t), (
        "the truth and the trajectory share one clock"
    )
    return rows


def contact_places(
    trajectory: Trajectory,
    log: TruthLog,
    tissue: Mechanics,
    truth: Truth,
    on_press: Callable[[int, Float[np.ndarray, "v 3"]], None] = lambda row, skin_S: None,
) -> ContactPlaces:
    """Press the probe again where it was during the loop, and look up which point of the skin
    lies under its tip.

    Pressing drags the skin along, so the touched point comes from beside the probe's axis. How the
    probe should stand follows from where it presses, so its tilt counts against the normal there.

    `on_press` is told each row of the truth that was pressed again, and the skin as it then lies.
    """
    on_loop = np.flatnonzero(trajectory.in_loop)[::REPLAY_STEP]
    rows = matching_rows(trajectory, log)[on_loop]
    X_SP, points = log.X_SP[rows], []
    for row, skin_S in pressed_again(rows, log, tissue):
        points.append(truth.material_point(log.X_SP[row, None, :3, 3], skin_S)[0])
        on_press(row, skin_S)
    _, n_S = truth.pressed_place(X_SP)
    return ContactPlaces(
        rows=on_loop, p_S=np.array(points), tilt=se3.angle_between(-X_SP[:, :3, 2], n_S)
    )


def pressed_again(
    rows: Int[np.ndarray, "n"], log: TruthLog, tissue: Mechanics
) -> Iterator[tuple[int, Float[np.ndarray, "v 3"]]]:
    """Some rows of the truth, at each of which the skin lies as it did then, pressed by a probe at
    rest; the tissue rests at the end.
    """
    for row in rows.tolist():
        tissue.press(log.X_SP[row], np.zeros(3))
        yield row, tissue.deformed_skin()
    tissue.reset()


def rows_off_loop(trajectory: Trajectory, log: TruthLog) -> Int[np.ndarray, "n"]:
    """Every `REPLAY_STEP`th row of the truth that `contact_places` leaves out, and the one in which
    something rigid was pressed hardest.
    """
    wanted = np.arange(len(log.time)) % REPLAY_STEP == 0
    wanted[matching_rows(trajectory, log)[trajectory.in_loop]] = False
    wanted[log.rigid_force.argmax()] |= log.rigid_force.any()
    return np.flatnonzero(wanted)


def execution_metrics(
    places: ContactPlaces,
    X_BS: Float[np.ndarray, "4 4"],
    truth: Truth,
    height_fraction: float | None,
) -> dict[str, object]:
    """The whole chain: touched points of the undeformed skin minus the true loop at the height that
    was asked for, in B, and how the probe stood.
    """
    tilt: dict[str, object] = {"normal_tilt_mean_deg": float(np.degrees(places.tilt.mean()))}
    if height_fraction is None:
        return tilt
    nearest_S = nearest_on_loop(places.p_S, truth.level_loop(height_fraction))
    error_mm = se3.rotate(X_BS, places.p_S - nearest_S) * 1e3
    return {
        "executed_truth_mean_abs_mm": np.abs(error_mm).mean(axis=0).tolist(),
        "executed_truth_rms_mm": rms(np.linalg.norm(error_mm, axis=1)),
    } | tilt


def nearest_on_loop(
    p: Float[np.ndarray, "n 3"], loop: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "n 3"]:
    """The points of a closed polygon that are nearest to others, on its sides as on its corners."""
    sides = np.roll(loop, -1, axis=0) - loop
    squared = np.einsum("mc,mc->m", sides, sides)
    nearest = np.empty_like(p)
    for row, point in enumerate(p):
        along = np.clip(np.einsum("mc,mc->m", point - loop, sides) / squared, 0.0, 1.0)
        feet = loop + along[:, None] * sides
        nearest[row] = feet[np.einsum("mc,mc->m", feet - point, feet - point).argmin()]
    return nearest


def force_metrics(trajectory: Trajectory, set_point: float) -> dict[str, float]:
    """True contact force along the probe axis, over the loop from `STEADY_AFTER` on, where it came
    so far; contact over the whole loop.
    """
    assert trajectory.true_force is not None, "`with_truth` comes first"
    assert trajectory.true_depth is not None, "`with_truth` comes first"
    force, loop = trajectory.true_force[trajectory.in_loop], trajectory.in_loop
    steady = force[trajectory.time_on_stroke[loop] >= STEADY_AFTER]
    extremes = {}
    if steady.size > 0:
        extremes = {
            "force_rmse_n": rms(steady - set_point),
            "force_peak_n": float(steady.max()),
            "force_min_n": float(steady.min()),
        }
    return extremes | {
        "contact_fraction": float((force > 0).mean()),
        "indentation_max_mm": float(trajectory.true_depth.max() * 1e3),
    }


def breathing_metrics(trajectory: Trajectory, log: TruthLog) -> dict[str, float]:
    """How the chest moved during the loop."""
    rise = log.rise[matching_rows(trajectory, log)[trajectory.in_loop]]
    return {"breathing_amplitude_mm": float(np.ptp(rise) / 2 * 1e3)}
