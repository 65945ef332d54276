"""What comes of a config: short runs of the functions that take one, by `Everything`."""

import re
import socket
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from breastscan.camera.interface import StereoPair
from breastscan.cloud import skin_fit
from breastscan.errors import BreastScanError
from breastscan.execution import execute
from breastscan.geometry import kinematics, se3
from breastscan.geometry.hulls import Shape
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import Skin
from breastscan.planning import fitting, pattern
from breastscan.planning.clearance import Body, Clearance
from breastscan.planning.coverage import Patch
from breastscan.planning.examination import Coverage
from breastscan.planning.fitting import Task
from breastscan.planning.motion import Motion
from breastscan.robot.ur import ur5e
from breastscan.robot.ur.worker import LinkLimits
from breastscan.scan import ScanConfig, Stages, perceive
from breastscan.tissue import drag
from breastscan.tissue.drag import PressedBreast
from breastscan.vision import calibration
from breastscan.vision.board import Board, find_corners
from breastscan.vision.boards.calibration_quality import Quality, QualityLimits, complaints
from breastscan.vision.camera import Intrinsics, StereoRig
from experiments.ray_cast_dome import DomeScene
from sim.arm.servo import ServoConfig
from sim.cameras import camera as sim_camera
from sim.controller import serve as serving
from sim.controller.config import ControllerConfig
from sim.controller.controller import Controller
from sim.controller.dashboard import Dashboard
from sim.controller.server import Server
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.tissue.breathing import BreathingConfig
from sim.tissue.mechanics import build_mechanics
from sim.tissue.phantom import Phantom
from sim.wrist.probe import tip_pose
from sim.wrist.wrench_errors import WrenchSensorConfig
from tests.commands.test_plan import dome
from tests.sim.controller.served import address
from tests.springs import PERIOD, X_FP, SpringRobot
from tests.vision import board_shots

HOSTS = address(71), address(72)
"""Where controllers listen here."""

STAGED = re.compile(r"\.partial-\w+")
"""What is drawn for the name of a folder that is not complete yet."""


@dataclass(frozen=True, kw_only=True)
class World:
    """What the tests' own robot meets, beside an elastic plane."""

    fall: float = 0.0
    """How far the plane falls away under the running probe, twice [m]."""
    spike: float = 0.0
    """Force that shows on the sensor once [N]."""


