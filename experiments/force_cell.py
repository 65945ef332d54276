"""A contact scan of a part of the true loop, with one force law in one set of circumstances:
what came of it?
"""

import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.signal
from jaxtyping import Float

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.laws import LawName
from breastscan.control.phases import Phase
from breastscan.control.safety import SafetyLimits
from breastscan.errors import BreastScanError
from breastscan.geometry import se3
from breastscan.planning.motion import Motion
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.run.metrics import rms
from breastscan.run.trajectory import Trajectory
from breastscan.servo import Servo
from experiments import sections
from sim import error_analysis
from sim.arm.servo import ServoConfig
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.tissue.breathing import BreathingConfig, Waveform
from sim.tissue.layers import LayerConfig
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.soft import LINEAR_LIMIT, SoftTissue
from sim.true_loop import true_loop_motion
from sim.truth import Truth
from sim.wrist.wrench_errors import Quality, WrenchSensorConfig

LOOP_TIME, LEAST_LENGTH = 5.0, 0.08
"""A cell goes along the path for so long [s], and at least so far [m]: over the whole ramp of the
surface error."""
CLEARANCE = 0.012
"""From which the skin is approached [m]; the window of the approach."""
RAMP_START, RAMP_LENGTH = 0.01, 0.05
"""Where on a cell's path the surface error grows [m]."""
REPORTED_SERVO = ServoConfig().servo
"""What the robot says of its servo, also where that is later."""
MASS_RADIUS, MASS_DEPTH = 0.010, 0.014
"""The stiff inclusion, and how deep its centre lies under the path [m]."""
SETTLED = 0.1
"""Fraction of the set-point within which the first contact counts as settled."""
READING_HZ = 10.0
"""Below this the sensor's errors reach the skin; above, the servo and the laws hold them off
[Hz]."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One set of circumstances; the defaults are the nominal ones."""

    law: LawName
    sensor: Quality = "industrial"
    seed: int = 0
    """Of the sensor, and of the part of the path."""
    pose_offset: bool = False
    """Whether the sensor's zero changes with its pose, as the built-in one's does."""
    young: float = 30e3
    """[Pa]"""
    force: float = 5.0
    """Set-point [N]."""
    speed: float = 0.025
    """Along the path [m/s]."""
    mass_ratio: float = 1.0
    """Stiffness of the inclusion in the middle of the path over the tissue's; 1 for none."""
    amplitude: float = 0.0
    """Of the breathing [m]."""
    rate: float = 0.25
    """Of the breathing [Hz]."""
    waveform: Waveform = "sine"
    surface_error: float = 0.0
    """By how much the plan comes to lie too deep, over 50 mm of path [m]."""
    lag: float = REPORTED_SERVO.lag
    """Of the servo [s], whatever the robot says."""
    whole_loop: bool = False
    """Whether the whole loop is followed, and the probe's tilt assessed."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """True forces along the probe axis; what is required of the loop is assessed from 1 s after
    it starts.
    """

    cell: Cell
    ended: str
    """Why the supervisor ended it, or nothing."""
    rmse: float
    """Of the force, over the loop [N]; NaN where it was not reached."""
    bias: float
    """Its mean error [N]."""
    sensor_rms: float
    """RMS of the sensor's error below 10 Hz over the loop [N]."""
    highest: float
    """Force at any time [N]."""
    lowest: float
    """Force during the loop [N]."""
    indentation: float
    """At any time [m]."""
    overshoot: float
    """Beyond the set-point before the path starts [N]."""
    settling: float
    """From first contact until the force stays within a tenth of the set-point [s]."""
    tangential: tuple[float, float, float]
    """Mean absolute deviation from the plan across the probe axis, in B [m]."""
    tilt_deg: tuple[float, float]
    """Mean and largest angle between probe and skin, where it was assessed."""
    trace: Float[np.ndarray, "n"]
    """Force error over the loop, one value a period [N]."""

    @property
    def inside(self) -> bool:
        """Whether the indentation stayed where linear elasticity was validated."""
        return self.indentation <= LINEAR_LIMIT


class LateRobot(SimRobot):
    """A robot that reports the nominal servo, whatever its own does."""

    @property
    def servo(self) -> Servo:
        """The nominal one."""
        return REPORTED_SERVO


@dataclass(frozen=True, kw_only=True)
class Ground:
    """What every cell stands on."""

    truth: Truth
    motion: Motion
    """Around the true half-height loop."""
    mass_p_S: tuple[float, float, float]
    """Where the inclusion lies, under the middle of the path [m]."""


@lru_cache(maxsize=1)
def ground() -> Ground:
    """The phantom's loop; the cells of one process share it."""
    scene, tissue = Scene(), tissue_of(PhantomConfig())
    motion = true_loop_motion(scene, tissue)
    row = float(np.searchsorted(motion.s, 0.5 * motion.s[-1]))
    X_SP = se3.inverse(scene.X_BS) @ scene.calibration.forward(motion.at(row)) @ scene.X_FP
    x, y, z = (X_SP[:3, 3] + MASS_DEPTH * X_SP[:3, 2]).tolist()
    return Ground(truth=Truth(scene.phantom, tissue), motion=motion, mass_p_S=(x, y, z))


@lru_cache(maxsize=4)
def tissue_of(config: PhantomConfig) -> SoftTissue:
    """The phantom's tissue; the latest few are kept."""
    return SoftTissue.build(Phantom(config))


