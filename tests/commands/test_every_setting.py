"""No setting of any command is accepted and ignored.

Two halves make the proof. Every command is run with its innards replaced by recorders, once as it
is and once for each of its settings with that one changed: what the innards are given must differ,
or the command refuse. And every setting of a config is changed by itself in front of the functions
that take the config: their result must differ, or they refuse. A refusal of the value itself proves
nothing, so the changed values are ones that a config accepts.

A setting with a new kind of default, or one that needs others before it matters, stands in the
tables `VALUES` and `CONTEXTS`.
"""

from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest

from breastscan.commands import settings
from breastscan.errors import BreastScanError
from sim.cameras import camera as sim_camera
from sim.tissue import phantom as phantoms
from sim.tissue import soft
from tests.commands import probes
from tests.commands.probes import HOSTS, Everything, content, replaced
from tests.commands.recorders import PATHS, files, handed_over
from tests.commands.test_settings import commands

RIG = "other rig"
"""A name of `files`."""

VALUES: dict[str, Any] = {
    "perception.stereo.min_disparity": 58,
    "perception.stereo.num_disparities": 32,
    "perception.stereo.P2": 40,
    "perception.stereo.speckle_px": 1_000_000,
    "perception.segment.width_range": (0.2, 0.3),
    "perception.segment.height_range": (0.08, 0.12),
    "perception.segment.step_height": 1e-4,
    "perception.segment.planes": 1,
    "perception.refine.fit.iterations": 1,
    "perception.refine.fit.converged_px": 1.0,
    "perception.refine.largest_change_px": 0.05,
    "perception.refine.jump_px": 0.3,
    "perception.refine.largest_sigma_px": 0.02,
    "planning.pattern.kind": "raster",
    "planning.pattern.smallest_radius": 0.2,
    "planning.coverage.nipple_margin": 0.02,
    "planning.coverage.overlap": 0.5,
    "planning.coverage.twice": True,
    "planning.feedrate.normal_acceleration": 5e-3,
    "planning.feedrate.chord_error": 1e-9,
    "planning.joints.position_limit": 2.0,
    "planning.joints.elbow_limit": 1.0,
    "planning.joints.speed_limit": 0.1,
    "planning.joints.acceleration_limit": 0.05,
    "planning.joints.jerk_limit": 0.2,
    "planning.joints.position_margin": 2.5,
    "planning.joints.singularity_margin": 0.9,
    "planning.joints.floor": 0.3,
    "planning.joints.roll_tolerance": 0.3,
    "planning.joints.collision_margin": 0.4,
    "planning.joints.body_margin": 0.03,
    "planning.joints.pressed_depth": 0.03,
    "planning.joints.yielding": 0.0,
    "planning.tissue.poisson": 0.3,
    "link.slack": 2.0,
    "contact.law": "pi",
    "contact.rate_limit": 1e-3,
    "contact.depth_limit": 1e-3,
    "contact.phases.window": 1e-4,
    "contact.phases.search_depth": 1e-4,
    "contact.phases.losses": 1,
    "contact.surface.force_noise": 1.0,
    "contact.gains.fuzzy_pd.derivative_swing": 0.5,
    "contact.tilt.bound": 1e-3,
    "contact.tilt.rate_limit": 1e-3,
    "contact.tilt.min_force": 20.0,
    "contact.tilt.max_noise": 1e-3,
    "safety.force": 5.05,
    "safety.force_margin": 0.02,
    "safety.pull": 0.01,
    "safety.torque": 1e-3,
    "safety.force_step": 0.01,
    "safety.sensor_range": 1.0,
    "safety.frozen_time": 0.005,
    "safety.stuck_distance": 1e-9,
    "safety.silence": 0.005,
    "safety.lateness": 0.005,
    "safety.joint_speed": 0.01,
    "safety.joint_acceleration": 0.5,
    "safety.workspace_margin": 1e-6,
    "safety.penetration": 1e-3,
    "safety.skin_offset": 1e-6,
    "safety.skin_speed": 1e-9,
    "scene.phantom.seed": 1,
    "scene.phantom.texture_seed": 1,
    "scene.phantom.poisson": 0.3,
    "scene.phantom.mechanics": "printed",
    "scene.phantom.layers.gland_fraction": 0.6,
    "scene.phantom.layers.mass_radius": 0.012,
    "scene.phantom.layers.mass_p_S": (0.01, 0.0, 0.03),
    "scene.p_BS": (0.51, 0.01, 0.09),
    "scene.chest.radius": 0.2,
    "scene.chest.tilt": 0.1,
    "scene.breathing.amplitude": 0.005,
    "scene.rig": RIG,
    "scene.arm.seed": 1,
    "scene.servo.gain": 1500.0,
    "scene.servo.transport": 0.01,
    "scene.wrist.force_noise": 0.2,
    "scene.wrist.torque_noise": 0.2,
    "scene.wrist.bandwidth": 20.0,
    "scene.wrist.resolution": 0.5,
    "scene.wrist.drift": 1.0,
    "scene.wrist.gain_error": 0.1,
    "scene.wrist.cross_talk": 0.1,
    "scene.wrist.pose_offset": 1.0,
    "scene.wrist.force_range": 0.1,
    "scene.wrist.torque_range": 0.01,
    "scene.wrist.sample_rate": 250.0,
    "scene.wrist.knows_acceleration": True,
    "scene.wrist.seed": 1,
    "scene.camera.vignetting": 2.0,
    "scene.camera.blur_px": 1.0,
    "scene.camera.shot_noise": True,
    "scene.camera.read_noise": 5.0,
    "scene.camera.bits": 12,
    "scene.camera.seed": 1,
    "controller.host": HOSTS[1],
    "controller.version": "10.11",
    "controller.programs": Path(__file__).with_name("programs"),
}
"""What a setting is changed to where the rule of `proposed` has no answer or shows no effect."""

