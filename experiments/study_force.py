"""Which force law holds the probe best, and where does each end? All of them on the twin, in the
same circumstances.

Every cell is one contact scan (`experiments.force_cell`): the nominal one with each law and sensor,
what is required of the scan's own law, one factor at a time, and a Latin hypercube over all factors
at once. Gains come from one fair search (`experiments.tune_force`); the seeds here are others.
`python -m experiments.study_force --help` tells how to make it shorter.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import cast, get_args

import joblib
import numpy as np
import tyro
from rich.progress import track
from scipy.stats import qmc

from breastscan.control.contact import ContactConfig
from breastscan.control.laws import DEFAULT_LAW, LAW_NAMES, LawName
from breastscan.errors import ConfigError
from breastscan.run import writing
from breastscan.run.provenance import provenance
from experiments import force_cell, force_figures, force_mode_cell
from experiments.force_cell import Cell, Outcome
from experiments.force_mode_cell import Press
from sim.wrist.wrench_errors import Quality

SENSORS: tuple[Quality, ...] = get_args(Quality)
FACTORS: dict[str, dict] = {
    "nominal": {},
    "20 kPa": {"young": 20e3},
    "40 kPa": {"young": 40e3},
    "2 N": {"force": 2.0},
    "10 N, 60 kPa": {"force": 10.0, "young": 60e3},
    "10 mm/s": {"speed": 0.010},
    "50 mm/s": {"speed": 0.050},
    "inclusion": {"mass_ratio": 4.0},
    "breathing, sine": {"amplitude": 0.005, "young": 20e3},
    "breathing, cos⁴": {"amplitude": 0.005, "young": 20e3, "waveform": "cos4"},
    "10 mm nearer": {"surface_error": 0.010},
    "10 mm farther": {"surface_error": -0.010},
    "servo at 42 ms": {"lag": 0.042},
}
"""One factor at a time, against the nominal circumstances; breathing on 20 kPa, as is required of
it."""

REQUIRED: dict[str, tuple[float, dict]] = {
    "nominal, ideal": (0.06, {"sensor": "ideal"}),
    "nominal, industrial": (0.08, {"sensor": "industrial"}),
    "nominal, built-in": (0.25, {"sensor": "ur5e_builtin"}),
    "the same, its zero changing with the pose": (
        np.inf,
        {"sensor": "ur5e_builtin", "pose_offset": True},
    ),
    "breathing, sine, ideal": (0.15, FACTORS["breathing, sine"] | {"sensor": "ideal"}),
    "breathing, cos⁴, ideal": (0.15, FACTORS["breathing, cos⁴"] | {"sensor": "ideal"}),
    "breathing, sine, industrial": (0.15, FACTORS["breathing, sine"]),
    "breathing, cos⁴, industrial": (0.15, FACTORS["breathing, cos⁴"]),
    "breathing, sine, built-in": (0.25, FACTORS["breathing, sine"] | {"sensor": "ur5e_builtin"}),
    "breathing, cos⁴, built-in": (0.25, FACTORS["breathing, cos⁴"] | {"sensor": "ur5e_builtin"}),
    "breathing, sine, 40 kPa, ideal": (
        0.25,
        FACTORS["breathing, sine"] | {"sensor": "ideal", "young": 40e3},
    ),
    "breathing, cos⁴, 40 kPa, ideal": (
        0.25,
        FACTORS["breathing, cos⁴"] | {"sensor": "ideal", "young": 40e3},
    ),
}
"""RMS force error required of the scan's law [N], and where."""

RANGES: dict[str, tuple[float, float]] = {
    "young": (15e3, 60e3),
    "force": (2.0, 10.0),
    "speed": (0.010, 0.050),
    "amplitude": (0.0, 0.005),
    "rate": (0.15, 0.35),
    "surface_error": (-0.010, 0.010),
    "lag": (0.034, 0.042),
}
"""Of the hypercube."""
CHOICES: dict[str, Sequence] = {
    "sensor": SENSORS,
    "waveform": ("sine", "cos4"),
    "mass_ratio": (1.0, 4.0),
}
"""What it chooses from."""


