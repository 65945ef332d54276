"""The NURBS curve and its interpolation on the paper's own fifteen points [Zhang, Secs. IV, V-B.1,
Figs. 15, 18].
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from breastscan.geometry.nurbs import Nurbs
from breastscan.planning import feedrate
from breastscan.planning.feedrate import Feed, FeedrateLimits, Step
from breastscan.report import theme
from breastscan.report.paper import PUBLISHED, TABLE4_THEORETICAL_MM
from breastscan.robot.ur.ur5e import PERIOD
from experiments import joint_walks, paper_loop
from experiments.paper.item import Item, column, coordinates, judged

MOTION = PUBLISHED["motion"]
LIMITS = FeedrateLimits(speed=MOTION["speed_m_s"], acceleration=MOTION["acceleration_m_s2"])
STEPS: dict[Step, str] = {
    "taylor1": "Taylor, first order",
    "taylor2": "second (the paper's)",
    "newton": "Newton",
}
"""Ways to step along the curve, and what they are called."""
SAMPLES = 2000
"""Of the curve, where it is drawn or judged."""
SHOWN = 20
"""One interpolated point in so many is drawn and kept: every 40 ms."""


def items() -> Iterator[Item]:
    """What curve and interpolation answer."""
    yield _interpolation()
    yield _smoothing()


def turns_deg(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Angle by which a closed polygon turns at each of its points [deg]."""
    edges = np.roll(points, -1, axis=0) - points
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    cosine = np.sum(edges * np.roll(edges, 1, axis=0), axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def distance_to_polygon(
    p: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "n"]:
    """Distance of points from the nearest edge of a closed polygon."""
    edges = np.roll(corners, -1, axis=0) - corners
    away = p[:, None] - corners
    along = np.clip(np.sum(away * edges, axis=-1) / np.sum(edges**2, axis=-1), 0.0, 1.0)
    return np.linalg.norm(away - along[..., None] * edges, axis=-1).min(axis=1)


def clamped(points: Float[np.ndarray, "n 3"]) -> Nurbs:
    """The paper's own way: an open curve with tangents at its ends, which meet [Zhang, Eqs. 20,
    21].
    """
    return Nurbs.interpolate(np.vstack([points, points[:1]]), closed=False)


def seam_turn_deg(curve: Nurbs) -> float:
    """Angle between the tangents at the curve's end and at its start [deg]."""
    end, start = (curve.evaluate(u, 1) for u in (np.nextafter(1.0, 0.0), 0.0))
    cosine = end @ start / np.linalg.norm(end) / np.linalg.norm(start)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _interpolation() -> Item:
    loop = joint_walks.Loop(name="", path=paper_loop.vertical(), table_height=0.0, in_twin=False)
    rows = {str(row["method"]): row for row in joint_walks.fluctuations([loop])}
    fluctuation, chord_mm = (
        {name: float(str(row[key])) for name, row in rows.items()}
        for key in ("fluctuation_pct", "chord_error_mm")
    )
    feed = feedrate.interpolate(loop.path.curve, LIMITS, PERIOD)
    radius_mm = 1e3 / loop.path.curve.curvature(np.linspace(0.0, 1.0, SAMPLES)).max()
    return Item(
        heading="Fig. 15",
        ours="on Table 4's points at 25 mm/s and 2 ms the speed fluctuates by "
        f"{fluctuation['taylor1']:.2g} % with Taylor's first order, {fluctuation['taylor2']:.2g} "
        f"% with the paper's second, {_percent(fluctuation['newton'])} % with a Newton step on "
        f"the chord; chord error {1e3 * chord_mm['newton']:.2f} µm; {feed.t[-1]:.1f} s a loop",
        verdict=judged(fluctuation["newton"] < fluctuation["taylor2"], "better"),
        why="the paper's own second-order step is one of the three; one Newton step on the chord "
        f"takes the rest of the fluctuation out. The loop's smallest radius is {radius_mm:.1f} "
        "mm: below 31 mm the normal acceleration of 20 mm/s² limits the speed.",
        figure=_drawn_feed(feed),
        shows="The interpolated path from above, every 40 ms, and the speed along it with the "
        "paper's limits.",
        data={
            column("t_s", "time", "s"): feed.t[::SHOWN],
            column("s_mm", "length along the curve", "mm"): 1e3 * feed.s[::SHOWN],
            column("speed_mm_s", "planned speed", "mm/s"): 1e3 * feed.speeds[::SHOWN],
            **coordinates("{}_mm", "interpolated point", 1e3 * feed.positions[::SHOWN]),
        },
    )  # fmt: skip


def _percent(value: float) -> str:
    return "< 1e-6" if value < 1e-6 else f"{value:.2g}"


def _drawn_feed(feed: Feed) -> Figure:
    figure, ((top, speed),) = theme.panels(1, 2, height_in=4.2)
    shown_mm = 1e3 * feed.positions[::SHOWN]
    dots = top.scatter(
        shown_mm[:, 0], shown_mm[:, 1], c=1e3 * feed.speeds[::SHOWN], s=5, cmap="viridis"
    )
    figure.colorbar(dots, ax=top, shrink=0.8, label="speed [mm/s]")
    top.plot(
        *TABLE4_THEORETICAL_MM[:, :2].T, "o", color=theme.ACCENT, markersize=5, fillstyle="none"
    )
    top.set(xlabel="x in B [mm]", ylabel="y in B [mm]", aspect="equal")
    theme.title(top, "Table 4's points, interpolated")
    for look, (step, name) in zip(theme.FAMILY, STEPS.items(), strict=False):
        walked = feedrate.interpolate(
            paper_loop.vertical().curve, FeedrateLimits(speed=LIMITS.speed, step=step), PERIOD
        )
        chords = np.linalg.norm(np.diff(walked.positions, axis=0), axis=1) / PERIOD
        off = 100 * np.abs(chords / np.maximum(walked.speeds[:-1], 1e-6) - 1)
        shown = slice(SHOWN, -SHOWN, SHOWN)
        speed.semilogy(
            1e3 * walked.s[:-1][shown], off[shown], **look.line, linewidth=1.2, label=name
        )
    speed.set(xlabel="path length [mm]", ylabel="|speed fluctuation| [%]")
    theme.legend_above(speed)
    return figure


def _smoothing() -> Item:
    points = TABLE4_THEORETICAL_MM
    curve, u = Nurbs.interpolate(points), np.linspace(0.0, 1.0, SAMPLES)
    curve_mm = curve.evaluate(u)
    corner_deg, open_seam_deg = turns_deg(points), seam_turn_deg(clamped(points))
    missed_mm = np.linalg.norm(curve.evaluate(curve.breaks[:-1]) - points, axis=1).max()
    strayed_mm = distance_to_polygon(curve_mm, points).max()
    figure, ((top, turn),) = theme.panels(1, 2, height_in=4.2)
    top.plot(
        *np.vstack([points, points[:1]])[:, :2].T, **theme.PLANNED_LINE, label="joined by lines"
    )
    top.plot(*curve_mm[:, :2].T, **theme.MEASURED_LINE, label="NURBS")
    top.plot(*points[:, :2].T, "o", color=theme.ACCENT, markersize=4, label="points of Table 4")
    top.set(xlabel="x in B [mm]", ylabel="y in B [mm]", aspect="equal")
    theme.legend_within(top)
    turn.bar(np.arange(1, 16), corner_deg, color=theme.MUTED, width=0.6, label="lines")
    turn.plot(
        np.arange(1, 16), np.r_[seam_turn_deg(curve), np.zeros(14)], "o", color=theme.MEASURED,
        markersize=4, label="NURBS, cyclic",
    )  # fmt: skip
    turn.plot(
        [1], [open_seam_deg], "s", color=theme.TRUTH, markersize=5, label="NURBS, clamped ends"
    )
    turn.set(xlabel="point", ylabel="change of direction there [°]", xticks=range(1, 16, 2))
    theme.legend_under(turn, 3)
    theme.title(top, "From above")
    theme.title(turn, "Change of direction at the points")
    return Item(
        heading="Fig. 18",
        ours=f"through all fifteen points of Table 4 (to {missed_mm:.0e} mm), at most "
        f"{strayed_mm:.1f} mm off the lines between them; the lines turn by up to "
        f"{corner_deg.max():.0f}° at a point, the curve nowhere; clamped ends would leave "
        f"{open_seam_deg:.1f}° where it closes",
        verdict=judged(seam_turn_deg(curve) < open_seam_deg, "better"),
        why="smoother, as the paper says of its own; the cyclic system also makes tangent and "
        "curvature meet where the path closes.",
        figure=figure,
        shows="The fifteen points joined by lines and by the closed curve, and by how much each "
        "changes direction at the points.",
        data={
            column("u", "curve parameter"): u,
            **coordinates("{}_mm", "point of the curve", curve_mm),
            column("radius_mm", "radius of curvature", "mm"): 1.0 / curve.curvature(u),
        },
    )  # fmt: skip