CONTEXTS: dict[str, dict[str, Any]] = {
    "perception.stereo.num_disparities": {"perception.stereo.min_disparity": 0},
    "planning.joints.largest_tilt": {"planning.joints.body_margin": 0.03},
    "planning.coverage.": {"planning.pattern.kind": "loops"},
    "planning.largest_rise": {"planning.joints.body_margin": 0.03},
    "contact.phases.search_": {"world.fall": 0.006},
    "contact.phases.losses": {"world.fall": 0.006},
    "contact.phases.escape_": {"world.spike": 20.0},
    "contact.gains.observer.": {"contact.law": "observer"},
    "contact.gains.pi_stiffness.": {"contact.law": "pi-stiffness"},
    "contact.gains.pi.": {"contact.law": "pi"},
    "contact.gains.pd.": {"contact.law": "pd"},
    "contact.gains.fuzzy_pd.": {"contact.law": "fuzzy-pd"},
    "contact.gains.admittance.": {"contact.law": "admittance"},
    "safety.stuck_time": {"safety.stuck_distance": 1e-9},
    "safety.skin_overspeed_time": {"safety.skin_speed": 1e-9},
    "scene.phantom.layers.gland_ratio": {"scene.phantom.layers.gland_fraction": 0.6},
    "scene.phantom.layers.mass_p_S": {
        "scene.phantom.layers.mass_radius": 0.012,
        "scene.phantom.layers.mass_ratio": 8.0,
    },
    "scene.phantom.layers.mass_ratio": {"scene.phantom.layers.mass_radius": 0.012},
    "scene.chest.azimuth": {"scene.chest.tilt": 0.1},
    "scene.breathing.": {"scene.breathing.amplitude": 0.004},
    "scene.arm.seed": {"scene.arm.kinematics": "calibrated"},
    "scene.camera.exposure_time": {"scene.camera.motion_samples": 2},
    "controller.": {"controller.host": HOSTS[0]},
    "controller.expose": {"controller.host": "192.0.2.1"},
}
"""What must hold for a setting, or for all whose names begin so, to matter."""


