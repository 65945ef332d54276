"""What a sweep varies: a file's settings, and the runs that it asks for.

A design point is one choice of all that is varied: of every combination (`grid`), or drawn so that
the points cover what is varied evenly, by a Latin hypercube (`lhs`) or a Sobol sequence (`sobol`)
[scipy.stats.qmc].
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

import numpy as np
import scipy.stats
from scipy.stats import qmc

from breastscan.errors import ConfigError
from breastscan.scan import ScanConfig
from breastscan.settings import names, read_file, require_name, with_values
from sim.scene import SceneConfig

Design = Literal["grid", "lhs", "sobol"]
ONE_OF_ITS_OWN = 2**31
"""Seeds of the runs lie below."""
FILES = frozenset(("rig", "scene.rig"))
"""Settings that name a file."""


@dataclass(frozen=True, kw_only=True)
class RunConfig(ScanConfig):
    """All that a run is made with, by the names of `config.json`."""

    scene: SceneConfig = field(default_factory=SceneConfig)
    rig: Path | None = None
    """File of an estimated rig to see with."""


@dataclass(frozen=True)
class Run:
    """One scan of a sweep."""

    number: int
    design: int
    """Number of its design point."""
    seed: int
    """Of all in it that is drawn."""
    settings: dict[str, Any]
    """By name; what is not there is as by default."""
    varied: dict[str, Any]
    """What the design point chose, by the name of what is varied."""

    def config(self) -> RunConfig:
        """Its settings, checked.

        Raises:
            ConfigError: They do not go together.
        """
        return with_values(RunConfig(), self.settings)


class Spec(Protocol):
    """What asks for the runs of a study."""

    @property
    def vary(self) -> Iterable[str]:
        """Columns of the data set that say what varied."""
        ...

    def runs(self, seed: int) -> list[Run]:
        """All runs, in order."""
        ...


def _uniform(bounds: Sequence[float], u: float) -> float:
    low, high = bounds
    return low + u * (high - low)


def _log(bounds: Sequence[float], u: float) -> float:
    low, high = bounds
    return low * (high / low) ** u


def _normal(parameters: Sequence[float], u: float) -> float:
    mean, deviation = parameters
    return float(scipy.stats.norm.ppf(u, mean, deviation))


def _integer(bounds: Sequence[int], u: float) -> int:
    low, high = bounds
    return low + int(u * (high - low))


def _choice(options: Sequence[Any], u: float) -> Any:
    return options[min(int(u * len(options)), len(options) - 1)]


DRAWN: dict[str, Callable[[Sequence[Any], float], Any]] = {
    "uniform": _uniform,
    "log": _log,
    "normal": _normal,
    "integer": _integer,
    "choice": _choice,
}
"""Quantile functions by the name of the distribution: [low, high], [low, high], [mean, standard
deviation], [low, high) of whole numbers, and what is chosen from with equal chances."""


def _range(first: float, last: float, count: int) -> list[float | int]:
    points = np.linspace(first, last, count).tolist()
    whole = isinstance(first, int) and isinstance(last, int)
    return [round(x) for x in points] if whole and all(x == round(x) for x in points) else points


LISTED: dict[str, Callable[[Sequence[Any]], list[Any]]] = {
    "values": list,
    "range": lambda three: _range(*three),
}
"""Levels of a grid by their kind: the values, or [first, last, how many]."""
NUMBERS = {"uniform": 2, "log": 2, "normal": 2, "integer": 2, "range": 3}
"""How many numbers each kind takes."""


@dataclass(frozen=True, kw_only=True)
class SweepSpec:
    """What a sweep's file holds."""

    vary: dict[str, dict[str, list[Any]]]
    """For each setting a kind (`DRAWN`, `LISTED`) and what it takes. Under a name of one's own,
    `choice` and `values` take settings by name, which then change together."""
    design: Design = "grid"
    """How the design points are chosen."""
    count: int | None = None
    """How many are drawn; a grid has as many as it has."""
    settings: dict[str, Any] = field(default_factory=dict)
    """What is the same in all runs, by name."""
    seeds: list[int] | None = None
    """Every design point runs under each of these; without them each run has a seed of its own."""
    repetitions: int = 1
    """How often each design point runs, each time under another seed of its own."""

    def __post_init__(self) -> None:
        for name, fits, expected in (
            ("vary", isinstance(self.vary, dict), "settings by name"),
            ("settings", isinstance(self.settings, dict), "settings by name"),
            ("design", self.design in get_args(Design), f"one of {', '.join(get_args(Design))}"),
            ("count", self.count is None or _counts(self.count), "a whole number from 1"),
            ("repetitions", _counts(self.repetitions), "a whole number from 1"),
            ("seeds", self.seeds is None or _are_seeds(self.seeds), "whole numbers from 0"),
        ):
            if not fits:
                got = vars(self)[name]
                raise ConfigError(f"{name} should be {expected}, got {got!r}", got)
        if (self.design == "grid") != (self.count is None):
            why = "has as many points as it has" if self.count else "takes the count of its points"
            raise ConfigError(f"a design {self.design!r} {why}, got count: {self.count}", self)
        if self.seeds is not None and self.repetitions != 1:
            raise ConfigError("give seeds or repetitions, not both: each seed is one", self)
        known = list(names(RunConfig()))
        for name in self.settings:
            require_name(name, known, " (in settings)")
        for name, factor in self.vary.items():
            _require_factor(name, factor, known, self.design)
        twice = set(self.settings) & set(self.vary)
        if twice:
            raise ConfigError(f"{', '.join(sorted(twice))}: both fixed and varied", twice)

    def runs(self, seed: int) -> list[Run]:
        """All runs, in order.

        Args:
            seed: Of what is drawn here: the points, and the runs' own seeds.

        Raises:
            ConfigError: A value is of another kind than its setting.
        """
        points = list(self._points(seed))
        own = np.random.default_rng([seed, 1])
        found: list[Run] = []
        for design, varied in enumerate(points):
            settings = dict(self.settings)
            for name, value in varied.items():
                settings |= value if isinstance(value, dict) else {name: value}
            for one in self.seeds or own.integers(ONE_OF_ITS_OWN, size=self.repetitions).tolist():
                told = {name: _label(name, value, self) for name, value in varied.items()}
                found.append(Run(len(found), design, one, settings, told))
        for run in found[:1]:
            run.config()  # a value of another kind is refused before anything runs
        return found

    @property
    def size(self) -> int:
        """How many runs there are."""
        points = self.count or math.prod(len(_levels(factor)) for factor in self.vary.values())
        return points * (len(self.seeds) if self.seeds else self.repetitions)

    def _points(self, seed: int) -> Sequence[dict[str, Any]]:
        if self.count is None:
            levels = [_levels(factor) for factor in self.vary.values()]
            return [dict(zip(self.vary, one, strict=True)) for one in itertools.product(*levels)]
        rng = np.random.default_rng([seed, 0])
        if self.design == "lhs":
            unit = qmc.LatinHypercube(len(self.vary), rng=rng).random(self.count)
        else:
            power = math.ceil(math.log2(self.count))  # balanced at whole powers of two
            unit = qmc.Sobol(len(self.vary), rng=rng).random_base2(power)[: self.count]
        inside = np.clip(unit, np.finfo(float).eps, 1 - np.finfo(float).eps)
        return [dict(zip(self.vary, map(drawn, self.vary.values(), row), strict=True))
                for row in inside.tolist()]  # fmt: skip


