"""How much CPU time do curve, inverse kinematics and planning of a loop take, how long is the
planned motion, and what do their peers make of it?
"""

import time
from collections.abc import Callable

import geomdl.BSpline
import geomdl.NURBS
import numpy as np
from scipy.interpolate import make_interp_spline

from breastscan.geometry import kinematics, se3
from breastscan.geometry.nurbs import Nurbs
from breastscan.planning import feedrate, motion
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.pattern import Path
from breastscan.robot.ur.ur5e import PERIOD
from experiments.peers import peer

CURVE_POINTS = 1_000_000
"""Parameters at which a curve and its first two derivatives are evaluated."""
SLOW_CURVE_POINTS = 500
"""As many as geomdl gets; its time is scaled up."""
POSES = 100_000
"""Poses solved by the inverse kinematics."""
SINGLE_CALLS = 2_000
"""Calls of forward and Jacobian for one configuration, as a controller makes them."""
NO_JERK_LIMIT = 1e6
"""So high that it does not bind [m/s^3]."""
GRID = 8_000
"""Places along a curve at which TOPP-RA holds the limits."""
LONG_TURNS = 4
"""Of the path that shows how planning time grows with length."""
REPEATS = 3
"""Each time is the minimum of so many."""

Row = tuple[str, float, float, float]


def rows() -> list[Row]:
    """What was timed, own CPU time [s], the peer's or the budget [s], and peer over own."""
    return [*_curve_rows(), *_kinematics_rows(), *_planning_rows(), *_feedrate_rows()]


def _row(what: str, own: float, peer: float) -> Row:
    return what, own, peer, peer / own


def _cpu_seconds(work: Callable[[], object]) -> float:
    """Minimum CPU time of a few runs, after one that compiles."""
    work()
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def _ring() -> Path:
    """A loop of 62 mm radius in front of the arm, its normals 50 degrees off vertical."""
    angle = np.pi + np.linspace(0.0, 2 * np.pi, 15, endpoint=False)
    outwards = np.stack([np.cos(angle), np.sin(angle), np.zeros(15)], axis=1)
    tilt = np.radians(50.0)
    return Path(
        points_B=np.array([0.5, 0.0, 0.1075]) + 0.062 * outwards,
        normals_B=np.sin(tilt) * outwards + np.array([0.0, 0.0, np.cos(tilt)]),
    )


def _curve_rows() -> list[Row]:
    path = _ring()
    curve = path.curve
    weighted = Nurbs.interpolate(path.points_B, weights=np.linspace(1.0, 3.0, len(path.points_B)))
    peer = make_interp_spline(
        curve.breaks, np.vstack([path.points_B, path.points_B[:1]]), bc_type="periodic"
    )
    u = np.random.default_rng(0).uniform(0.0, 1.0, CURVE_POINTS)
    plain_seconds = _cpu_seconds(lambda: [curve.evaluate(u, order) for order in range(3)])
    weighted_seconds = _cpu_seconds(lambda: weighted.derivatives(u, 2))
    scipy_seconds = _cpu_seconds(lambda: [peer(u, nu=order) for order in range(3)])
    what = "1e6 curve points with two derivatives"
    return [
        _row(f"{what}, against SciPy", plain_seconds, scipy_seconds),
        _row(
            f"{what}, against geomdl",
            plain_seconds,
            _geomdl_seconds(geomdl.BSpline.Curve, curve, u),
        ),
        _row(
            f"{what}, rational, against geomdl",
            weighted_seconds,
            _geomdl_seconds(geomdl.NURBS.Curve, weighted, u),
        ),
    ]


def _geomdl_seconds(kind: type, curve: Nurbs, u: np.ndarray) -> float:
    peer = kind(normalize_kv=False)
    peer.degree = 3
    peer.ctrlpts = curve.control_points.tolist()
    if curve.is_rational:
        peer.weights = curve.weights.tolist()
    peer.knotvector = curve.spline.t.tolist()
    few = u[:SLOW_CURVE_POINTS].tolist()
    return (
        _cpu_seconds(lambda: [peer.derivatives(value, order=2) for value in few])
        * CURVE_POINTS
        / SLOW_CURVE_POINTS
    )


def _kinematics_rows() -> list[Row]:
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, 6))
    X_BF = kinematics.forward(q)

    def single_calls() -> None:
        for one in q[:SINGLE_CALLS]:
            kinematics.forward(one)
            kinematics.jacobian(one)

    inverse_seconds = _cpu_seconds(lambda: kinematics.inverse_branches(X_BF))
    single_seconds = _cpu_seconds(single_calls) / SINGLE_CALLS
    return [
        _row(
            "all branches of 1e5 inverse kinematics, against a budget of 1 s", inverse_seconds, 1.0
        ),
        _row(
            "forward and Jacobian of one configuration, against a budget of 60 us",
            single_seconds,
            60e-6,
        ),
    ]


