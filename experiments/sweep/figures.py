"""The figures of a sweep: how strongly each setting acts, on what and how; and every run by its
settings.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import polars as pl
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from breastscan.report import interactive, theme
from experiments.sweep.quantities import NOTHING, Quantity
from experiments.sweep.statistics import Effect, Level, levels

MAX_POINTS = 2000
"""Runs that are drawn singly."""
SEED = 0
"""Of which they are."""
COLUMNS = 3
"""Panels beside each other."""
PANEL_HEIGHT_IN = 2.3
CELL_IN = 0.42
"""Height of a row of the table of strengths."""
DARKEST = 0.75
"""Opacity of the cell of a setting that explains everything."""
SUCCEEDED = replace(theme.FAMILY[0], color=theme.MEASURED_ON_BOTH)
FAILED = theme.FAMILY[3]
"""How runs are told apart, on the light and on the dark page."""
AT_THE_EDGE = 0.03
"""Height at which a run is marked that has no value, over that of the panel."""
MARGIN = 0.12
"""Room below and above what has one, over its extent."""
LETTERS = 30
"""Of the groups' names under a panel that stand beside each other, else aslant."""
MAX_AXES = 12
"""Parallel axes that leave room for their names."""
GAP = 0.12
"""How far below its axis a run is led that has no value there, over the axis's length."""


def strengths(
    effects: Sequence[Effect], settings: Sequence[str], quantities: Sequence[Quantity]
) -> Figure:
    """Share of each quantity's variance that each setting explains, as shades with numbers,
    pale where it may be chance; the sign of the rank correlation before them.
    """
    found = {(effect.setting, effect.quantity): effect for effect in effects}
    figure, ((axis,),) = theme.panels(1, 1, height_in=1.4 + CELL_IN * len(settings))
    for row, setting in enumerate(settings):
        for column, quantity in enumerate(quantities):
            effect = found.get((setting, quantity.key))
            if effect is not None:
                _cell(axis, column, row, effect)
    axis.set_xticks(range(len(quantities)), [_broken(q.label) for q in quantities], fontsize=8)
    axis.set_yticks(range(len(settings)), settings)
    axis.set(xlim=(-0.5, len(quantities) - 0.5), ylim=(len(settings) - 0.5, -0.5))
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    axis.grid(visible=False)
    for spine in axis.spines.values():
        spine.set_visible(False)
    return figure


def _cell(axis: Axes, column: int, row: int, effect: Effect) -> None:
    shade = Rectangle(
        (column - 0.48, row - 0.45),
        0.96,
        0.9,
        facecolor=theme.MEASURED,
        alpha=DARKEST * effect.strength,
        linewidth=0,
    )
    axis.add_patch(shade)
    sign = ""
    if effect.correlation is not None and effect.strength >= 0.005:
        sign = "+ " if effect.correlation.value > 0 else "− "
    axis.text(
        column,
        row,
        f"{sign}{100 * effect.strength:.0f} %",
        ha="center",
        va="center",
        color=theme.INK if effect.is_clear else theme.MUTED,
        fontsize=8.5,
    )


def main_effects(
    frame: pl.DataFrame, effects: Sequence[Effect], quantities: Sequence[Quantity]
) -> Figure:
    """A panel an effect: mean of the quantity in each group of the setting, with its interval."""
    by_key = {quantity.key: quantity for quantity in quantities}
    figure, axes = _grid(len(effects))
    for axis, effect in zip(axes, effects, strict=True):
        found = levels(frame, effect.setting, effect.quantity)
        _draw_levels(axis, found)
        axis.set(xlabel=effect.setting)
        axis.set_ylabel(by_key[effect.quantity].title, fontsize=8.5)
        theme.title(axis, _told(effect))
    return figure


def _draw_levels(axis: Axes, found: Sequence[Level]) -> None:
    places = [
        float(place) if level.centre is None else level.centre for place, level in enumerate(found)
    ]
    means = np.array([level.mean for level in found])
    ends = np.array([(level.interval.low, level.interval.high) for level in found])
    reach = np.abs(np.nan_to_num(ends - means[:, None])).T
    look = {"color": theme.MEASURED, "marker": "o", "markersize": 4.5, "capsize": 3}
    numbers = all(level.centre is not None for level in found)
    axis.errorbar(places, means, reach, linestyle="-" if numbers else "none", linewidth=1, **look)
    if numbers:
        _whole(axis, places)
    else:
        longest = max(len(level.label) for level in found)
        aslant = {"rotation": 30, "ha": "right"} if longest * len(found) > LETTERS else {}
        axis.set_xticks(places, [level.label for level in found], **aslant)
        axis.margins(x=0.2)


def _told(effect: Effect) -> str:
    told = [f"{100 * effect.strength:.0f} %" if effect.is_clear else "perhaps chance"]
    if effect.correlation is not None:
        told.append(effect.correlation.text)
    return ", ".join(told)


def _whole(axis: Axes, numbers: Sequence[float]) -> None:
    """Ticks at whole numbers, where there are no others."""
    if all(float(number).is_integer() for number in numbers):
        axis.xaxis.set_major_locator(MaxNLocator(5, integer=True))