@dataclass(frozen=True, kw_only=True)
class Everything(ScanConfig):
    """Every config that a command takes, by the name that its settings begin with."""

    link: LinkLimits = field(default_factory=LinkLimits)
    scene: SceneConfig = field(default_factory=SceneConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    board: Board = field(default_factory=Board)
    limits: QualityLimits = field(default_factory=QualityLimits)
    world: World = field(default_factory=World)


def content(value: Any) -> Any:
    """All that a value holds, to compare; of an object that is no data, its kind and config."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if is_dataclass(value) and not isinstance(value, type):
        return type(value).__name__, *(content(getattr(value, f.name)) for f in fields(value))
    if isinstance(value, dict):
        return tuple((key, content(held)) for key, held in value.items())
    if isinstance(value, list | tuple):
        return tuple(map(content, value))
    if value is None or isinstance(value, str | int | float | Path | np.generic):
        return STAGED.sub("", repr(value))
    return type(value).__name__, content(getattr(value, "config", None))


def replaced(config: Any, path: str, value: Any) -> Any:
    """A config with the setting at a path changed."""
    name, _, rest = path.partition(".")
    inner = replaced(getattr(config, name), rest, value) if rest else value
    return replace(config, **{name: inner})


SMALL = DomeScene(focal_px=342.0, width_px=320, height_px=224)
SKIN, CLEARANCE = 0.10, 0.012
DOWN = np.diag([1.0, -1.0, -1.0])
SILENT, SPIKE, REPEATING, FALLS = 365, 400, range(340, 348), (400, 490)
"""Periods of `executed` on the skin, whose path begins in the 358th."""
PLATE = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.08)


def pinhole_rig(scene: DomeScene) -> StereoRig:
    (cx, cy), f = scene.centre_px, scene.focal_px
    K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]], float)
    size = {"width": scene.width_px, "height": scene.height_px}
    one = Intrinsics(K=K, distortion=np.zeros(5), **size)
    X_RL = se3.pose(np.eye(3), np.array([-scene.baseline, 0.0, 0.0]))
    return StereoRig(left=one, right=one, X_RL=X_RL)


@cache
def small_pair() -> StereoPair:
    pair = SMALL.pair()
    return StereoPair(left=pair.left, right=pair.right, time=0.0)


def perceived(c: Everything) -> Any:
    return perceive(small_pair(), pinhole_rig(SMALL), c.perception, Stages())


PROBE = Shape(
    name="probe", kind="box", size=(0.028, 0.013, 0.055),
    X=tip_pose(np.pi / 4) @ se3.pose(np.eye(3), np.array([0.0, 0.0, -0.065])),
)  # fmt: skip


@cache
def skin() -> Skin:
    return skin_fit.fit_cloud(*dome(), PLATE)


@cache
def loop_of(config: pattern.PatternConfig) -> pattern.Path:
    return pattern.half_height_loop(skin(), PLATE, config)


def planned(c: Everything) -> Any:
    config = c.planning
    path = loop_of(config.pattern)
    task = Task(
        X_FP=tip_pose(np.pi / 4), period=PERIOD, limits=config.feedrate, config=config.joints,
        clearance=Clearance([PROBE]).of(Body(skin_B=dome()[0], chest=PLATE)),
    )  # fmt: skip
    fitted = fitting.fit(lambda rise: path, config.rises, task)
    return fitted.motion, fitted.feed


def covered(c: Everything) -> Any:
    """How the strokes lie; of a single loop, nothing."""
    config = c.planning
    if config.pattern.kind == "loop":
        return None
    task = Task(
        X_FP=tip_pose(np.pi / 4), period=PERIOD, limits=config.feedrate, config=config.joints
    )
    patch = Patch(*drag.patch(c.contact.force, skin(), config.tissue))
    lain = Coverage.planned(skin(), PLATE, config.pattern.kind, config.coverage, patch, task)
    return [lain.band.path(track).points_B for track in lain.tracks]


def dragged(c: Everything) -> Any:
    path = loop_of(pattern.PatternConfig())
    z_B = -path.normals_B
    x_B = np.cross(z_B, [0.0, 0.0, 1.0])
    x_B /= np.linalg.norm(x_B, axis=1, keepdims=True)
    X_BP = se3.pose(np.stack([x_B, np.cross(z_B, x_B), z_B], axis=-1), path.points_B)
    s = np.linspace(0.0, path.curve.length, len(X_BP))
    return PressedBreast.perceived(dome()[0], PLATE, c.planning.tissue).along_path(X_BP, s)


@cache
def sweep() -> Motion:
    """A short way over a plane, from rest to rest, across the robot's own axes."""
    ramp = np.arange(0.0, 1.0, PERIOD / 0.3)
    speed = 0.025 * np.concatenate([ramp, np.ones(40), 1.0 - ramp, [0.0]])
    s = np.concatenate([[0.0], np.cumsum(speed) * PERIOD])
    places = np.stack([0.45 + 0.6 * s, 0.13 + 0.8 * s, np.full(len(s), SKIN)], axis=1)
    places = np.vstack([places[0] + [0.0, 0.0, CLEARANCE], places])
    q = [np.array([0.0, -1.6, 1.8, -1.8, -1.57, 0.0])]
    for p_B in places:
        solutions = kinematics.inverse(se3.pose(DOWN, p_B) @ se3.inverse(X_FP))
        q.append(min(solutions, key=lambda other: np.abs(other - q[-1]).sum()))
    approach, *on_skin = np.unwrap(q[1:], axis=0)
    qd = np.gradient(on_skin, PERIOD, axis=0)
    return Motion(q=np.array(on_skin), qd=qd, s=s, q_approach=approach, clearance=CLEARANCE)


class Bench(SpringRobot):
    """A spring under a sensor that is noisy, not quite square to it, and gives a sample every other
    period; once it repeats itself for a while, and once the robot is silent for a period.
    """

    def __init__(self, world: World) -> None:
        super().__init__(sweep().q_approach, SKIN)
        self.world = world
        self.draws = np.random.default_rng(1)
        self.latest = super().state()

    def servo_joint(self, q: np.ndarray) -> None:
        super().servo_joint(q)
        self.height = SKIN - self.world.fall * sum(self.time > k * PERIOD for k in FALLS)

    def state(self) -> Any:
        now = super().state()
        period = round(now.time / PERIOD)
        if period == SILENT:
            return self.latest
        force = -now.wrench_P[2]
        lean = force * np.array([0.02, 0.12, 0.0, 0.0, 0.006, 0.0])
        noise = self.draws.standard_normal(6) * np.repeat([0.04, 0.002], 3)
        wrench_P = now.wrench_P + lean + noise
        wrench_P[2] -= self.world.spike if period == SPIKE else 0.0
        if period in REPEATING:
            wrench_P = self.latest.wrench_P
        self.latest = replace(now, wrench_P=wrench_P, sample=period // 2)
        return self.latest


def executed(c: Everything) -> Any:
    log: list = []
    try:
        execute(Bench(c.world), sweep(), c.contact, c.safety, log=log)
    except BreastScanError as error:
        return log, type(error).__name__
    return log


def slackened(c: Everything) -> Any:
    return c.link.lateness, c.link.watchdog, c.safety.with_slack(c.link.slack)


def shaped(c: Everything) -> Any:
    return Phantom(c.scene.phantom).skin


def lain(c: Everything) -> Any:
    scene = Scene(c.scene)
    return scene.X_BS, scene.phantom.skin


def textured(c: Everything) -> Any:
    return Phantom(c.scene.phantom).texture_image()


def pressed(c: Everything) -> Any:
    phantom = Phantom(c.scene.phantom)
    tissue = build_mechanics(phantom)
    place_S = np.array([0.005, 0.0, phantom.height - 0.006])
    return type(tissue).__name__, tissue.press(se3.pose(DOWN, place_S), np.array([0.01, 0, -0.01]))


@cache
def compiled(config: SceneConfig) -> Any:
    return Scene(config).physics


def scene_of(config: SceneConfig) -> Scene:
    """A scene whose physics is compiled only where it may be another: that could hide an effect,
    but feign none.
    """
    scene = Scene(config)
    apart = {"servo": ServoConfig(), "wrist": WrenchSensorConfig(), "breathing": BreathingConfig()}
    scene.__dict__["physics"] = compiled(replace(config, **apart))
    return scene


def moved(c: Everything) -> Any:
    robot = SimRobot(scene_of(c.scene))
    q = robot.state().q
    told = []
    for k in range(60):
        robot.servo_joint(q + 1e-5 * k * (60 - k))
        told.append(robot.state())
    return told, robot.truth_log(), robot.calibration


@cache
def moving() -> SimRobot:
    robot = SimRobot(scene_of(SceneConfig()))
    for k in range(20):
        robot.servo_joint(robot.state().q + 1e-4 * k)
    return robot


class Drawn:
    """A picture without OpenGL: stripes that shift with the arm and with time."""

    def __init__(self, scene: Scene, width: int, height: int) -> None:
        self.size = np.indices((height, width))
        self.shift = 0.0

    def arrange(self, q: np.ndarray, skin_S: Any = None, time: float = 0.0) -> None:
        self.shift = 1e3 * float(q.sum()) + 1e3 * time

    def draw(self, side: str) -> np.ndarray:
        y, x = self.size
        grey = 120 + 90 * np.sin(0.3 * x + 0.2 * y + self.shift)
        return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def pictured(c: Everything) -> Any:
    return sim_camera.SimStereoCamera(Scene(c.scene), moving(), binning=8).capture()


def exposed(c: Everything) -> Any:
    return c.controller.host


def listening(c: Everything) -> Any:
    controller = Controller(moving(), c.controller, 0.0, print)
    server = Server(controller)
    try:
        ports = ur5e.RTDE_PORT, ur5e.DASHBOARD_PORT
        return [_answers(host, port) for host in HOSTS for port in ports]
    finally:
        server.close()


def _answers(host: str, port: int) -> bool:
    with socket.socket() as caller:
        return caller.connect_ex((host, port)) == 0


def answered(c: Everything) -> Any:
    controller = Controller(moving(), c.controller, 0.0, print)
    questions = "get robot model", "is in remote control", "PolyscopeVersion", "load a.urp"
    pendant = Dashboard(controller)
    return [pendant.answer(question) for question in questions]


def tared(c: Everything) -> Any:
    robot = SimRobot(scene_of(c.scene))
    for _ in range(5):
        robot.servo_joint(robot.state().q)
    Controller(robot, c.controller, 0.0, print).zero_wrench()
    robot.servo_joint(robot.state().q)
    return robot.state()


def served(c: Everything) -> Any:
    asked = []
    stubs = {
        "SimRobot": lambda *_: moving(), "build_mechanics": lambda *_: None,
        "Server": lambda *_: SimpleNamespace(serve=lambda ended: None),
        "ask_for_priority": lambda: asked.append("priority"), "make_ready": lambda: None,
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        for name, stub in stubs.items():
            patch.setattr(serving, name, stub)
        serving.serve(c.scene, c.controller, None, lambda text: None)
    return asked


def looked_for(c: Everything) -> Any:
    rig = board_shots.make_rig(distorted=False)
    (X_LBoard,) = board_shots.poses_in_view(rig, 1, np.random.default_rng(0))
    return find_corners(board_shots.picture(rig.left, X_LBoard), c.board)


def judged(c: Everything) -> Any:
    """Sets about the limits, one figure a little better or worse than each."""
    usual = {"coverage": 0.5, "tilt_spread": np.radians(8.0), "held_out_px": 1.0, "fit_px": 0.5}
    told = []
    for name, value in usual.items():
        for by in (0.97, 1.03):
            figures = usual | {name: by * value}
            pair = (figures.pop("coverage"),) * 2
            told.append(complaints(Quality(coverage=pair, **figures), c.limits))
    return told


def calibrated(c: Everything) -> Any:
    rig, rng = board_shots.make_rig(distorted=False), np.random.default_rng(0)
    shots = board_shots.shots_of(rig, board_shots.poses_in_view(rig, 12, rng), rng)
    return round(calibration.calibrate(shots, board_shots.SIZE, c.board).rig.baseline, 6)