def _planning_rows() -> list[Row]:
    X_FP = se3.from_rotation_vector(
        np.array([0.0, np.radians(45.0), 0.0]), np.array([0.0, 0.0, 0.06])
    )
    X_FP = X_FP @ se3.pose(np.eye(3), np.array([0.0, 0.0, 0.14]))

    def seconds(path: Path) -> float:
        return _cpu_seconds(
            lambda: motion.plan_motion(path, X_FP, PERIOD, FeedrateLimits(), JointPathConfig())
        )

    return [
        _row(
            "a loop from 15 points to joint angles at 500 Hz, against a budget of .5 s",
            seconds(_ring()),
            0.5,
        ),
        _row(
            f"a helix of {LONG_TURNS} turns, against {LONG_TURNS} of one",
            seconds(_helix(LONG_TURNS)),
            LONG_TURNS * seconds(_helix(1)),
        ),
    ]


def _feedrate_rows() -> list[Row]:
    """Here the times are those that the motions take [s]: the peer's is the least there is without
    a limit on the jerk, under the same limits of speed, acceleration, normal acceleration and chord
    error.
    """
    toppra = peer("toppra")
    if toppra is None:
        return []
    toppra.setup_logging("ERROR")
    found = []
    for name, curve in _figures().items():
        for jerk in (NO_JERK_LIMIT, FeedrateLimits().jerk):
            limits = FeedrateLimits(jerk=jerk)
            own = float(feedrate.interpolate(curve, limits, PERIOD).t[-1])
            what = f"motion along a {name}, jerk to {jerk:g} m/s^3, against TOPP-RA without"
            found.append(_row(what, own, _toppra_seconds(toppra, curve, limits)))
    return found


def _figures() -> dict[str, Nurbs]:
    """Curves of some hundred millimetres."""
    angle = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    side = np.linspace(0.0, 0.1, 20, endpoint=False)
    low, high = np.zeros(20), np.full(20, 0.1)
    there = np.linspace(0.0, 0.1, 8)
    drawn = {
        "figure of eight": (0.06 * np.sin(angle), 0.03 * np.sin(2 * angle)),
        "square": (
            np.hstack([side, high, 0.1 - side, low]),
            np.hstack([low, side, high, 0.1 - side]),
        ),
        "hairpin": (np.hstack([there, there[::-1]]), np.repeat([0.0, 2e-3], 8)),
    }
    return {"ring": _ring().curve} | {
        name: Nurbs.interpolate(
            np.stack([x, y, np.zeros_like(x)], axis=1), closed=name != "hairpin"
        )
        for name, (x, y) in drawn.items()
    }


def _toppra_seconds(toppra, curve: Nurbs, limits: FeedrateLimits) -> float:
    """Length is its one joint, in mm: it takes numbers of a size of 1."""
    steps = np.linspace(0.0, 1.0, GRID // (len(curve.breaks) - 1), endpoint=False)
    spans = curve.breaks[:-1, None] + np.diff(curve.breaks)[:, None] * steps
    u = np.append(spans.ravel(), 1.0)
    s = 1e3 * curve.arc_length(u)
    speed = 1e3 * feedrate.speed_limit(curve.curvature(u), limits, PERIOD)
    acceleration = 1e3 * limits.acceleration
    solver = toppra.algorithm.TOPPRA(
        [
            toppra.constraint.JointVelocityConstraintVarying(
                lambda x: np.array([[-1.0, 1.0]]) * np.interp(x, s, speed)
            ),
            toppra.constraint.JointAccelerationConstraint([[-acceleration, acceleration]]),
        ],
        toppra.SplineInterpolator([0.0, s[-1]], [[0.0], [s[-1]]]),
        gridpoints=s,
        parametrizer="ParametrizeConstAccel",
        solver_wrapper="seidel",
    )
    return float(solver.compute_trajectory(0.0, 0.0).duration)


def _helix(turns: int) -> Path:
    """Turns of 62 mm radius above each other, the probe upright."""
    angle = np.linspace(0.0, 2 * np.pi * turns, 15 * turns + 1)
    height = 0.1 + 0.005 * angle / (2 * np.pi)
    points_B = np.stack([0.5 + 0.062 * np.cos(angle), 0.062 * np.sin(angle), height], axis=1)
    return Path(
        points_B=points_B, normals_B=np.tile([0.0, 0.0, 1.0], (len(angle), 1)), closed=False
    )


if __name__ == "__main__":
    for what, own, other, ratio in rows():
        print(f"{what:80} {own:10.3g} s {other:10.3g} s {ratio:8.3g}x")
