"""What does the weight of a control vertex do to a NURBS curve? [Zhang, Eq. 16]

The same control vertices with one weight changed: the curve is drawn to the vertex or let go, and
stays as it is beyond the vertex's own four spans. Interpolation with other weights still passes
every point, so the scan leaves them at 1.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from breastscan.geometry.nurbs import Nurbs
from breastscan.report import theme
from breastscan.run import writing
from breastscan.run.provenance import provenance

POINTS, VERTEX = 12, 3
WEIGHTS = (0.2, 1.0, 5.0)
SAMPLES = 2000
RADIUS = 0.06
"""Mean radius of the loop that is bent [m]."""


def run(out: Path, *, seed: int) -> dict[float, float]:
    """Draw the curves and the interpolating ones; leave `weights.png`, `study.md` and `study.json`
    in `out`.

    Args:
        out: Where the results go.
        seed: Of the loop's shape.

    Returns:
        Largest distance [m] of the curve with each weight from the one with weight 1, at equal
        parameter.
    """
    points = _loop(seed)
    u = np.linspace(0.0, 1.0, SAMPLES)
    curves = {weight: Nurbs.interpolate(points, weights=_weights(weight)) for weight in WEIGHTS}
    pulled = {weight: curves[1.0].with_weights(_weights(weight)) for weight in WEIGHTS}
    moved = {
        weight: float(np.linalg.norm(curve.evaluate(u) - pulled[1.0].evaluate(u), axis=1).max())
        for weight, curve in pulled.items()
    }
    missed = {weight: _largest_miss(curve, points) for weight, curve in curves.items()}
    with writing.staged(out) as folder:
        _draw(folder / "weights.png", points, pulled, curves, u)
        rows = [f"| {w:g} | {moved[w] * 1e3:.2f} | {missed[w] * 1e3:.1e} |" for w in WEIGHTS]
        head = [
            "| weight | vertices kept: curve moves by [mm] | points kept: curve misses them by "
            "[mm] |",
            "|---|---|---|",
        ]
        (folder / "study.md").write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
        values = [
            {"weight": w, "moved_mm": moved[w] * 1e3, "missed_mm": missed[w] * 1e3} for w in WEIGHTS
        ]
        writing.write_json(folder / "study.json", {"seed": seed, "weights": values, **provenance()})
    return moved


def _loop(seed: int) -> Float[np.ndarray, "n 2"]:
    """Uneven points around a loop [m]."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(POINTS) / POINTS
    radius = RADIUS * (1 + 0.15 * rng.standard_normal(POINTS))
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _weights(weight: float) -> Float[np.ndarray, "n"]:
    weights = np.ones(POINTS)
    weights[VERTEX] = weight
    return weights


def _largest_miss(curve: Nurbs, points: Float[np.ndarray, "n 2"]) -> float:
    """Largest distance [m] of a point from the curve at its own parameter."""
    return float(np.linalg.norm(curve.evaluate(curve.breaks[:POINTS]) - points, axis=1).max())


def _draw(
    path: Path,
    points: Float[np.ndarray, "n 2"],
    pulled: dict[float, Nurbs],
    curves: dict[float, Nurbs],
    u: np.ndarray,
) -> None:
    figure, ((pulling, through),) = theme.panels(1, 2, height_in=4.9, sharex=True, sharey=True)
    vertices = pulled[1.0].control_points[:POINTS] * 1e3  # a closed curve repeats its first three
    titles = ("The same control vertices", "Through the same points")
    for axis, title, family in zip((pulling, through), titles, (pulled, curves), strict=True):
        for look, (weight, curve) in zip(theme.FAMILY, family.items(), strict=False):
            x, y = curve.evaluate(u).T * 1e3
            axis.plot(x, y, **look.line, label=f"weight {weight:g}", linewidth=1.6)
        axis.set(xlabel="x [mm]", aspect="equal")
        theme.title(axis, title)
    pulling.plot(
        *np.vstack([vertices, vertices[:1]]).T,
        "o:",
        color=theme.MUTED,
        markersize=4,
        linewidth=1,
        label="vertices",
    )
    pulling.plot(*vertices[VERTEX], "ks", markersize=7, label="weighted vertex")
    through.plot(*(points * 1e3).T, "ko", markersize=4, label="points")
    pulling.set_ylabel("y [mm]")
    theme.legend_below(figure, [*pulling.get_lines(), through.get_lines()[-1]], 6)
    theme.write_png(figure, path)