ROBOT = {"robot": "rtde://127.0.0.43", "yes": True}
USUAL: dict[str, dict[str, Any]] = {
    "calibrate": {"shots": "shots"},
    "handeye": {"shots": "shots", "rig": "rig"},
    "plan": {"source": "cloud"},
    "reconstruct": {"left": "left", "right": "right", "rig": "rig"},
    "scan": {},
    "twin": {},
    "view": {},
}
"""Arguments without which a command does not run: names of `files`."""
OPTIONS: dict[str, tuple[Any, dict[str, Any]]] = {
    "twin": (True, {"shots": None}),
    "out": (Path("elsewhere"), {}),
    "on_flange": (True, {}),
    "accept": (True, {}),
    "lens": (8, {}),
    "resume": ("cut off", {}),
    "seed": (3, {}),
    "calibrate.seed": (3, {"shots": None, "twin": True}),
    "handeye.seed": (3, {"shots": None, "twin": True}),
    "rig": (RIG, {}),
    "urscript": (True, {}),
    "tcp": ((0.1, 0.0, 0.16, 0.0, 0.8, 0.0), {}),
    "calibration": ("calibration", {}),
    "scan.calibration": ("calibration", ROBOT),
    "plate_height": (0.07, {}),
    "video": (False, {}),
    "fine": (True, {}),
    "robot": ("rtde://127.0.0.44", ROBOT),
    "cell": ("cell", ROBOT),
    "plan.cell": ("cell", {}),
    "camera": ("folder:pictures", ROBOT),
    "dry_run": (True, ROBOT),
    "yes": (False, ROBOT),
    "link.slack": (2.0, ROBOT),
    "web": (True, {}),
    "host": ("127.0.0.9", {"web": True}),
    "port": (8090, {"web": True}),
}
"""What an option of a command itself is changed to, and beside which others; a name may begin with
the command's."""


PROBES = {
    "perception.": probes.perceived,
    "planning.": probes.planned,
    "planning.coverage.": probes.covered,
    "planning.pattern.kind": probes.covered,
    "planning.tissue.": probes.dragged,
    "contact.": probes.executed,
    "safety.": probes.executed,
    "link.": probes.slackened,
    "scene.": probes.moved,
    "scene.chest.": probes.lain,
    "scene.rig": probes.pictured,
    "scene.camera.": probes.pictured,
    "scene.phantom.": probes.shaped,
    "scene.phantom.texture": probes.textured,
    "scene.phantom.mechanics": probes.pressed,
    "scene.phantom.young": probes.pressed,
    "scene.phantom.poisson": probes.pressed,
    "scene.phantom.layers.": probes.pressed,
    "scene.phantom.gel_friction": probes.pressed,
    "board.": probes.looked_for,
    "limits.": probes.judged,
    "board.square": probes.calibrated,
    "controller.host": probes.listening,
    "controller.version": probes.listening,
    "controller.expose": probes.exposed,
    "controller.model": probes.answered,
    "controller.remote_control": probes.answered,
    "controller.programs": probes.answered,
    "controller.clock": probes.tared,
    "controller.real_time": probes.served,
}
"""What shows the effect of the settings whose names begin so; the longest beginning counts."""


def probe_of(path: str) -> Any:
    return PROBES[max((start for start in PROBES if path.startswith(start)), key=len)]


KNOWN = {
    PATHS.get(path, path): setting
    for command in commands()
    for path, setting in settings.settings_of(command).items()
}
SECTIONS = {path: setting for path, setting in KNOWN.items() if "." in path}