def scatter(
    frame: pl.DataFrame, setting: str, quantities: Sequence[Quantity], effects: Sequence[Effect]
) -> Figure:
    """Each quantity of each run over a varied number; runs that failed differ in colour and shape,
    and stand at the lower edge where they have no value.
    """
    drawn = sample(frame).drop_nulls(setting)
    found = {e.quantity: e.correlation for e in effects if e.setting == setting and e.correlation}
    figure, axes = _grid(len(quantities))
    for axis, quantity in zip(axes, quantities, strict=True):
        for success, look, size in ((1.0, SUCCEEDED, 3.0), (0.0, FAILED, 4.5)):
            rows = drawn.filter(pl.col("success") == success)
            _dots(axis, rows, setting, quantity, {**look.dots, "markersize": size})
        axis.set(xlabel=setting)
        axis.set_ylabel(quantity.title, fontsize=8.5)
        axis.margins(y=MARGIN)
        _whole(axis, drawn[setting].to_list())
        if quantity.key in found:
            theme.title(axis, found[quantity.key].text)
    names = {"succeeded": SUCCEEDED, "failed": FAILED}
    handles = [axes[0].plot([], [], **look.dots, label=name)[0] for name, look in names.items()]
    theme.legend_below(figure, handles, len(handles))
    return figure


def _dots(axis: Axes, rows: pl.DataFrame, setting: str, quantity: Quantity, look: dict) -> None:
    # one picture a panel: as marks of their own the runs would swell the page
    look = {**look, "alpha": 0.7, "markeredgewidth": 0, "rasterized": True}
    known = rows.drop_nulls(quantity.key)
    axis.plot(known[setting], known[quantity.key], **look)
    without = rows.filter(pl.col(quantity.key).is_null())[setting]
    edge = np.full(len(without), AT_THE_EDGE)
    axis.plot(without, edge, **look, transform=axis.get_xaxis_transform())


def sample(frame: pl.DataFrame) -> pl.DataFrame:
    """The runs that are drawn singly: all, or so many by chance, in their order."""
    if len(frame) <= MAX_POINTS:
        return frame
    chosen = np.random.default_rng(SEED).choice(len(frame), MAX_POINTS, replace=False)
    return frame[np.sort(chosen)]


def parallel(
    frame: pl.DataFrame, settings: Sequence[str], quantities: Sequence[Quantity]
) -> go.Figure:
    """A line a run across parallel axes: its settings, then what it measured."""
    drawn = sample(frame)
    names = _short(settings)
    axes = [_axis(drawn[setting], names[setting]) for setting in settings]
    axes += [_axis(drawn[quantity.key], quantity.title) for quantity in quantities]
    scale = [(0.0, FAILED.color), (1.0, SUCCEEDED.color)]
    line = {"color": drawn["success"].to_list(), "colorscale": scale, "cmin": 0, "cmax": 1}
    lines = go.Parcoords(
        line=line,
        dimensions=axes,
        labelangle=-25,
        labelfont={"size": 11},
        tickfont={"size": 10},
        rangefont={"size": 1, "color": "rgba(0,0,0,0)"},
    )
    view = go.Figure(lines)
    view.update_layout(**interactive.LAYOUT, margin={"l": 100, "r": 110, "t": 120, "b": 24})
    return view


def _axis(values: pl.Series, label: str) -> dict[str, object]:
    """One axis: numbers as they are, words at whole numbers; below it, where a value is missing."""
    if values.dtype.is_numeric():
        numbers = values.to_numpy().astype(float)
        ticks = _ticks(numbers)
        named = [f"{tick:g}" for tick in ticks]
    else:
        named = values.unique().sort().to_list()
        numbers = np.array([named.index(word) for word in values], float)
        ticks = np.arange(len(named), dtype=float)
    low, high = float(np.nanmin(numbers)), float(np.nanmax(numbers))
    length = high - low or 1.0
    missing = np.isnan(numbers)
    if missing.any():
        nowhere = low - GAP * length
        numbers = np.where(missing, nowhere, numbers)
        ticks, named = np.append(ticks, nowhere), [*named, NOTHING]
        low = nowhere
    return {
        "label": label,
        "values": [float(f"{value:.5g}") for value in numbers],
        "range": [low, high if high > low else low + length],
        "tickvals": ticks.tolist(),
        "ticktext": named,
    }


def _ticks(numbers: Float[np.ndarray, "n"]) -> Float[np.ndarray, "ticks"]:
    """Round numbers inside the range of what is known."""
    low, high = np.nanmin(numbers), np.nanmax(numbers)
    whole = bool(np.all(numbers[np.isfinite(numbers)] % 1 == 0))
    ticks = MaxNLocator(5, integer=whole).tick_values(low, high)
    return ticks[(ticks >= low) & (ticks <= high)]


def _short(names: Sequence[str]) -> dict[str, str]:
    """Dotted names by as few of their last parts as tell them apart."""
    shortened = {}
    for name in names:
        parts = name.split(".")
        tails = (".".join(parts[-count:]) for count in range(1, len(parts) + 1))
        shortened[name] = next(
            (
                tail
                for tail in tails
                if sum(f".{other}".endswith(f".{tail}") for other in names) == 1
            ),
            name,
        )
    return shortened


def _broken(label: str) -> str:
    """A name in lines of one or two words."""
    words = label.split()
    half = (len(words) + 1) // 2
    return "\n".join(" ".join(part) for part in (words[:half], words[half:]) if part)


def _grid(count: int) -> tuple[Figure, list[Axes]]:
    """Panels beside and below each other, those that are not needed taken away."""
    rows = -(-count // COLUMNS)
    figure, axes = theme.panels(rows, COLUMNS, height_in=PANEL_HEIGHT_IN * rows + 0.3)
    for axis in axes.flat[count:]:
        axis.remove()
    return figure, list(axes.flat[:count])
