"""Schematics and photographs: the system, the platform, the force feedback [Zhang, Figs. 1, 20,
23].
"""

from collections.abc import Iterator

import numpy as np

from breastscan.report import theme
from experiments.paper import drawing
from experiments.paper.item import Item, column
from experiments.paper.scans import Scanned
from sim.cameras.video import OVERVIEW, Viewpoint, render_still
from sim.scene import HOME_Q
from sim.tissue.mechanics import build_mechanics

SIZE_PX = (900, 600)
PLATFORM = Viewpoint(
    target_B=(0.32, 0.0, 0.28), distance=1.6, azimuth_deg=150.0, elevation_deg=-22.0
)
ON_THE_SKIN = Viewpoint(
    target_B=(0.48, 0.0, 0.17), distance=0.7, azimuth_deg=100.0, elevation_deg=-18.0
)
DRAWN = "An illustration: nothing is claimed."


def items(scan: Scanned) -> Iterator[Item]:
    """The twin where the paper shows its cell."""
    went = scan.result.trajectory
    on_loop = went.q[np.flatnonzero(went.in_loop)[np.count_nonzero(went.in_loop) // 3]]
    tissue = build_mechanics(scan.scene.phantom)
    parts = (
        "UR5e",
        "printed breast",
        "probe with six-axis force sensor",
        "two cameras",
        "computer",
    )
    for heading, views, titles in (
        ("Fig. 1", ((HOME_Q, OVERVIEW),), ("The cell, arm parked",)),
        (
            "Fig. 20",
            ((on_loop, PLATFORM), (on_loop, ON_THE_SKIN)),
            ("On the loop", "The probe on it"),
        ),
    ):
        figure, axes = theme.panels(1, len(views), height_in=6.4 if len(views) == 1 else 3.4)
        for axis, (q, view), title in zip(axes[0], views, titles, strict=True):
            drawing.picture(axis, render_still(scan.scene, tissue, q, view, SIZE_PX), title)
        yield Item(
            heading=heading,
            ours="the twin: UR5e, probe at 45° on a six-axis force sensor, printed breast on a "
            "chest plate, two cameras on a stand",
            verdict="agrees",
            why=f"the same parts, simulated. {DRAWN}",
            figure=figure,
            shows="The twin's cell as the film's camera sees it.",
            data={column("part", "what is there", kind="text"): np.array(parts)},
        )
    yield _force_feedback(scan)


BLOCKS = {
    "plan\n(joint path)": (0.6, 2.0),
    "S: across\nthe normal": (4.2, 2.0),
    "inverse\nkinematics": (6.2, 1.4),
    "servo and\narm (UR5e)": (8.1, 1.4),
    "probe and\nbreast": (10.0, 1.4),
    "set-point\nforce": (0.6, 0.8),
    "force law\n(fuzzy PD)": (2.4, 0.8),
    "S′: along\nthe normal": (4.2, 0.8),
    "six-axis sensor,\nless tool's weight": (6.2, 0.0),
}
LINKS = (
    ("plan\n(joint path)", "S: across\nthe normal", "X"),
    ("S: across\nthe normal", "inverse\nkinematics", ""),
    ("inverse\nkinematics", "servo and\narm (UR5e)", "θ"),
    ("servo and\narm (UR5e)", "probe and\nbreast", ""),
    ("set-point\nforce", "force law\n(fuzzy PD)", "ΔF"),
    ("force law\n(fuzzy PD)", "S′: along\nthe normal", "ΔX"),
    ("S′: along\nthe normal", "inverse\nkinematics", ""),
)
WIDTH, HEIGHT = 1.3, 0.5


def _force_feedback(scan: Scanned) -> Item:
    figure, ((axis,),) = theme.panels(1, 1, height_in=3.2)
    for text, (x, y) in BLOCKS.items():
        drawing.box(axis, x, y, text, WIDTH, HEIGHT)
    for start, end, word in LINKS:
        (x0, y0), (x1, y1) = BLOCKS[start], BLOCKS[end]
        drawing.arrow(axis, (x0 + WIDTH / 2 + 0.03, y0), (x1 - WIDTH / 2 - 0.03, y1), word)
    drawing.arrow(axis, (10.0, 1.1), (6.9, 0.0))
    drawing.arrow(axis, (5.5, 0.0), (2.4, 0.5), "F")
    axis.set(xlim=(-0.3, 10.9), ylim=(-0.4, 2.5))
    axis.set_axis_off()
    metrics = scan.result.metrics
    return Item(
        heading="Fig. 23",
        ours="the same structure (the scan's default law estimates the skin; the fuzzy PD is one "
        f"of its laws); on the print it holds {scan.force:g} N to {metrics['force_rmse_n']:.2f} N "
        f"(RMS), {metrics['force_min_n']:.1f} to {metrics['force_peak_n']:.1f} N",
        verdict="agrees",
        why=f"position across the normal, force along it. {DRAWN}",
        figure=figure,
        shows="Position control across the normal, force control along it, joined before the "
        "inverse kinematics.",
        data={
            column("quantity", "of the loop from 1 s on", kind="text"): np.array(
                ["RMS about the set-point", "lowest", "highest"]
            ),
            column("force_n", "true contact force", "N"): np.array(
                [metrics["force_rmse_n"], metrics["force_min_n"], metrics["force_peak_n"]]
            ),
        },
    )  # fmt: skip
