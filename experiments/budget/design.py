"""What an error budget scans: every source realistic or ideal, in sets that tell them apart.

Each source is drawn from distributions of its own (`assets/studies/budget.yaml`), at points of a
Sobol sequence. The sets of a row have their draws in common: a source alone or left out is seen on
the same breast, with the same noise, as all together. For indices of variance, rows of a second
sample lend one source's draw at a time to those of the first [Saltelli 2010].
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from breastscan.errors import ConfigError
from breastscan.settings import read_file
from experiments.budget.rigs import composed
from experiments.sweep.spec import Run, drawn

ASSETS = Path(str(resources.files("assets")))
SPEC = ASSETS / "studies" / "budget.yaml"
TRUE_RIG = ASSETS / "rig.yaml"
RIG_PARTS = ("rig.intrinsics", "rig.extrinsics", "rig.hand_eye")
"""Whose error each of a rig's parts has: a file each, none for no error."""
COUNT = 20
"""Paired scans of each set."""
SAMPLES = 64
"""Groups of scans for the indices."""
SCAN_SEED = 0
"""Of what no source draws: nothing."""
REALISTIC, IDEAL = "realistic", "ideal"
"""What a column of the data set says of a source."""
NONE, ALL = "none", "all"
"""Sets with no source, and with all."""
FIRST, SECOND = "first sample", "second sample"
"""Sets with all, for the indices."""

Point = Mapping[str, tuple[float, ...] | None]
"""By source the quantiles of what it draws; None where it is ideal."""


def alone(source: str) -> str:
    """Name of the set in which a source is alone."""
    return f"alone: {source}"


def all_but(source: str) -> str:
    """Name of the set that leaves a source out."""
    return f"all but: {source}"


def exchanged(source: str) -> str:
    """Name of the first sample with a source's draws from the second."""
    return f"exchanged: {source}"


@dataclass(frozen=True, kw_only=True)
class Source:
    """What makes one source of error realistic, and what makes it ideal."""

    realistic: dict[str, Any]
    """Settings by name: a value, or a distribution as a sweep takes it."""
    ideal: dict[str, Any]
    """Settings by name: a value."""

    @property
    def dimensions(self) -> int:
        """How many numbers it draws."""
        return sum(isinstance(value, dict) for value in self.realistic.values())

    def settings(self, quantiles: tuple[float, ...] | None) -> dict[str, Any]:
        """Its settings; `None` where it is ideal."""
        if quantiles is None:
            return self.ideal
        left = iter(quantiles)
        return {
            name: drawn(value, next(left)) if isinstance(value, dict) else value
            for name, value in self.realistic.items()
        }


@dataclass(frozen=True, kw_only=True)
class Scans:
    """The scans of a budget, each once."""

    runs: list[Run]
    sets: dict[str, list[int]]
    """Numbers of the runs of each set, a row each."""
    rigs: dict[str, tuple[Path, ...]]
    """Files that the runs see with, and those that their parts come from."""

    def write_rigs(self) -> None:
        """Write the rigs' files.

        Raises:
            ConfigError: Nothing can be written there.
        """
        for name, parts in self.rigs.items():
            path = Path(name)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ConfigError(
                    f"cannot write {path} ({error.strerror}): choose another --out", path
                ) from error
            composed(TRUE_RIG, *parts).save(path)