@pytest.fixture(scope="module", autouse=True)
def small_world(tmp_path_factory):
    """Coarse elements, a coarse texture, no OpenGL, and nobody's cache of tissues but our own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(soft, "SKIN_POINTS", 60)
        patch.setattr(phantoms, "TEXTURE_SIZE_PX", 128)
        patch.setattr(sim_camera, "Picture", probes.Drawn)
        yield


def outcome(probe: Any, changes: tuple[tuple[str, Any], ...]) -> Any:
    """What comes of the defaults with some changes, or which error."""
    config = Everything()
    for path, value in changes:
        config = replaced(config, path, value)
    try:
        return content(probe(config))
    except BreastScanError as error:
        return f"refused: {error}"


@cache
def usual(probe: Any, context: tuple[tuple[str, Any], ...]) -> Any:
    """The outcome without the change; a context that is no config yet, the change makes one."""
    try:
        return outcome(probe, context)
    except BreastScanError as error:
        return f"refused: {error}"


def proposed(path: str, setting: settings.Setting) -> Any:
    """Another value of a setting."""
    if path in VALUES:
        return files()[RIG] if VALUES[path] == RIG else VALUES[path]
    return _next(setting.default, setting.kind, path)


def _next(default: Any, kind: Any, path: str) -> Any:
    if get_origin(kind) is Literal:
        choices = get_args(kind)
        return choices[(choices.index(default) + 1) % len(choices)]
    if isinstance(default, bool):
        return not default
    if isinstance(default, tuple):
        return tuple(_next(one, type(one), path) for one in default)
    if isinstance(default, str):
        return f"{default}X"
    assert isinstance(default, int | float), f"{path} needs a value in VALUES"
    return default + 1 if isinstance(default, int) else 1.5 * default or 1.0


def option_of(command: str, path: str, setting: settings.Setting) -> tuple[Any, dict[str, Any]]:
    """What a setting of a command is changed to, and beside which options of the command."""
    for name in (f"{command}.{path}", path):
        if name in OPTIONS:
            return OPTIONS[name]
    place = PATHS.get(path, path)
    assert place in SECTIONS, f"{path} of {command} needs a row in OPTIONS"
    return proposed(place, setting), {}


def context_of(path: str) -> dict[str, Any]:
    """Settings that are not the defaults' where this one is tried."""
    found = {}
    for start, context in CONTEXTS.items():
        found |= context if path.startswith(start) else {}
    return found


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.__name__)
def test_every_setting_of_a_command_is_handed_on_or_refused(command):
    usually: dict[Any, Any] = {}
    ignored = []
    for path, setting in settings.settings_of(command).items():
        value, beside = option_of(command.__name__, path, setting)
        key = tuple(beside.items())
        if key not in usually:
            usually[key] = handed_over(command, USUAL[command.__name__] | beside)
        changed = USUAL[command.__name__] | beside | {path: value}
        if handed_over(command, changed) == usually[key]:
            ignored.append(path)
    assert ignored == []


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.__name__)
def test_a_command_hands_on_the_same_for_the_same(command):
    """Else every change would seem to be handed on."""
    usual = USUAL[command.__name__]
    same = handed_over(command, usual) == handed_over(command, usual)
    assert same


@pytest.mark.parametrize("path", SECTIONS)
def test_every_setting_of_a_config_has_an_effect(path):
    context, value = context_of(path), proposed(path, SECTIONS[path])
    changed = {path: value} | context | {path: value}  # first, for what it may allow
    before = usual(probe_of(path), tuple(context.items()))
    ignored = outcome(probe_of(path), tuple(changed.items())) == before
    assert not ignored, f"{path} = {value!r} changes nothing: is it used? See the docstring"


@pytest.mark.parametrize("probe", dict.fromkeys(PROBES.values()), ids=lambda one: one.__name__)
def test_the_same_settings_give_the_same_result(probe):
    """Else every change would seem to have an effect."""
    context = tuple(context_of("controller.").items())
    same = outcome(probe, context) == outcome(probe, context)
    assert same


def test_the_tables_name_settings_that_exist():
    starts = {*VALUES, *CONTEXTS, *PROBES}
    assert [start for start in starts if not any(path.startswith(start) for path in SECTIONS)] == []
    named = {f"{c.__name__}.{path}" for c in commands() for path in settings.settings_of(c)}
    assert OPTIONS.keys() <= KNOWN.keys() | named
