"""Settings by name: `phantom.young` of a config, a copy with another value there, and values as
files hold them.
"""

import dataclasses
import difflib
import json
import math
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import yaml

from breastscan.errors import ConfigError

Config = TypeVar("Config")
READERS: dict[str, Callable[[str], Any]] = {
    ".json": json.loads,
    ".toml": tomllib.loads,
    ".yaml": yaml.safe_load,
    ".yml": yaml.safe_load,
}
"""What reads a file of settings, by how its name ends."""
TOLD: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a word",
    Path: "a file",
}
"""Kinds as errors tell them."""


def read_file(path: Path, what: str) -> dict[str, Any]:
    """What a file holds by name.

    Args:
        path: Of JSON, TOML or YAML, as its name ends.
        what: It is, for errors.

    Raises:
        ConfigError: It is missing, of another format, or holds nothing by name.
    """
    if path.suffix not in READERS:
        raise ConfigError(f"{what} ends in {', '.join(READERS)}; got {str(path)!r}", path)
    try:
        content = READERS[path.suffix](path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}", path) from error
    except (ValueError, yaml.YAMLError) as error:  # JSON's and TOML's errors are ValueErrors
        raise ConfigError(f"{path} is no {path.suffix[1:].upper()} ({error})", path) from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path} should hold settings by name, as a run's config.json", path)
    return content


def names(config: object, prefix: str = "") -> Iterator[str]:
    """The whole names of a config's settings, those of configs inside it as well."""
    for name, value in vars(config).items():
        if dataclasses.is_dataclass(value):
            yield from names(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def flat(
    content: dict[str, Any], is_split: Callable[[str], bool] = lambda name: True, prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Nested names and their values, the former whole.

    Args:
        content: By name, as a file holds it.
        is_split: Of a name, whether what it holds by name counts one by one.
        prefix: Of all names.
    """
    for key, value in content.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and is_split(name):
            yield from flat(value, is_split, f"{name}.")
        else:
            yield name, value


def require_name(name: str, known: Collection[str], where: str = "") -> None:
    """Accept the name of a setting.

    Args:
        name: As given.
        known: The names that there are.
        where: What it was given in, for the error.

    Raises:
        ConfigError: There is none; names the nearest.
    """
    if name in known:
        return
    near = difflib.get_close_matches(name, known, 3)
    leaf = [path for path in known if path.rpartition(".")[2] == name.rpartition(".")[2]]
    meant = f", did you mean {' or '.join(near or leaf[:3])}?" if near or leaf else "."
    raise ConfigError(
        f"there is no setting {name!r}{where}{meant} --help-all lists every setting", name
    )


def with_values(config: Config, values: Mapping[str, Any], prefix: str = "") -> Config:
    """A frozen config with other values, checked as its class checks them.

    Args:
        config: With configs inside it, or without.
        values: By the names that `names` gives, as a file of JSON, TOML or YAML holds them.
        prefix: Of the names, for errors.

    Raises:
        ConfigError: A name is none, or a value is of another kind or out of range.
    """
    known = list(names(config, prefix))
    hints = get_type_hints(type(config))
    changed: dict[str, Any] = {}
    inside: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        require_name(f"{prefix}{name}", known)
        field, dot, below = name.partition(".")
        if dot:
            inside.setdefault(field, {})[below] = value
        else:
            changed[field] = read_value(hints[field], value, f"{prefix}{name}")
    for field, below in inside.items():
        changed[field] = with_values(vars(config)[field], below, f"{prefix}{field}.")
    return dataclasses.replace(config, **changed)  # pyright: ignore[reportArgumentType]


def read_value(kind: Any, content: Any, where: str) -> Any:
    """A value of a field's kind from what JSON holds.

    Args:
        kind: As annotated.
        content: Numbers, words, lists, and dictionaries by the fields of a dataclass.
        where: Names it in errors.

    Raises:
        ConfigError: It is of another kind.
    """
    if get_origin(kind) in (Union, UnionType):
        if content is None and NoneType in get_args(kind):
            return None
        options = [option for option in get_args(kind) if option is not NoneType]
        if len(options) == 1:
            return read_value(options[0], content, where)
        for option in options:
            with suppress(ConfigError):
                return read_value(option, content, where)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return kind(**read_fields(kind, content, where))
    if get_origin(kind) is tuple and isinstance(content, list | tuple):
        return tuple(
            read_value(get_args(kind)[0], one, f"{where}[{k}]") for k, one in enumerate(content)
        )
    if get_origin(kind) is Literal and content in get_args(kind):
        return content
    if (
        kind is float
        and isinstance(content, float | int)
        and not isinstance(content, bool)
        and math.isfinite(content)
    ):
        return float(content)
    if kind in (bool, int, str) and type(content) is kind:
        return content
    if kind is Path and isinstance(content, str):
        return Path(content)
    if (
        kind not in (bool, float, int, str)
        and isinstance(content, list)
        and get_origin(kind) is None
    ):
        with suppress(TypeError, ValueError):
            values = np.array(content, float)
            if isinstance(values, kind) and np.isfinite(values).all():
                return values
    raise ConfigError(f"{where} should be {_told(kind)}, got {str(content)[:60]!r}", content)


def _told(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return f"one of {', '.join(map(str, get_args(kind)))}"
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(map(_told, get_args(kind)))
    shape = getattr(kind, "dim_str", None)
    if shape:
        return f"numbers of the shape ({shape})"
    return TOLD.get(kind, str(getattr(kind, "__name__", kind)))


def read_fields(kind: Any, content: Any, where: str) -> dict[str, Any]:
    """The fields of a dataclass from what JSON holds; as `read_value`."""
    fields = {f.name for f in dataclasses.fields(kind)}
    if not isinstance(content, dict) or set(content) != fields:
        raise ConfigError(
            f"{where} should hold {', '.join(sorted(fields))}, and nothing else", content
        )
    hints = get_type_hints(kind)
    return {name: read_value(hints[name], content[name], f"{where}: {name}") for name in fields}
