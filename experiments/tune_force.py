"""With which gains does each force law do best? The same search, budget and tests for all of them.

`python -m experiments.tune_force` searches on the reduced model (`experiments.reduced_contact`):
scrambled Sobol points over wide bounds, then Nelder and Mead's simplex from the best of them, every
law with the same number of evaluations. An evaluation is the mean error over all cases, each over
what is required of it; among the cases is a plant that the law does not know, half as stiff again
and with a servo 8 ms later. What ships are the gains that come out.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize
from scipy.stats import qmc

from breastscan.control.contact import ContactConfig
from breastscan.control.laws import LAW_NAMES
from breastscan.run import writing
from experiments.reduced_contact import SENSORS, Plant, breathing, ramped, run, together, waviness

EVALUATIONS = 128
"""Of every law."""
SCREENED = 64
"""Of these, Sobol points."""
DURATION, STEADY_AFTER = 6.0, 1.5
"""Of a case, and from when its error counts [s]."""
TUNING_SEED, HELD_OUT_SEED = 100, 0
LOST = 5.0
"""Error of a case in which the probe was thrown off [N]; the set-point itself."""

BOUNDS: dict[str, dict[str, tuple[float, float]]] = {
    "observer": {
        "gains.observer.closing_time": (0.01, 0.5),
        "surface.process_noise": (1e-3, 0.1),
        "surface.force_noise": (0.03, 0.6),
    },
    "pi-stiffness": {
        "gains.pi_stiffness.proportional": (0.5, 30.0),
        "gains.pi_stiffness.integral": (0.5, 200.0),
        "gains.pi_stiffness.filter_hz": (2.0, 100.0),
    },
    "pi": {
        "gains.pi.proportional": (0.3e-3, 30e-3),
        "gains.pi.integral": (0.3e-3, 200e-3),
        "gains.pi.filter_hz": (2.0, 100.0),
    },
    "pd": {
        "gains.pd.proportional": (0.3e-3, 30e-3),
        "gains.pd.derivative": (1e-6, 1e-3),
        "gains.pd.filter_hz": (2.0, 100.0),
    },
    "fuzzy-pd": {
        "gains.fuzzy_pd.proportional": (0.3e-3, 30e-3),
        "gains.fuzzy_pd.derivative": (1e-6, 1e-3),
        "gains.fuzzy_pd.proportional_swing": (0.05, 1.0),
        "gains.fuzzy_pd.derivative_swing": (0.05, 1.0),
        "gains.fuzzy_pd.error_scale": (0.05, 5.0),
        "gains.fuzzy_pd.change_scale": (0.5, 100.0),
        "gains.fuzzy_pd.filter_hz": (2.0, 100.0),
    },
    "admittance": {
        "gains.admittance.mass": (0.1, 30.0),
        "gains.admittance.damping": (30.0, 3000.0),
        "gains.admittance.filter_hz": (2.0, 100.0),
    },
}
"""What is searched, and within which bounds, on a logarithmic scale."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One situation, and the error that is required in it."""

    plant: Callable[[int], Plant]
    """Of a seed."""
    bar: float
    """RMS [N]."""
    force: float = 5.0
    """Set-point [N]."""


def _plant(sensor: str, seed: int, *skins: Callable, **settings: Any) -> Plant:
    return Plant(sensor=SENSORS[sensor], skin=together(waviness(seed), *skins), **settings)


def _inclusion(time: float) -> float:
    """A mass four times as stiff as the tissue around it, felt as half as stiff again, over 20
    mm of path.
    """
    return 1.0 + 0.5 * float(np.exp(-(((time - 3.5) / 0.4) ** 2)))


