# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""Loops, and the MuJoCo arm that walks them: with a fixed or a free roll, the probe straight or
bent on the flange.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import get_args

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from breastscan.planning import feedrate, joint_limits, motion
from breastscan.planning.clearance import Body
from breastscan.planning.feedrate import FeedrateLimits, Step
from breastscan.planning.joint_limits import JointPathConfig, LimitUse
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path
from breastscan.robot.ur.ur5e import PERIOD
from experiments import paper_loop
from sim.arm.servo import ServoConfig
from sim.robot import SimRobot
from sim.room.cell import cell_of
from sim.scene import Scene, SceneConfig
from sim.tissue.phantom import PhantomConfig

MOUNTS_DEG = (0.0, 45.0)
"""Angles between probe and flange."""
ROLL_TOLERANCES = {"fixed": 0.0, "free": np.pi / 2}
"""Freedom of the image plane about the probe's axis [rad]."""
FOOT = 2.5e-3
"""Height over the plate from which on skin counts as the breast's [m]."""
LIMITS = FeedrateLimits(speed=0.025, acceleration=0.020)
"""The paper's speed and acceleration."""
LOOP_POINTS = 15
"""As many as the paper's."""
DENSE_POINTS = 4000
"""Of the contour from which they are taken."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A closed path and the cell in which it lies."""

    name: str
    path: Path
    table_height: float
    """Top of the table in B [m]."""
    in_twin: bool
    """Whether the twin's own table and chest plate stand where the loop expects them."""


@dataclass(frozen=True, kw_only=True)
class Walk:
    """One loop with one mount and one freedom of the roll: as planned, and as the MuJoCo arm
    went.
    """

    loop: str
    mount_deg: float
    roll: str
    refused: str = ""
    """Why it could not be planned, empty if it could."""
    unreachable: tuple[str, ...] = ()
    """The loop's points that cannot be reached."""
    planned: Motion | None = None
    uses: list[LimitUse] = field(default_factory=list)
    """How near its joints come to each limit, and where."""
    q: Float[np.ndarray, "n 6"] | None = None
    """Joint angles of the MuJoCo arm, one row a period [rad]."""
    qd: Float[np.ndarray, "n 6"] | None = None
    """Its joint speeds [rad/s]."""
    resampled: tuple[float, float] | None = None
    """By how much the largest joint acceleration and jerk change if sampled every 1 ms instead of 2
    [%]."""

    @property
    def name(self) -> str:
        """What the walk is called in tables and figures."""
        return f"{self.roll} roll, {self.mount_deg:.0f}° mount"


def walk(loop: Loop, mount_deg: float, roll: str) -> Walk:
    """Plan one joint path along a loop, and let the MuJoCo arm follow it in free space."""
    scene = Scene(
        SceneConfig(mount_angle=float(np.radians(mount_deg)), servo=ServoConfig(lag=False))
    )
    config = JointPathConfig(
        roll_tolerance=ROLL_TOLERANCES[roll], floor=loop.table_height + paper_loop.LINK_RADIUS
    )
    plate = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=float(scene.X_BS[2, 3]))
    skin_B = se3.transform(scene.X_BS, scene.phantom.skin.vertices_S)
    body = Body(skin_B=skin_B[plate.heights(skin_B) > FOOT], chest=plate)
    clearance = cell_of(scene).clearance.of(body) if loop.in_twin else None
    lost = tuple(paper_loop.unreachable(loop.path, scene.X_FP, config))
    try:
        planned, _ = motion.plan_motion(
            loop.path, scene.X_FP, PERIOD, LIMITS, config, clearance=clearance
        )
    except PlanningError as error:
        return Walk(
            loop=loop.name, mount_deg=mount_deg, roll=roll, refused=str(error), unreachable=lost
        )
    if not loop.in_twin:  # the twin's table would be in the way
        scene.physics.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    q, qd = _executed(SimRobot(scene, q=planned.q[0]), planned)
    finer, _ = motion.plan_motion(
        loop.path, scene.X_FP, PERIOD / 2, LIMITS, config, clearance=clearance
    )
    return Walk(
        loop=loop.name,
        mount_deg=mount_deg,
        roll=roll,
        planned=planned,
        uses=joint_limits.limit_uses(planned.q, PERIOD, config),
        unreachable=lost,
        q=q,
        qd=qd,
        resampled=_resampled(planned, finer, config),
    )


