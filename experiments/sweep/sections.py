"""The sections of the page, each from a whole study to markup."""

from collections.abc import Sequence
from html import escape

import polars as pl

from breastscan.report import html
from breastscan.report.catalogue import number
from experiments.sweep import figures
from experiments.sweep.quantities import SUCCESS, Quantity
from experiments.sweep.statistics import CLEAR, Effect, Summary, percent, signed
from experiments.sweep.study import Study

ELEMENT_ID = "parallel"
"""Where on the page the parallel axes are drawn."""
PANELS = 12
"""Effects that are drawn at most; all are in the table."""
MIN_PANELS = 6
"""That are drawn even where they may be chance."""
SCATTERS = 4
"""Settings whose runs are shown at once; those of the others stay folded."""
ROWS = 15
"""Effects that the table shows at once."""


def headline(study: Study) -> str:
    """Title, where the data come from, and the few numbers that matter most."""
    frame, meta = study.frame, study.meta
    known = [("version", meta.version), ("commit", meta.commit), ("varied", ", ".join(meta.varied))]
    origin = html.pairs([(name, text) for name, text in known if text])
    cards = "\n".join(
        [
            *_outcome(frame),
            *(_card(quantity, study.summaries[quantity.key]) for quantity in study.main),
        ]
    )
    text = (
        "Many scans of the twin, one row of the data set each. Intervals hold with a confidence "
        "of 95 %; under a median stands what 95 % of the runs keep that measured it."
    )
    if frame["design"].n_unique() < len(frame):
        text += (
            " Design points ran several times: means are resampled by design point, effects are of "
            "the design points' means, and intervals of shares take all runs for independent."
        )
    return (
        f"<header>\n<h1>{escape(meta.title)}</h1>\n{html.paragraph(text)}\n{origin}\n"
        f'<div class="cards">\n{cards}\n</div>\n</header>'
    )


def _outcome(frame: pl.DataFrame) -> list[str]:
    """Cards of how the runs ended."""
    n, designs = len(frame), frame["design"].n_unique()
    succeeded = int(frame["success"].sum())
    refused = len(frame.filter((pl.col("success") == 0) & pl.col("refused")))
    failed = n - succeeded - refused
    touched = ""
    if "touched" in frame.columns:
        count = len(frame.filter((pl.col("success") == 0) & pl.col("touched")))
        touched = f", {count} having touched"
    return [
        html.card(number(n), "runs", f"at {number(designs)} design points", "", ""),
        html.card(
            f"{100 * succeeded / n:.1f}",
            "%",
            f"success: {succeeded} of {n}",
            percent(succeeded, n),
            "",
        ),
        html.card(str(refused), "runs", "refused before contact", percent(refused, n), ""),
        html.card(str(failed), "runs", f"failed otherwise{touched}", percent(failed, n), ""),
    ]


def _card(quantity: Quantity, found: Summary) -> str:
    sign, end = ("≤", found.p95) if quantity.worse == "high" else ("≥", found.p5)
    return html.card(
        number(found.median),
        quantity.unit,
        f"{quantity.label}, median",
        f"95 %: {sign} {number(end)} {quantity.unit}",
        "",
    )


def metrics(study: Study) -> str:
    """Every number that was measured, and how many runs keep what every scan is held to."""
    header = (
        "quantity", "n", "mean", "95 % interval", "deviation", "P5", "median", "P95", "bar",
        "runs that keep it",
    )  # fmt: skip
    rows = [
        _metric_row(study.frame, quantity, study.summaries[quantity.key])
        for quantity in study.quantities
    ]
    text = (
        "Over the runs that measured a quantity, failed ones included: n. The interval is that of "
        "the mean, by bootstrap; P5 and P95 are percentiles. A bar is what every single scan of "
        "the standard twin is held to; runs are counted that keep it, of those that measured it."
    )
    return html.section(
        "Metrics", html.paragraph(text), html.table(header, rows, numeric=range(1, 10))
    )


def _metric_row(frame: pl.DataFrame, quantity: Quantity, found: Summary) -> list[str]:
    bar = keep = ""
    if quantity.bar is not None:
        sign = "≤" if quantity.bar.sense == "at most" else "≥"
        limit = quantity.bar.limit * quantity.scale
        values = frame[quantity.key].drop_nulls()
        kept = int((values <= limit if sign == "≤" else values >= limit).sum())
        bar = f"{sign} {number(limit)}"
        keep = f"{100 * kept / found.n:.1f} % ({percent(kept, found.n)})"
    numbers = (found.deviation, found.p5, found.median, found.p95)
    return [
        quantity.title,
        str(found.n),
        number(found.mean),
        found.interval.text,
        *map(number, numbers),
        bar,
        keep,
    ]