def run(cell: Cell) -> Outcome:
    """Scan, and assess by the truth."""
    scene = Scene(_scene_config(cell))
    tissue, motion = tissue_of(scene.config.phantom), _motion(cell, scene)
    tissue.reset()
    robot = LateRobot(scene, tissue, motion.q_approach)
    log = []
    ended = ""
    config = ContactConfig(law=cell.law, force=cell.force)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tissue beyond its linear range is reported apart
        try:
            above_end = motion.lifted(len(motion.q) - 1, scene.X_FP, scene.calibration)
            execution.execute(robot, motion, config, SafetyLimits(), log=log, q_home=above_end)
        except BreastScanError as error:
            ended = str(error)
    went, truth = scan_log.trajectory(log, motion, robot), robot.truth_log()
    places = (
        error_analysis.contact_places(went, truth, tissue, ground().truth)
        if cell.whole_loop
        else None
    )
    return _assessed(cell, ended, error_analysis.with_truth(went, truth, places))


def _scene_config(cell: Cell) -> SceneConfig:
    layers = LayerConfig()
    if cell.mass_ratio != 1.0:
        layers = LayerConfig(
            mass_radius=MASS_RADIUS, mass_ratio=cell.mass_ratio, mass_p_S=ground().mass_p_S
        )
    return SceneConfig(
        phantom=PhantomConfig(young=cell.young, layers=layers),
        breathing=BreathingConfig(amplitude=cell.amplitude, rate=cell.rate, waveform=cell.waveform),
        servo=ServoConfig(lookahead_time=cell.lag - REPORTED_SERVO.transport),
        wrist=WrenchSensorConfig(
            quality=cell.sensor, seed=cell.seed, pose_offset=None if cell.pose_offset else 0.0
        ),
    )


def _motion(cell: Cell, scene: Scene) -> Motion:
    """The cell's part of the loop: about the inclusion where there is one, else where the seed
    says.
    """
    whole = ground().motion
    total = float(whole.s[-1])
    length = total if cell.whole_loop else min(max(LEAST_LENGTH, LOOP_TIME * cell.speed), total)
    fraction = np.random.default_rng(cell.seed).uniform() if cell.mass_ratio == 1.0 else 0.5
    part = sections.section(
        whole,
        scene.X_FP,
        start=fraction * (total - length),
        length=length,
        speed=cell.speed,
        clearance=CLEARANCE,
    )
    if cell.surface_error:
        depth = sections.ramp(part.s, cell.surface_error, start=RAMP_START, length=RAMP_LENGTH)
        part = sections.misplaced(part, scene.X_FP, depth)
    return part


def _assessed(cell: Cell, ended: str, went: Trajectory) -> Outcome:
    assert went.true_force is not None, "assessed by the truth"
    assert went.true_depth is not None, "assessed by the truth"
    time, phase = went.t, np.array(went.phase)
    force, reading = went.true_force, went.pressing_force
    loop = np.flatnonzero(phase == Phase.LOOP)
    steady = loop[time[loop] - time[loop[0]] >= error_analysis.STEADY_AFTER] if loop.size else loop
    error = force[steady] - cell.force
    before = np.flatnonzero(
        (phase == Phase.SETTLE) & (np.arange(len(phase)) <= (loop[0] if loop.size else len(phase)))
    )
    overshoot, settling = _contact(time[before], force[before], cell.force)
    tilt_deg = np.array([np.nan]) if went.true_tilt is None else np.degrees(went.true_tilt[steady])
    return Outcome(
        cell=cell,
        ended=ended,
        rmse=rms(error) if steady.size else np.nan,
        bias=float(error.mean()) if steady.size else np.nan,
        sensor_rms=rms(_slow(reading - force)[steady]) if steady.size else np.nan,
        highest=float(force.max()),
        lowest=float(force[loop].min()) if loop.size else np.nan,
        indentation=float(went.true_depth.max()),
        overshoot=overshoot,
        settling=settling,
        tangential=_tangential(went),
        tilt_deg=(float(tilt_deg.mean()), float(tilt_deg.max()))
        if tilt_deg.size
        else (np.nan, np.nan),
        trace=error.astype(np.float32),
    )


def _contact(
    time: Float[np.ndarray, "n"], force: Float[np.ndarray, "n"], set_point: float
) -> tuple[float, float]:
    """Overshoot [N] and settling time [s] of the first contact."""
    if not time.size:
        return np.nan, np.nan
    outside = np.flatnonzero(np.abs(force - set_point) > SETTLED * set_point)
    settled = time[outside[-1]] - time[0] if outside.size else 0.0
    return float(force.max() - set_point), float(settled)


def _slow(values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    low_pass = scipy.signal.butter(2, READING_HZ, fs=1.0 / PERIOD, output="sos")
    return scipy.signal.sosfiltfilt(low_pass, values)


def _tangential(went: Trajectory) -> tuple[float, float, float]:
    """Mean absolute deviation from the plan, across the probe's planned axis, in B [m]."""
    if not went.has_loop:
        return np.nan, np.nan, np.nan
    error_mm, axis_B = went.path_errors_mm(), went.X_BP_plan[went.in_loop, :3, 2]
    across_mm = error_mm - np.sum(error_mm * axis_B, axis=1)[:, None] * axis_B
    x, y, z = (1e-3 * np.abs(across_mm).mean(axis=0)).tolist()
    return x, y, z