def cases() -> dict[str, Case]:
    """The situations of the comparison."""
    sine, cos4 = partial(breathing, 0.005, "sine"), partial(breathing, 0.005, "cos4")
    up, down = (ramped(height, start=3.0, duration=2.0) for height in (-0.010, 0.010))
    return {
        "nominal, industrial": Case(plant=lambda s: _plant("industrial", s), bar=0.08),
        "10 kPa, 3 N, industrial": Case(
            plant=lambda s: _plant("industrial", s, young=10e3), bar=0.08, force=3.0
        ),
        "nominal, built-in": Case(plant=lambda s: _plant("ur5e_builtin", s), bar=0.25),
        "breathing, 20 kPa, industrial": Case(
            plant=lambda s: _plant("industrial", s, sine(phase=s), young=20e3), bar=0.15
        ),
        "breathing, 40 kPa, ideal": Case(
            plant=lambda s: _plant("ideal", s, cos4(phase=s), young=40e3), bar=0.25
        ),
        "breathing, 20 kPa, built-in": Case(
            plant=lambda s: _plant("ur5e_builtin", s, cos4(phase=s), young=20e3), bar=0.25
        ),
        "10 mm nearer, industrial": Case(plant=lambda s: _plant("industrial", s, up), bar=0.15),
        "10 mm farther, industrial": Case(plant=lambda s: _plant("industrial", s, down), bar=0.15),
        "inclusion, 20 kPa, industrial": Case(
            plant=lambda s: _plant("industrial", s, young=20e3, stiffness_scale=_inclusion),
            bar=0.15,
        ),
        "perturbed: 1.5 x 40 kPa, 42 ms, breathing": Case(
            plant=lambda s: _plant("industrial", s, sine(phase=s), young=60e3, lag=0.042), bar=0.25
        ),
        "perturbed: 60 kPa, 10 N, 42 ms, breathing": Case(
            plant=lambda s: _plant("industrial", s, cos4(phase=s), young=60e3, lag=0.042),
            bar=0.5,
            force=10.0,
        ),
        "perturbed: 1.5 x 40 kPa, 42 ms, nearer": Case(
            plant=lambda s: _plant("industrial", s, up, young=60e3, lag=0.042), bar=0.25
        ),
    }


def error(config: ContactConfig, case: Case, seed: int) -> float:
    """RMS force error of a case [N]."""
    config = replace(config, force=case.force)
    forces, _ = run(config, case.plant(seed), duration=DURATION, seed=seed)
    late = forces[round(STEADY_AFTER / DURATION * len(forces)) :] - case.force
    return min(float(np.sqrt(np.mean(late**2))), LOST)


def cost(config: ContactConfig, seed: int) -> float:
    """Mean over all cases of the error over its bar."""
    return float(np.mean([error(config, case, seed) / case.bar for case in cases().values()]))


def with_values(config: ContactConfig, values: dict[str, float]) -> ContactConfig:
    """The config with some settings replaced, named by their path."""
    for path, value in values.items():
        config = _with_value(config, path.split("."), value)
    return config


def _with_value(config: Any, path: list[str], value: float) -> Any:
    name, *rest = path
    return replace(
        config, **{name: _with_value(getattr(config, name), rest, value) if rest else value}
    )


def tune(law: str) -> tuple[dict[str, float], float]:
    """The best settings of a law, and their cost."""
    names, bounds = list(BOUNDS[law]), np.log(np.array(list(BOUNDS[law].values())))
    start, tried = ContactConfig(law=law), []  # type: ignore[arg-type]

    def evaluate(point: np.ndarray) -> float:
        inside = np.clip(point, bounds[:, 0], bounds[:, 1])
        values = dict(zip(names, np.exp(inside).tolist(), strict=True))
        tried.append((cost(with_values(start, values), TUNING_SEED), values))
        return tried[-1][0]

    sobol = qmc.Sobol(len(names), rng=TUNING_SEED).random(SCREENED)
    points = qmc.scale(sobol, *bounds.T)
    best = points[int(np.argmin([evaluate(point) for point in points]))]
    minimize(evaluate, best, method="Nelder-Mead", options={"maxfev": EVALUATIONS - SCREENED})
    least, values = min(tried, key=lambda pair: pair[0])
    return values, least


def main(out: Path = Path("out/tune_force")) -> None:
    """Tune every law, print its gains and its errors on held-out seeds."""
    console = Console(width=160)
    work = joblib.Parallel(n_jobs=2, return_as="generator")
    tuned: dict[Any, tuple[dict[str, float], float]] = {}
    found: Any = work(joblib.delayed(tune)(law) for law in LAW_NAMES)
    for law, (values, least) in zip(LAW_NAMES, found, strict=True):
        console.print(
            law, round(least, 3), {name: float(f"{value:.3g}") for name, value in values.items()}
        )
        tuned[law] = values, least
    table = Table("case", *LAW_NAMES, title=f"RMS force error [N], seed {HELD_OUT_SEED}")
    configs = {
        law: with_values(ContactConfig(law=law), values) for law, (values, _) in tuned.items()
    }
    for name, case in cases().items():
        errors = [error(config, case, HELD_OUT_SEED) for config in configs.values()]
        table.add_row(name, *(f"{value:.3f}" for value in errors))
    table.add_row(
        "mean over its bar, tuning seed", *(f"{least:.3f}" for _, least in tuned.values())
    )
    console.print(table)
    out.mkdir(parents=True, exist_ok=True)
    writing.write_json(out / "gains.json", {law: values for law, (values, _) in tuned.items()})


if __name__ == "__main__":
    main()
