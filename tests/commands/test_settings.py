"""Settings by name: on the command line, in a file, in the help."""

import dataclasses
import json
import math
import re
from typing import Literal, get_args, get_origin

import pytest
import tyro

from breastscan.commands import settings
from breastscan.errors import ConfigError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inner:
    spacing_px: int = 6
    """Distance of the knots [px]. And more of it."""
    step: Literal["one", "two"] = "one"
    """Which step."""
    sharp: bool = False
    """Whether it is."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outer:
    inner: Inner = dataclasses.field(default_factory=lambda: Inner(spacing_px=8))
    place: tuple[float, float] = (0.5, 0.0)
    """Where [m]."""
    limit: float | None = None
    """At most [N]; None for none."""
    known: bool | None = None
    """Whether it is known; None for the class's."""


def command(
    source: tyro.conf.Positional[str] = "",
    /,
    seed: int = 0,
    video: bool = True,
    part: Outer = Outer(),
) -> tuple:
    """Do it.

    Args:
        source: Of what.
        seed: Seed.
        video: Whether to film.
        part: Every setting.
    """
    return source, seed, video, part


def parsed(*arguments: str) -> tuple:
    options, _ = settings.expanded(command, list(arguments))
    return tyro.cli(command, args=options)


def test_a_setting_has_the_name_that_config_json_has_for_it():
    assert list(settings.settings_of(command)) == [
        "seed",
        "video",
        "part.inner.spacing_px",
        "part.inner.step",
        "part.inner.sharp",
        "part.place",
        "part.limit",
        "part.known",
    ]


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        ("part.inner.spacing_px=12", {"inner": Inner(spacing_px=12)}),
        ("part.inner.spacing-px=12", {"inner": Inner(spacing_px=12)}),
        ("part.inner.sharp=true", {"inner": Inner(spacing_px=8, sharp=True)}),
        ("part.place=[0.45, -0.1]", {"place": (0.45, -0.1)}),
        ("part.place=.45,-.1", {"place": (0.45, -0.1)}),
        ("part.limit=3", {"limit": 3.0}),
        ("part.limit=None", {"limit": None}),
        ("part.known=yes", {"known": True}),
        ("part.known=None", {"known": None}),
    ],
)
def test_set_changes_one_setting_and_leaves_the_others(text, changes):
    assert parsed("--set", text)[3] == dataclasses.replace(Outer(), **changes)
    assert parsed(f"--set={text}")[3] == dataclasses.replace(Outer(), **changes)


def test_an_option_of_the_command_can_be_set_by_name_too():
    assert parsed("--set", "seed=4", "--set", "video=off")[1:3] == (4, False)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("part.inner.spacing=12", r"did you mean part\.inner\.spacing_px"),
        ("part.iner.step=two", r"did you mean part\.inner\.step"),
        ("spacing_px=12", r"part\.inner\.spacing_px"),
        ("part.inner=12", "there is no setting 'part.inner'"),
        ("part.inner.spacing_px", "takes NAME=VALUE"),
        ("video=perhaps", "true or false, got 'perhaps'"),
        ("nonsense=1", "there is no setting 'nonsense'"),
    ],
)
def test_what_is_none_is_refused_with_the_nearest(text, why):
    with pytest.raises(ConfigError, match=why):
        parsed("--set", text)


JSON = '{"seed": 3, "video": false, "part": {"place": [0.25, 0.1], "inner": {"step": "two"}}}'
TOML = 'seed = 3\nvideo = false\n[part]\nplace = [0.25, 0.1]\ninner.step = "two"\n'
YAML = "seed: 3\nvideo: no\npart:\n  place: [0.25, 0.1]\n  inner: {step: two}\n"


