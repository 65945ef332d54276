"""The commands, with recorders in place of what does the work: what does each hand on?"""

import inspect
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from breastscan.commands.shots import ShotFolder
from breastscan.errors import BreastScanError
from breastscan.geometry import se3
from breastscan.planning import fitting
from breastscan.planning.motion import Motion
from breastscan.run import writing
from breastscan.run.unfinished import ABORTED, JOURNAL_FILE, PLAN_FILE
from breastscan.scan import PlanningConfig, ScanConfig
from breastscan.vision.board import BoardShot
from breastscan.vision.boards.poses_table import StatedPoses
from sim.room.cell import cell_of
from sim.scene import Scene, SceneConfig
from tests.commands.probes import Everything, content, loop_of, planned, replaced, small_pair
from tests.commands.test_plan import dome

PATHS = {"clock": "controller.clock"}
"""Where in `Everything` a setting lies that has a shorter name."""


class Handed(Exception):
    """Ends a command when everything has been handed over."""


@dataclass(frozen=True)
class Passed:
    """Runs as it is, once what it gets is noted."""

    run: Callable[..., Any]


@dataclass(frozen=True)
class Found:
    """What a controller says of itself."""

    host: str = "127.0.0.43"
    version: tuple[int, ...] = (5, 22, 0, 0)
    model: str = "UR5"
    serial: str = "1"


def recorder(name: str, answer: Any, calls: list) -> Any:
    def record(*arguments: Any, **named: Any) -> Any:
        calls.append((name, content(arguments), content(named)))
        if answer is Handed:
            raise Handed
        return answer.run(*arguments, **named) if isinstance(answer, Passed) else answer

    return record


@cache
def _folder() -> tempfile.TemporaryDirectory:
    """Goes when the tests end."""
    return tempfile.TemporaryDirectory(prefix="breastscan-settings-")


@cache
def files() -> dict[str, Path]:
    """What options name: files, and folders of pictures."""
    folder = Path(_folder().name)
    rig = Scene(SceneConfig()).rig
    K = rig.left.K * np.array([[1.01], [1.01], [1.0]])
    rig.save(folder / "rig.yaml")
    replace(rig, left=replace(rig.left, K=K)).save(folder / "other.yaml")
    cell_of(Scene(SceneConfig(mount_angle=0.6))).save(folder / "cell.json")
    rows = [f"delta_{name} = [0.0002, 0, 0, 0, 0, 0]" for name in ("theta", "d", "a", "alpha")]
    (folder / "calibration.conf").write_text("\n".join(["[mounting]", *rows]))
    writing.write_cloud(folder / "cloud.ply", *dome())
    for side in ("left", "right"):
        writing.write_image(folder / f"{side}.png", getattr(small_pair(), side))
    cut_off(folder / "cut off" / ABORTED)
    names = {
        "cut off": "cut off",
        "rig": "rig.yaml",
        "other rig": "other.yaml",
        "cell": "cell.json",
        "shots": ".",
    }
    names |= {"calibration": "calibration.conf", "cloud": "cloud.ply"}
    names |= {"left": "left.png", "right": "right.png"}
    return {name: folder / file for name, file in names.items()}


def cut_off(folder: Path) -> None:
    """What a scan with the defaults leaves that was cut off."""
    folder.mkdir(parents=True)
    settings = {"seed": 0, "rig": None, "scene": SceneConfig(), "video": True, "fine": False}
    writing.write_settings(folder, {**settings, **vars(ScanConfig())})
    for side in ("left", "right"):
        writing.write_image(folder / f"{side}_0.0.png", getattr(small_pair(), side))
    np.savez(folder / PLAN_FILE, q=np.zeros((2, 6)), q_home=np.zeros(6))
    (folder / JOURNAL_FILE).touch()


def shots_found() -> ShotFolder:
    camera = Scene(SceneConfig()).rig.left
    corners = np.zeros((35, 2))
    shot = BoardShot(name="a", left=corners, right=corners)
    size = (camera.width, camera.height)
    return ShotFolder(shots=(shot,), size=size, pictures={}, left_out={})