def _counts(count: object) -> bool:
    return type(count) is int and count >= 1


def _are_seeds(seeds: object) -> bool:
    return (
        isinstance(seeds, list)
        and bool(seeds)
        and all(type(seed) is int and seed >= 0 for seed in seeds)
    )


def drawn(factor: Mapping[str, list[Any]], u: float) -> Any:
    """The value of a distribution, as {uniform: [1, 2]}, at a quantile."""
    ((kind, takes),) = factor.items()
    return DRAWN[kind](takes, u)


def _levels(factor: Mapping[str, list[Any]]) -> list[Any]:
    ((kind, takes),) = factor.items()
    return LISTED[kind](takes)


def _label(name: str, value: Any, spec: SweepSpec) -> Any:
    """What the table tells of a choice; of several settings together, which option it is."""
    if not isinstance(value, dict):
        return value
    (options,) = spec.vary[name].values()
    return str(options.index(value))


def _require_factor(
    name: str, factor: dict[str, list[Any]], known: list[str], design: Design
) -> None:
    """Accept what one setting is varied over.

    Raises:
        ConfigError: It fits neither the setting nor the design, or is empty.
    """
    if not isinstance(factor, dict) or len(factor) != 1:
        raise ConfigError(
            f"{name} takes one kind and what it varies over, as {{uniform: [1, 2]}}, got {factor}",
            factor,
        )
    ((kind, takes),) = factor.items()
    fitting, others = (LISTED, DRAWN) if design == "grid" else (DRAWN, LISTED)
    if kind not in fitting:
        hint = "choose design: lhs or sobol" if design == "grid" else "or choose design: grid"
        why = f"which a design {design!r} has no use for, {hint}" if kind in others else "unknown"
        raise ConfigError(
            f"{name} is varied by {kind!r}, {why}; {design!r} takes {', '.join(fitting)}", factor
        )
    if not isinstance(takes, list) or not takes:
        raise ConfigError(f"{name}: {kind} varies over nothing, got {takes!r}", factor)
    if kind in NUMBERS:
        _require_numbers(name, kind, takes)
    together = [option for option in takes if isinstance(option, dict)]
    if together and len(together) == len(takes) and kind in ("choice", "values"):
        for setting in {setting for option in together for setting in option}:
            require_name(setting, known, f" (in {name})")
    else:
        require_name(name, known, " (in vary)")