@pytest.mark.parametrize(("name", "text"), [("a.json", JSON), ("a.toml", TOML), ("a.yaml", YAML)])
def test_a_file_sets_what_it_names(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    expected = Outer(place=(0.25, 0.1), inner=Inner(spacing_px=8, step="two"))
    assert parsed("--config", str(tmp_path / name)) == ("", 3, False, expected)


def test_what_is_typed_beside_a_file_wins_wherever_it_stands(tmp_path):
    (tmp_path / "a.json").write_text(JSON)
    beside = ("--seed", "5", "--set", "part.inner.step=one", "--video")
    for arguments in (
        (*beside, "--config", str(tmp_path / "a.json")),
        ("--config", str(tmp_path / "a.json"), *beside),
    ):
        _, seed, video, part = parsed(*arguments)
        assert (seed, video, part.inner.step) == (5, True, "one")
        assert part.place == (0.25, 0.1)


def test_every_float_comes_back_from_a_file_to_the_last_digit(tmp_path):
    place = (1.0 / 3.0, 2.0e-17 + 0.1)
    (tmp_path / "a.json").write_text(json.dumps({"part": {"place": place, "limit": None}}))
    assert parsed("--config", str(tmp_path / "a.json"))[3] == Outer(place=place)


def test_what_a_file_tells_of_its_run_is_no_setting_and_what_is_anothers_is_told(tmp_path):
    (tmp_path / "a.json").write_text(
        '{"date": "2026-01-01", "versions": {"numpy": "2"}, "seed": 2, "scene": {"arm": {"x": 1}}}'
    )
    options, unused = settings.expanded(command, ["--config", str(tmp_path / "a.json")])
    assert options == ["--seed", "2"]
    assert unused == ["scene"]


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.json", '{"part": {"iner": {"step": "two"}}}', r"part\.iner.* \(in .*a\.json\)"),
        ("a.json", '{"part": 3}', "there is no setting 'part'"),
        ("a.json", '{"video": "perhaps"}', "video is true or false, got 'perhaps'"),
        ("a.json", '{"part": {"limit": [1, 2]}}', r"part\.limit takes one value"),
        ("a.json", '{"part": {"limit": {"gain": 1}}}', "a force law of one's own is for Python"),
        ("a.json", '{"sede": 3}', "did you mean seed"),
        ("a.json", "{", r"a\.json is no JSON"),
        ("a.json", "[1, 2]", "should hold settings by name"),
        ("a.toml", "seed = ", r"a\.toml is no TOML"),
        ("a.yaml", "seed: [", r"a\.yaml is no YAML"),
        ("a.txt", "seed 3", r"ends in \.json, \.toml"),
        (None, "", "cannot read"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, name, text, why):
    path = tmp_path / (name or "missing.json")
    if name:
        path.write_text(text)
    with pytest.raises(ConfigError, match=why):
        parsed("--config", str(path))


def commands():
    from breastscan import cli
    from breastscan.commands import calibrate, handeye, plan, reconstruct, scan, twin, view

    modules = (calibrate, handeye, plan, reconstruct, scan, twin, view)
    assert {module.__name__.rpartition(".")[2] for module in modules} <= set(cli.COMMANDS)
    return [getattr(module, module.__name__.rpartition(".")[2]) for module in modules]


UNIT = re.compile(r"\[[^\]]+\]|_px\b|_deg\b")
BARE_NUMBERS = frozenset(("seed", "points", "planes", "iterations", "paths", "bits", "columns"))


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.__name__)
def test_every_setting_says_what_it_is_and_in_which_unit(command):
    for path, setting in settings.settings_of(command).items():
        if "." not in path:
            continue
        assert setting.text, path
        if isinstance(setting.default, float) or setting.kind in (float, float | None):
            assert UNIT.search(setting.text) or UNIT.search(path), path


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.__name__)
def test_no_setting_swallows_what_stands_behind_it(command):
    """A file's options stand before positional arguments."""
    for path, setting in settings.settings_of(command).items():
        assert Ellipsis not in getattr(setting.kind, "__args__", ()), path


def test_one_file_may_be_given_to_every_command():
    """What one command has and another has not is left out there, and told."""
    names = {
        path.partition(".")[0] for command in commands() for path in settings.settings_of(command)
    }
    assert names - {"yes"} <= settings.OF_OTHERS


def test_consent_to_a_contact_is_not_taken_from_a_file(tmp_path):
    from breastscan.commands.scan import scan

    (tmp_path / "a.json").write_text('{"robot": "rtde://arm", "yes": true}')
    options, _ = settings.expanded(scan, ["--config", str(tmp_path / "a.json")])
    assert options == ["--robot", "rtde://arm"]


def test_what_a_file_leaves_unset_is_asked_for(tmp_path):
    from breastscan.commands.reconstruct import reconstruct

    (tmp_path / "a.json").write_text('{"rig": null}')
    assert settings.expanded(reconstruct, ["--config", str(tmp_path / "a.json")])[0] == []


def test_everyday_settings_exist():
    known = {path for command in commands() for path in settings.settings_of(command)}
    assert set(settings.EVERYDAY) <= known


def changed(config, path: str, value: object):
    """A config with one setting changed."""
    name, _, below = path.partition(".")
    inner = changed(getattr(config, name), below, value) if below else value
    return dataclasses.replace(config, **{name: inner})


MAY_BE_NEGATIVE = {"planning.joints.floor", "chest.azimuth"}
"""A height over the base, and a direction."""


def numbers():
    """The scan's settings of one number, with a config that holds each, its path in there, and what
    it cannot be.
    """
    from breastscan.commands.scan import scan
    from breastscan.scan import ScanConfig
    from sim.scene import SceneConfig

    for path, setting in settings.settings_of(scan).items():
        kinds = {setting.kind, *get_args(setting.kind)}
        if {float, int} & kinds and "link" not in path:
            if get_origin(setting.kind) is tuple or "." not in path:
                continue
            in_scene = path.removeprefix("scene.")
            wrong = [-1.0, math.nan] if float in kinds else [-1]
            config = SceneConfig() if in_scene != path else ScanConfig()
            yield config, in_scene, wrong if in_scene not in MAY_BE_NEGATIVE else [math.nan]


@pytest.mark.parametrize(
    ("config", "path", "wrong"), list(numbers()), ids=lambda value: str(value)[:60]
)
def test_a_number_that_cannot_be_is_refused_with_its_name(config, path, wrong):
    for number in wrong:
        with pytest.raises(ConfigError, match=path.rpartition(".")[2]):
            changed(config, path, number)