@dataclass(frozen=True, kw_only=True)
class ForceStudy:
    """How much is run; the defaults take about an hour of two cores."""

    samples: int = 200
    """Points of the hypercube for the scan's own law."""
    compared: int = 40
    """The first of them, which the other laws see as well."""
    seeds: int = 10
    """Sensors and places on the path, of what is required of the scan's law."""
    places: int = 8
    """Of the loop, where the controller's own force mode presses, and the scan's law beside it."""
    jobs: int = 2
    """Processes."""

    def __post_init__(self) -> None:
        for field in fields(self):
            if getattr(self, field.name) < 1:
                raise ConfigError(
                    f"{field.name} must be 1 or more, got {getattr(self, field.name)}", self
                )


@dataclass(frozen=True, kw_only=True)
class Result:
    """All outcomes."""

    sensors: dict[str, dict[str, Outcome]]
    """By sensor."""
    required: dict[str, list[Outcome]]
    """By what is required; one a seed."""
    whole: dict[str, Outcome]
    """The whole loop, by sensor."""
    factors: dict[str, dict[str, Outcome]]
    """By circumstance."""
    hypercube: dict[str, list[Outcome]]
    force_mode: dict[str, list[Press]]
    """The controller's own, by circumstance."""
    beside: dict[Quality, list[Outcome]]
    """The scan's law at the same set-points, by sensor."""


def run(out: Path, *, seed: int, study: ForceStudy | None = None) -> Result:
    """Run every cell; leave figures, `study.md` and `study.json` in `out`.

    Args:
        out: Where the results go.
        seed: Of sensors, places on the path, and the hypercube.
        study: How much is run.
    """
    study = study or ForceStudy()
    # what is computed once and kept, before two processes need it
    force_cell.run(Cell(law=DEFAULT_LAW, mass_ratio=4.0))
    with writing.staged(out) as folder:
        result = _result(study, seed, _parallel(study.jobs))
        figures = force_figures.write(folder, result.factors, result.hypercube[DEFAULT_LAW])
        page = [
            *_page(result, study),
            *(f"![{caption}]({name})" for name, caption in figures.items()),
        ]
        (folder / "study.md").write_text("\n".join(page) + "\n", encoding="utf-8")
        settings = {"seed": seed, "study": study, **provenance()}
        writing.write_json(folder / "study.json", settings | {"outcomes": _plain(result)})
    return result


def cells(points: int, seed: int, law: LawName) -> list[Cell]:
    """A Latin hypercube over all factors."""
    names = [*RANGES, *CHOICES]
    sampled = qmc.LatinHypercube(len(names), rng=seed).random(points)
    drawn = []
    for number, point in enumerate(sampled):
        place = dict(zip(names, point.tolist(), strict=True))
        values = {name: low + place[name] * (high - low) for name, (low, high) in RANGES.items()}
        chosen = {
            name: options[int(place[name] * len(options))] for name, options in CHOICES.items()
        }
        drawn.append(Cell(law=law, seed=seed + number, **values, **chosen))
    return drawn


def _parallel(jobs: int) -> Callable[[list[Cell]], list[Outcome]]:
    workers = joblib.Parallel(n_jobs=jobs, return_as="generator")

    def outcomes(wanted: list[Cell]) -> list[Outcome]:
        running = cast(
            Iterator[Outcome], workers(joblib.delayed(force_cell.run)(cell) for cell in wanted)
        )
        return list(track(running, "cells", total=len(wanted)))

    return outcomes


def press(places: int, seed: int, jobs: int) -> dict[str, list[Press]]:
    """The controller's own force mode at so many places, by circumstance."""
    wanted = [(name, k / places, seed) for name in force_mode_cell.ZEROED for k in range(places)]
    workers = joblib.Parallel(n_jobs=jobs, return_as="generator")
    presses = cast(
        Iterator[list[Press]],
        workers(joblib.delayed(force_mode_cell.run)(*each) for each in wanted),
    )
    return {
        name: [one for _ in range(places) for one in next(presses)]
        for name in force_mode_cell.ZEROED
    }


def beside(places: int, seed: int) -> dict[Quality, list[Cell]]:
    """The scan's law at the set-points that force mode is asked for."""
    return {
        sensor: [
            Cell(law=DEFAULT_LAW, sensor=sensor, seed=seed + k, force=force, pose_offset=True)
            for force in force_mode_cell.FORCES
            for k in range(places)
        ]
        for sensor in ("ideal", "ur5e_builtin")
    }