def _require_numbers(name: str, kind: str, takes: list[Any]) -> None:
    numeric = all(type(x) in (int, float) and math.isfinite(x) for x in takes)
    valid = numeric and len(takes) == NUMBERS[kind]
    if valid and kind == "range":
        valid = isinstance(takes[2], int) and takes[2] >= 1 and takes[0] <= takes[1]
    elif valid and kind == "normal":
        valid = takes[1] > 0
    elif valid:
        whole = all(isinstance(x, int) for x in takes) or kind != "integer"
        valid = whole and takes[0] < takes[1] and (kind != "log" or takes[0] > 0)
    if not valid:
        expected = {
            "uniform": "[low, high], low < high",
            "log": "[low, high], 0 < low < high",
            "normal": "[mean, standard deviation], the latter positive",
            "integer": "[low, high) of whole numbers, low < high",
            "range": "[first, last, how many], first <= last and one at least",
        }[kind]
        raise ConfigError(f"{name}: {kind} takes {expected}, got {takes}", takes)


def load(path: Path) -> SweepSpec:
    """Read a sweep's file.

    Raises:
        ConfigError: It is missing, of another format, or holds what a sweep has no use for.
    """
    content = read_file(path, "a sweep's file")
    return parsed(_located(content, path.parent), str(path))


def _located(content: Any, folder: Path) -> Any:
    """With the files that it names beside its own file, where they lie there."""
    if isinstance(content, list):
        return [_located(one, folder) for one in content]
    if not isinstance(content, dict):
        return content
    found = {name: _located(value, folder) for name, value in content.items()}
    for name in FILES.intersection(found):
        if isinstance(found[name], str) and (folder / found[name]).is_file():
            found[name] = str(folder / found[name])
    return found


def parsed(content: dict[str, Any], where: str) -> SweepSpec:
    """A sweep from what its file holds; `where` names it in errors.

    Raises:
        ConfigError: It holds what a sweep has no use for.
    """
    known = [f.name for f in fields(SweepSpec)]
    if "vary" not in content or set(content) - set(known):
        raise ConfigError(
            f"{where} should hold vary and any of {', '.join(known[1:])}, got "
            f"{', '.join(map(str, content))}",
            content,
        )
    return SweepSpec(**content)