def main_effects(study: Study) -> str:
    """What each setting does to each main metric and to success."""
    if not study.effects:
        return html.section(
            "Main effects",
            html.paragraph(
                "None can be told: nothing was varied, or too few runs differ in what they "
                "measured."
            ),
        )
    quantities = [*study.main, SUCCESS]
    acting = list(dict.fromkeys(effect.setting for effect in study.effects))
    moved = [q for q in quantities if any(e.quantity == q.key for e in study.effects)]
    clear = sum(effect.is_clear for effect in study.effects)
    strongest = study.effects[: min(PANELS, max(MIN_PANELS, clear))]
    return html.section(
        "Main effects",
        html.drawing(
            figures.strengths(study.effects, acting, moved),
            "Table of settings by quantities, shaded by the share of the variance explained",
            "Share of each quantity's variance between design points that a setting explains by "
            "itself, less what chance alone would, pale where all of it may be chance; + and − are "
            "the sign of the rank correlation. What remains is the other settings, their "
            "interplay, and noise.",
        ),
        html.drawing(
            figures.main_effects(study.frame, strongest, quantities),
            "Means of quantities in groups of a setting's values",
            f"The {len(strongest)} strongest effects: mean in each group of a setting's values, "
            "with its interval; many numbers are parted into groups of equal size, drawn at their "
            "mean. Above each: the share of the variance it explains, and Spearman's rank "
            "correlation ρ.",
        ),
        _effect_table(study.effects, quantities),
    )


def _effect_table(found: Sequence[Effect], quantities: Sequence[Quantity]) -> str:
    by_key = {quantity.key: quantity for quantity in quantities}
    header = (
        "setting", "quantity", "explains", "lowest mean", "highest mean", "rank correlation",
        "95 % interval", "false finds",
    )  # fmt: skip
    rows = [_effect_row(effect, by_key[effect.quantity]) for effect in found]
    clear = sum(effect.is_clear for effect in found)
    text = (
        f"{clear} of {len(found)} effects are clear: among them and all that are clearer, at most "
        f"{100 * CLEAR:.0f} % are expected to be chance (Kruskal and Wallis's test or that of "
        "the rank correlation, Benjamini and Hochberg's share of false finds)."
    )
    shown = html.table(header, rows[:ROWS], numeric=range(2, 8))
    rest = html.table(header, rows[ROWS:], numeric=range(2, 8))
    folded = html.details(f"The other {len(rows) - ROWS} effects", rest)
    return html.paragraph(text) + shown + (folded if len(rows) > ROWS else "")


def _effect_row(effect: Effect, quantity: Quantity) -> list[str]:
    rank = effect.correlation
    return [
        effect.setting,
        quantity.title,
        f"{100 * effect.strength:.1f} %",
        number(effect.lowest),
        number(effect.highest),
        "–" if rank is None else signed(rank.value),
        "–" if rank is None else f"{signed(rank.interval.low)} … {signed(rank.interval.high)}",
        "< 0.001" if effect.chance < 0.001 else f"{effect.chance:.3f}",
    ]


def scatter(study: Study) -> str:
    """The runs over each varied number, the strongest settings first."""
    if not study.numbers or not study.main:
        return ""
    drawings = [
        html.drawing(
            figures.scatter(study.frame, setting, study.main, study.effects),
            f"The main quantities of each run over {setting}",
            f"Runs over {setting}. Marks at the lower edge are runs that did not measure it.",
        )
        for setting in study.numbers
    ]
    rest = drawings[SCATTERS:]
    return html.section(
        "Runs over the settings",
        html.paragraph(_drawn(study.frame)),
        *drawings[:SCATTERS],
        html.details(f"The other {len(rest)} settings", "\n".join(rest)) if rest else "",
    )


def _drawn(frame: pl.DataFrame) -> str:
    if len(frame) <= figures.MAX_POINTS:
        return f"All {number(len(frame))} runs are drawn."
    return (
        f"Of the {number(len(frame))} runs {number(figures.MAX_POINTS)} are drawn, chosen by "
        "chance; all numbers are of all runs."
    )


def parallel_axes(study: Study) -> tuple[list[str], list[Quantity]]:
    """What the parallel axes show: about as many settings as quantities, the strongest first."""
    quantities = study.main[: max(figures.MAX_AXES // 2, figures.MAX_AXES - len(study.settings))]
    return study.settings[: figures.MAX_AXES - len(quantities)], quantities


def parallel(study: Study) -> str:
    """Where the parallel axes are drawn."""
    settings, quantities = parallel_axes(study)
    view = (
        f'<div id="{ELEMENT_ID}" role="img" aria-label="Every run as a line across parallel axes">'
        "<noscript>The parallel axes need JavaScript.</noscript></div>"
    )
    left_out = [name for name in study.settings if name not in settings]
    left_out += [quantity.label for quantity in study.main if quantity not in quantities]
    return html.section(
        "Parallel axes",
        html.captioned(
            view,
            "A line a run, blue where it succeeded, orange where it failed; it goes through “none” "
            "where nothing was measured. Drag along an axis to see only the runs that go through "
            "there, drag a name to move its axis. "
            + _drawn(study.frame)
            + (f" Left out: {', '.join(left_out)}." if left_out else ""),
        ),
    )


def specification(study: Study) -> str:
    """What was asked for, folded."""
    return html.section(
        "Specification",
        html.details("What was asked for", html.preformatted(study.meta.spec)),
    )
