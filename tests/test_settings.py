"""Settings by name: what a config holds, and copies with other values."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from breastscan.errors import ConfigError
from breastscan.settings import names, read_file, with_values


@dataclass(frozen=True, kw_only=True)
class Inner:
    length: float = 1.0
    count: int = 3
    kind: Literal["soft", "hard"] = "soft"
    place: tuple[float, float] = (0.0, 0.0)
    file: Path | None = None
    on: bool = True

    def __post_init__(self):
        if self.length <= 0:
            raise ConfigError("length must be positive")


@dataclass(frozen=True, kw_only=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    speed: float = 0.1


def test_every_setting_has_one_whole_name():
    assert list(names(Outer())) == [
        "inner.length", "inner.count", "inner.kind", "inner.place", "inner.file", "inner.on",
        "speed",
    ]  # fmt: skip


def test_a_copy_has_the_values_as_their_kinds():
    changed = with_values(
        Outer(),
        {"inner.length": 2, "inner.kind": "hard", "inner.place": [1, 2], "inner.file": "a/b",
         "inner.on": False, "speed": 0.5},
    )  # fmt: skip
    assert changed == Outer(
        inner=Inner(length=2.0, kind="hard", place=(1.0, 2.0), file=Path("a/b"), on=False),
        speed=0.5,
    )
    assert isinstance(changed.inner.length, float)
    assert with_values(changed, {"inner.file": None}).inner.file is None
    assert with_values(Outer(), {}) == Outer()


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"inner.lenght": 2}, "'inner.lenght', did you mean inner.length"),
        ({"length": 2}, "did you mean inner.length"),
        ({"inner": 2}, "there is no setting 'inner'"),
        ({"speed.inner": 2}, "there is no setting"),
        ({"inner.count": 2.5}, "inner.count should be a whole number, got '2.5'"),
        ({"inner.kind": "wet"}, "inner.kind should be one of soft, hard"),
        ({"inner.length": float("nan")}, "inner.length should be a number"),
        ({"inner.on": 1}, "inner.on should be true or false"),
        ({"inner.file": 3}, "inner.file should be a file"),
        ({"inner.length": -1}, "length must be positive"),
    ],
)
def test_other_values_are_refused_by_name(values, told):
    with pytest.raises(ConfigError, match=told):
        with_values(Outer(), values)


def test_a_file_of_each_kind_holds_the_same(tmp_path):
    for name, text in {
        "a.json": '{"speed": 2.0, "inner": {"count": 1}}',
        "a.toml": "speed = 2.0\n[inner]\ncount = 1\n",
        "a.yaml": "speed: 2.0\ninner: {count: 1}\n",
    }.items():
        (tmp_path / name).write_text(text)
        assert read_file(tmp_path / name, "it") == {"speed": 2.0, "inner": {"count": 1}}