def _result(
    study: ForceStudy, seed: int, outcomes: Callable[[list[Cell]], list[Outcome]]
) -> Result:
    seeds = range(seed, seed + study.seeds)
    required = [
        Cell(law=DEFAULT_LAW, **{**where, "seed": each})
        for _, where in REQUIRED.values()
        for each in seeds
    ]
    whole = [Cell(law=DEFAULT_LAW, sensor=sensor, seed=seed, whole_loop=True) for sensor in SENSORS]
    by_sensor = [Cell(law=law, sensor=sensor, seed=seed) for sensor in SENSORS for law in LAW_NAMES]
    by_factor = [
        Cell(law=law, seed=seed, **factor) for factor in FACTORS.values() for law in LAW_NAMES
    ]
    everywhere = cells(study.samples, seed, DEFAULT_LAW)
    others = [
        replace(cell, law=law)
        for law in LAW_NAMES
        if law != DEFAULT_LAW
        for cell in everywhere[: study.compared]
    ]
    done = iter(outcomes([*by_factor, *by_sensor, *whole, *required, *everywhere, *others]))
    factors = {name: {law: next(done) for law in LAW_NAMES} for name in FACTORS}
    sensors = {sensor: {law: next(done) for law in LAW_NAMES} for sensor in SENSORS}
    loops = {sensor: next(done) for sensor in SENSORS}
    assessed = {name: [next(done) for _ in seeds] for name in REQUIRED}
    hypercube = {DEFAULT_LAW: [next(done) for _ in everywhere]}
    for law in LAW_NAMES:
        if law != DEFAULT_LAW:
            hypercube[law] = [next(done) for _ in everywhere[: study.compared]]
    return Result(
        sensors=sensors,
        required=assessed,
        whole=loops,
        factors=factors,
        hypercube=hypercube,
        force_mode=press(study.places, seed, study.jobs),
        beside={sensor: outcomes(cells) for sensor, cells in beside(study.places, seed).items()},
    )


def _page(result: Result, study: ForceStudy) -> list[str]:
    """The study's tables."""
    return [
        *_required_table(result.required, study.seeds),
        *_contact_table(result),
        *_law_table("sensor", result.sensors),
        *_law_table("circumstance, industrial sensor", result.factors),
        *_hypercube_table(result.hypercube, study.compared),
        *_extremes_table(result),
        *force_mode_cell.table(result.force_mode, result.beside),
    ]


def _required_table(required: dict[str, list[Outcome]], seeds: int) -> list[str]:
    lines = [
        f"RMS of the true force error, law `{DEFAULT_LAW}`, {seeds} seeds [N].",
        "",
        "| circumstance | at most | mean | worst seed | bias, RMS over seeds | of the sensor, "
        "below 10 Hz |",
        "|---|---|---|---|---|---|",
    ]
    for (name, outcomes), (bar, _) in zip(required.items(), REQUIRED.values(), strict=True):
        rmse, bias, sensor = (
            [getattr(o, what) for o in outcomes] for what in ("rmse", "bias", "sensor_rms")
        )
        limit = f"{bar:.2f}" if np.isfinite(bar) else "-"
        figures = np.mean(rmse), np.max(rmse), np.sqrt(np.mean(np.square(bias))), np.mean(sensor)
        lines.append(f"| {name} | {limit} | {' | '.join(f'{value:.3f}' for value in figures)} |")
    return [*lines, ""]


def _contact_table(result: Result) -> list[str]:
    lines = [
        f"First contact at {ContactConfig().phases.approach_speed * 1e3:.0f} mm/s, and the motion "
        "along the path.",
        "",
        "| circumstance | overshoot [N] | within 10 % after [s] | off the plan, X, Y, Z [mm] | "
        "tilt, mean, max [°] |",
        "|---|---|---|---|---|",
    ]
    contacts = {
        **{name: result.factors[name][DEFAULT_LAW] for name in ("20 kPa", "40 kPa")},
        **{f"whole loop, {sensor}": outcome for sensor, outcome in result.whole.items()},
    }
    for name, o in contacts.items():
        across = ", ".join(f"{value * 1e3:.3f}" for value in o.tangential)
        tilt = f"{o.tilt_deg[0]:.2f}, {o.tilt_deg[1]:.2f}" if o.cell.whole_loop else "-"
        lines.append(f"| {name} | {o.overshoot:.2f} | {o.settling:.2f} | {across} | {tilt} |")
    return [*lines, ""]