def fluctuations(walked: list[Loop]) -> list[dict[str, object]]:
    """Speed fluctuation and chord error of every interpolation method on every loop, and how
    well the seam closes.
    """
    rows = []
    for loop, step in product(walked, get_args(Step)):
        feed = feedrate.interpolate(loop.path.curve, FeedrateLimits(speed=0.025, step=step), PERIOD)
        rows.append({
            "loop": loop.name,
            "method": step,
            "fluctuation_pct": feed.fluctuation_pct,
            "chord_error_mm": feed.chord_error * 1e3,
            **_seam(loop.path),
        })  # fmt: skip
    return rows


def loops(seed: int) -> Iterator[Loop]:
    """The true half-height loop of the twin's phantom, and the paper's points with either kind
    of normals.
    """
    scene = Scene(SceneConfig(phantom=PhantomConfig(seed=seed)))
    contour_S = scene.phantom.level_loop(scene.phantom.height / 2, DENSE_POINTS)
    points_S = contour_S[np.arange(LOOP_POINTS) * DENSE_POINTS // LOOP_POINTS]
    normals_S = scene.phantom.normal(scene.phantom.inverse_map(points_S))
    twin = Path(points_B=points_S + scene.X_BS[:3, 3], normals_B=normals_S)
    yield Loop(name="twin", path=twin, table_height=0.0, in_twin=True)
    for name, path in (
        ("paper, dome normals", paper_loop.dome()),
        ("paper, vertical normals", paper_loop.vertical()),
    ):
        yield Loop(name=name, path=path, table_height=paper_loop.TABLE_HEIGHT, in_twin=False)


def _executed(robot: SimRobot, planned: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles and speeds when the arm is to be at each row of the plan: it is late by the
    servo's lag.
    """
    late = round(robot.servo.lag / robot.period)
    states = []
    for target in [*planned.q, *late * [planned.q[-1]]]:
        robot.servo_joint(target)
        states.append(robot.state())
    states = states[late:]
    return np.stack([state.q for state in states]), np.stack([state.qd for state in states])


def _resampled(coarse: Motion, fine: Motion, config: JointPathConfig) -> tuple[float, float]:
    _, _, *coarse_uses = joint_limits.limit_uses(coarse.q, PERIOD, config)
    _, _, *fine_uses = joint_limits.limit_uses(fine.q, PERIOD / 2, config)
    acceleration, jerk = (
        100.0 * abs(f.fraction / c.fraction - 1.0)
        for c, f in zip(coarse_uses, fine_uses, strict=True)
    )
    return acceleration, jerk


def _seam(path: Path) -> dict[str, float]:
    """Relative jump of tangent and curvature where the curve closes: from the last span's end to
    the first's start.

    Evaluated from the spans' polynomials, because the curve itself takes its end for its start.
    """
    spans, widths = path.curve.polynomials[..., :3], np.diff(path.curve.breaks)
    tangents, curvatures = zip(
        *(_tangent_and_curvature(spans[k], x) for k, x in ((0, 0.0), (-1, widths[-1]))), strict=True
    )
    return {
        "seam_tangent": float(np.linalg.norm(tangents[0] - tangents[1])),
        "seam_curvature": float(
            np.linalg.norm(curvatures[0] - curvatures[1]) / np.linalg.norm(curvatures[0])
        ),
    }


def _tangent_and_curvature(cubic: np.ndarray, x: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangent and curvature vector [1/m] of a span with falling powers of `x`."""
    first = 3.0 * cubic[0] * x**2 + 2.0 * cubic[1] * x + cubic[2]
    second = 6.0 * cubic[0] * x + 2.0 * cubic[1]
    return first / np.linalg.norm(first), np.cross(first, second) / np.linalg.norm(first) ** 3