@dataclass(frozen=True, kw_only=True)
class BudgetSpec:
    """What a budget is made from."""

    sources: dict[str, Source]
    tied: dict[str, list[str]]
    """By the name of a set with all sources: those that take the first one's draw, as one
    calibration gives them."""
    count: int = COUNT
    """Paired scans of each set."""
    samples: int = SAMPLES
    """Groups of scans for the indices, best a power of two."""
    rigs: str
    """Folder for the rigs that are seen with."""

    def __post_init__(self) -> None:
        for name in ("count", "samples"):
            if getattr(self, name) < 1:
                got = getattr(self, name)
                raise ConfigError(f"{name} should be a whole number from 1, got {got}", got)

    @property
    def vary(self) -> list[str]:
        """Columns of the data set that say which sources were realistic."""
        return list(self.sources)

    @property
    def size(self) -> int:
        """How many scans there are at the most: some sets have scans in common."""
        k = len(self.sources)
        return 1 + self.count * (2 * k + 1 + len(self.tied)) + self.samples * (k + 2)

    def runs(self, seed: int) -> list[Run]:
        """All runs, in order."""
        return self.scans(seed).runs

    def scans(self, seed: int) -> Scans:
        """All runs, and which sets they are of.

        Args:
            seed: Of the draws.
        """
        found = Scans(runs=[], sets={}, rigs={})
        known: dict[str, int] = {}
        for name, points in self._sets(seed).items():
            numbers = found.sets.setdefault(name, [])
            for point in points:
                settings = self._settings(point, found.rigs)
                number = known.setdefault(json.dumps(settings), len(found.runs))
                if number == len(found.runs):
                    kinds = {s: IDEAL if q is None else REALISTIC for s, q in point.items()}
                    varied = {"set": name, **kinds}
                    found.runs.append(Run(number, number, SCAN_SEED, settings, varied))
                numbers.append(number)
        found.runs[0].config()  # of a version that has these settings
        return found

    def _sets(self, seed: int) -> dict[str, Sequence[Point]]:
        first, second = self._samples(seed)
        few, nothing = first[: self.count], dict.fromkeys(self.sources)
        found: dict[str, Sequence[Point]] = {NONE: [nothing], ALL: few}
        for name, tied in self.tied.items():
            found[name] = [{**point, **dict.fromkeys(tied, point[tied[0]])} for point in few]
        for source in self.sources:
            found[alone(source)] = [{**nothing, source: point[source]} for point in few]
            found[all_but(source)] = [{**point, source: None} for point in few]
        found[FIRST], found[SECOND] = first[: self.samples], second[: self.samples]
        for source in self.sources:
            pairs = zip(found[FIRST], found[SECOND], strict=True)
            found[exchanged(source)] = [{**a, source: b[source]} for a, b in pairs]
        return found

    def _samples(self, seed: int) -> tuple[list[Point], list[Point]]:
        """Two independent samples of all sources."""
        ends = np.cumsum([source.dimensions for source in self.sources.values()]).tolist()
        rng = np.random.default_rng(seed)
        power = math.ceil(math.log2(max(self.count, self.samples)))
        unit = qmc.Sobol(2 * ends[-1], rng=rng).random_base2(power)
        inside = np.clip(unit, np.finfo(float).eps, 1 - np.finfo(float).eps)

        def points(half: Float[np.ndarray, "rows dimensions"]) -> list[Point]:
            parts = [tuple(map(tuple, part.tolist())) for part in np.split(half, ends[:-1], axis=1)]
            return [dict(zip(self.sources, row, strict=True)) for row in zip(*parts, strict=True)]

        return points(inside[:, : ends[-1]]), points(inside[:, ends[-1] :])

    def _settings(self, point: Point, rigs: dict[str, tuple[Path, ...]]) -> dict[str, Any]:
        """The settings of a scan; notes the rig that it sees with."""
        found: dict[str, Any] = {}
        for name, source in self.sources.items():
            found |= source.settings(point[name])
        parts = [found.pop(part, None) for part in RIG_PARTS]
        if any(parts):
            stem = "-".join(Path(part).stem if part else "true" for part in parts)
            found["rig"] = f"{self.rigs}/{stem}.yaml"
            rigs[found["rig"]] = tuple(SPEC.parent / p if p else TRUE_RIG for p in parts)
        return found


def load(count: int | None, samples: int | None, folder: Path) -> BudgetSpec:
    """The budget of so many scans, whose rigs go into a folder.

    Args:
        count: Paired scans of each set; None for `COUNT`.
        samples: Groups for the indices; None for `SAMPLES`.
        folder: Of the study.

    Raises:
        ConfigError: There are none.
    """
    content = read_file(SPEC, "the budget's file")
    return BudgetSpec(
        sources={name: Source(**source) for name, source in content["sources"].items()},
        tied=content["tied"],
        count=COUNT if count is None else count,
        samples=SAMPLES if samples is None else samples,
        rigs=str(folder.resolve() / "rigs"),
    )