def _law_table(title: str, rows: dict[str, dict[str, Outcome]]) -> list[str]:
    lines = [
        "RMS of the true force error / its largest value over the set-point at any time [N]; * "
        "left 8 mm of indentation, † ended by the supervisor.",
        "",
        f"| {title} | {' | '.join(LAW_NAMES)} |",
        f"|---|{'---|' * len(LAW_NAMES)}",
    ]
    for name, outcomes in rows.items():
        lines.append(f"| {name} | {' | '.join(_figure(outcomes[law]) for law in LAW_NAMES)} |")
    return [*lines, ""]


def _figure(o: Outcome) -> str:
    marks = ("" if o.inside else "*") + ("†" if o.ended else "")
    return f"{o.rmse:.3f} / {o.highest - o.cell.force:.2f}{marks}"


def _hypercube_table(hypercube: dict[str, list[Outcome]], compared: int) -> list[str]:
    lines = [
        f"The first {compared} points of the hypercube, those inside 8 mm of indentation.",
        "",
        "| law | RMSE, median [N] | 90 % [N] | largest over the set-point [N] | "
        "lowest fraction of it | left 8 mm | ended |",
        "|---|---|---|---|---|---|---|",
    ]
    return [*lines, *(f"| {law} | {_spread(hypercube[law][:compared])} |" for law in LAW_NAMES), ""]


def _spread(outcomes: list[Outcome]) -> str:
    inside = [o for o in outcomes if o.inside and not o.ended]
    ended = sum(bool(o.ended) for o in outcomes)
    beyond = sum(not o.inside for o in outcomes)
    if not inside:
        return f"- | - | - | - | {beyond} | {ended}"
    rmse = [o.rmse for o in inside]
    over, fraction = (
        max(o.highest - o.cell.force for o in inside),
        min(o.lowest / o.cell.force for o in inside),
    )
    return (
        f"{np.median(rmse):.3f} | {np.quantile(rmse, 0.9):.3f} | {over:.2f} | {fraction:.2f} | "
        f"{beyond} | {ended}"
    )


def _extremes_table(result: Result) -> list[str]:
    """How far the default law's true force went from the set-point in all cells inside 8 mm."""
    everything = [
        o
        for outcomes in (*result.required.values(), result.hypercube[DEFAULT_LAW])
        for o in outcomes
    ]
    everything += [
        outcomes[DEFAULT_LAW] for outcomes in (*result.factors.values(), *result.sensors.values())
    ]
    lines = [
        f"All cells of `{DEFAULT_LAW}`, by sensor.",
        "",
        "| sensor | cells | left 8 mm | ended | largest over the set-point [N] | "
        "lowest fraction of it in the loop |",
        "|---|---|---|---|---|---|",
    ]
    for sensor in SENSORS:
        here = [o for o in everything if o.cell.sensor == sensor]
        inside = [o for o in here if o.inside]
        over = max((o.highest - o.cell.force for o in inside), default=np.nan)
        fraction = min(
            (o.lowest / o.cell.force for o in inside if not np.isnan(o.lowest)), default=np.nan
        )
        ended = sum(bool(o.ended) for o in here)
        lines.append(
            f"| {sensor} | {len(here)} | {len(here) - len(inside)} | {ended} | {over:.2f} | "
            f"{fraction:.2f} |"
        )
    reasons = sorted({o.ended for o in everything if o.ended})
    return [*lines, "", *(f"- {reason}" for reason in reasons), ""]


def _plain(result: Result) -> list[dict[str, object]]:
    """Every outcome without its trace; what is not known is left out."""
    groups = (*result.required.values(), *result.hypercube.values(), [*result.whole.values()])
    table = [o for group in groups for o in group]
    table += [
        o
        for rows in (result.sensors, result.factors)
        for by_law in rows.values()
        for o in by_law.values()
    ]
    return [
        {name: value for name, value in vars(o).items() if _is_known(value) and name != "trace"}
        for o in table
    ]


def _is_known(value: object) -> bool:
    numbers = value if isinstance(value, tuple) else (value,)
    return not any(isinstance(number, float) and np.isnan(number) for number in numbers)


def main(
    out: Path = Path("out/study_force"), seed: int = 0, study: ForceStudy = ForceStudy()
) -> None:
    """Run the study at another length.

    Args:
        out: Where the results go.
        seed: Of everything random.
        study: How much is run.
    """
    run(out, seed=seed, study=study)


if __name__ == "__main__":
    tyro.cli(main)