def a_pose() -> StatedPoses:
    X_BF = se3.from_rotation_vector(np.array([[0.3, 0.2, 0.1]]), np.array([[0.5, 0.0, 0.3]]))
    return StatedPoses(rows={"a": 0}, X_BF=X_BF, readings={})


@cache
def ten_rows() -> tuple[Motion, Any]:
    whole, feed = planned(Everything())
    return replace(whole, q=whole.q[:10], qd=whole.qd[:10], s=whole.s[:10]), feed


@dataclass
class Scanned:
    """What a scan gives that no setting made."""

    config: Any = None
    trajectory: Any = None
    metrics: tuple = ()

    def save(self, folder, **settings):
        pass


class ATwin(SimpleNamespace):
    """The twin of a command, as a context; a scan of it stays as it is."""

    scene = tissue = robot = camera = cell = explain = None

    def measured(self, result):
        return result

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def recorded_by(command: str) -> dict[str, Any]:
    """What a command calls, and what that answers; the rest of it runs as it is."""
    report = {"breastscan.commands.results.report.write": None, "summarise": None}
    names = "stage", "follow", "planned", "linger"
    viewer = nullcontext(SimpleNamespace(**dict.fromkeys(names, print)))
    return {
        "calibrate": {
            "sim.cameras.shown_board.ShownBoard": (), "files.read_shots": shots_found(),
            "calibration.calibrate": Handed,
        },
        "handeye": {
            "sim.cameras.held_board.HeldBoard": (), "poses_table.read": a_pose(),
            "files.read_shots": shots_found(), "hand_eye": Handed,
        },
        "plan": {
            "pattern.half_height_loop": loop_of(PlanningConfig().pattern),
            "fitting.fit": Passed(fitting.fit),
            "motion.plan_motion": ten_rows(), "motion.hidden_speed": None,
            "program.urscript": "",
        },
        "reconstruct": {
            "match": (None, None), "_check_fit": None, "reconstruct_breast": Handed,
        },
        "scan": report | {
            "Twin": ATwin(), "render_video": None,
            "filament.unusable": None, "preflight.examine": Found(),
            "preflight.opened": nullcontext(), "run_scan": Scanned(),
            "SimStereoCamera": None, "open_camera": None,
        },
        "twin": {"serve": None},
        "view": report | {
            "require_viewer": None, "Twin": ATwin(), "LiveView": viewer, "scan": Scanned(),
        },
    }[command]  # fmt: skip


def argument_of(command: Any, path: str, value: Any) -> dict[str, Any]:
    """The command's argument that changes a setting."""
    place = PATHS.get(path, path)
    for name, parameter in inspect.signature(command).parameters.items():
        if name == path:
            return {name: files().get(value, value) if isinstance(value, str) else value}
        below = place.removeprefix(f"{name}.")
        if hasattr(parameter.default, below.partition(".")[0]) and "." in place:
            return {name: replaced(parameter.default, below, value)}
    raise AssertionError(path)


def handed_over(command: Any, changes: dict[str, Any]) -> Any:
    """What a command hands on with some settings changed and which folders it makes, or why it
    refuses.
    """
    arguments: dict[str, Any] = {}
    for path, value in changes.items():
        arguments |= argument_of(command, path, value)
    kinds = inspect.signature(command).parameters
    first = [arguments.pop(name) for name, p in kinds.items() if p.kind is p.POSITIONAL_ONLY]
    calls: list = []
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, answer in recorded_by(command.__name__).items():
            target = (
                name if name.startswith(("sim.", "breastscan.")) else f"{command.__module__}.{name}"
            )
            patch.setattr(target, recorder(name, answer, calls))
        try:
            command(*first, **arguments)
        except Handed:
            pass
        except BreastScanError as error:
            return f"refused: {error}"
        made = sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*"))
    return calls, made
