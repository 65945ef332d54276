"""The sections of the page, each from a whole run to markup. What a run does not hold is left
out.
"""

from itertools import groupby

import numpy as np
from jaxtyping import Float

from breastscan.report import (
    catalogue,
    cloud_view,
    contact_figures,
    coverage_figure,
    html,
    joint_figures,
    origin,
    path_figures,
    time_figures,
)
from breastscan.report.paper import compare_table4
from breastscan.run.bars import scan_bars
from breastscan.run.reading import VIDEO_FILE, Run
from breastscan.settings import flat

HEADLINES = {
    "surface_rmse_mm": "surface error, RMS",
    "path_surface_rmse_mm": "planned path error, RMS",
    "executed_truth_rms_mm": "whole chain's error, RMS",
    "normal_tilt_mean_deg": "mean probe tilt",
    "force_rmse_n": "force error, RMS",
    "scan_time_s": "scan time",
}
"""Metrics that stand in large figures at the top."""


def headline(run: Run) -> str:
    """Title, where the run comes from, and the few numbers that matter most."""
    rows = [row for row in _rows(run) if row.key in HEADLINES]
    cards = "\n".join(
        html.card(row.value, row.unit, HEADLINES[row.key], row.bar, row.verdict) for row in rows
    )
    return (
        "<header>\n<h1>Breast scan</h1>\n"
        + html.paragraph(
            "A stereo pair became a point cloud, a path on the skin, a motion of the arm and a "
            "force-controlled touch. Positions are in the robot's base frame B."
        )
        + f"\n{html.pairs(origin.of(run.config))}"
        + f'\n<div class="cards">\n{cards}\n</div>\n</header>'
    )


def summary(run: Run) -> str:
    """Every metric but the stages' times, which have a figure, group by group, each beside its
    bar; and the video.
    """
    shown = (row for row in _rows(run) if row.key != "wall_s")
    groups = groupby(shown, key=lambda row: row.group)
    tables = [
        html.group_table(name, [(r.label, r.value, r.unit, r.bar, r.verdict) for r in rows])
        for name, rows in groups
    ]
    video = html.captioned(
        f'<video src="{VIDEO_FILE}" controls muted loop preload="metadata"></video>',
        "The scan as the scene's own camera saw it; the film lies beside this page.",
    )
    return html.section(
        "Summary", video if run.has_video else "", f'<div class="groups">{"".join(tables)}</div>'
    )


def _rows(run: Run) -> list[catalogue.Row]:
    return catalogue.rows(run.metrics, scan_bars(run.config))


def perception(run: Run) -> str:
    """Camera pictures, disparity and the point cloud."""
    left = html.captioned(html.picture(run.left, "The left camera's picture"), "Left camera, raw.")
    right = html.captioned(
        html.picture(run.right, "The right camera's picture"), "Right camera, raw."
    )
    disparity = html.captioned(
        html.picture(run.disparity, "Disparity in false colours"),
        "Disparity of the rectified pair [px]: bright is near, black is unknown. Compare with "
        "Fig. 6 of the paper.",
    )
    cloud = (
        f'<div id="{cloud_view.ELEMENT_ID}" role="img" aria-label="Reconstructed points with the '
        'path and the executed loop, as a view in three dimensions"><noscript>The 3D view needs '
        "JavaScript.</noscript></div>"
    )
    return html.section(
        "Perception",
        f'<div class="pictures">{left}{right}{disparity}</div>',
        html.captioned(
            cloud,
            "Reconstructed skin, coloured by height, with the path points, their normals and the "
            "executed loop. Drag to turn, scroll to zoom. Compare with Figs. 7, 12 and 14 of the "
            "paper.",
        ),
    )


def path(run: Run) -> str:
    """Planned against executed path, and Table 4 of the paper; nothing where the loop was never
    reached.
    """
    if not run.trajectory.has_loop:
        return ""
    return html.section(
        "Path",
        html.drawing(
            path_figures.planned_and_executed(run.path_B, run.trajectory),
            "The loop from above and its height over the path length, planned and executed",
            "The way that was planned through the path points, moved as far as drag and breath "
            "move the skin, and the executed one. On soft tissue it lies deeper, by the "
            "indentation. From above, a single loop's deviation is enlarged by the factor in the "
            "legend. Compare with Figs. 18 and 22 of the paper.",
        ),
        html.drawing(
            path_figures.deviations(run.trajectory),
            "Five curves over the path length, each with a histogram: the tracking error across "
            "the normal, the indentation, and both together in x, y and z",
            "Executed minus planned tip, which moves with the skin, at equal path parameter. "
            "Across the normal it is the tracking error; along it, on soft tissue, the "
            "indentation, which is wanted and shows in x, y and z as well. The shaded bands are "
            "the mean absolute errors of the paper, which scanned a rigid print. Compare with Fig. "
            "21 of the paper.",
        ),
        _table4(run),
    )


def coverage(run: Run) -> str:
    """Which skin was touched; nothing for a single loop."""
    if run.skin_map is None:
        return ""
    return html.section(
        "Coverage",
        html.drawing(
            coverage_figure.skin_map(run.skin_map),
            "The breast's skin laid flat about the nipple, each point coloured by how many strokes "
            "have touched it",
            "The true skin, laid flat: distance from the nipple's tip, and azimuth. A point counts "
            "as touched where it bore load. The same points are a cloud in the file coverage.ply.",
        ),
    )


def joints(run: Run) -> str:
    """Joint angles, joint speeds and their limits."""
    return html.section(
        "Joints",
        html.drawing(
            joint_figures.joint_angles(run.trajectory),
            "Six joint angles over time, measured and planned",
            "Joint angles as measured, and as planned over the loop. Compare with Fig. 19b of the "
            "paper.",
        ),
        html.drawing(
            joint_figures.joint_speeds(run.trajectory),
            "Six joint speeds over time, measured and planned",
            "Joint speeds as measured, and as planned over the loop. Compare with Fig. 19c of the "
            "paper.",
        ),
        html.drawing(
            joint_figures.joint_limits(run.trajectory),
            "Bars of each joint's range of angles and highest speed, as shares of the limits",
            "What the whole scan takes of the UR5e's limits: ±360° (elbow ±180°) and 180 °/s.",
        ),
    )


def contact(run: Run) -> str:
    """Force and, in simulation, indentation and tilt."""
    set_point = run.config.get("scan", {}).get("contact", {}).get("force")
    depth = contact_figures.indentation(run.trajectory)
    return html.section(
        "Contact",
        html.drawing(
            contact_figures.contact_force(run.trajectory, set_point),
            "Contact force over time, with its set-point and the phases of the scan",
            "Force along the probe axis, positive when pressing: the range that the wrist sensor "
            "measured and, in simulation, the truth; below, the loop enlarged. The control is that "
            "of Fig. 23 of the paper.",
        ),
        html.drawing(
            depth,
            "Indentation of the tissue and tilt of the probe over time",
            "How far the tip has sunk into the tissue, and the angle between the probe axis and "
            "the true normal, both from the simulation's truth.",
        )
        if depth
        else "",
    )


def time(run: Run) -> str:
    """Wall time by stage, where it was measured."""
    seconds = run.metrics.get("wall_s")
    if not seconds:
        return ""
    bars = time_figures.wall_time(seconds)
    return html.section(
        "Time",
        html.drawing(bars, "Wall time of each stage", "Wall time of each stage of the scan."),
    )


def settings(run: Run) -> str:
    """Every setting and version, folded."""
    rows = [(name, str(value)) for name, value in flat(run.config)]
    return html.section(
        "Settings",
        html.details("Settings, versions and seed", html.table(("setting", "value"), rows)),
    )


def _table4(run: Run) -> str:
    """Ours beside the paper's, and the same error split at the planned normal."""
    trajectory = run.trajectory
    compared = compare_table4(trajectory.path_errors_mm())
    rows = [
        (
            line.statistic,
            *(
                _mm(value)
                for pair in zip(line.ours_mm, line.paper_mm, strict=True)
                for value in pair
            ),
        )
        for line in compared
    ]
    header = ("", *(f"{axis} {whose}" for axis in path_figures.AXES for whose in ("ours", "paper")))
    normal, tangential = (
        _rms(trajectory.normal_errors_mm()),
        _rms(trajectory.tangential_errors_mm()),
    )
    return (
        "<h3>Against Table 4 of the paper</h3>\n"
        + html.table(header, rows, numeric=range(1, 7))
        + html.paragraph(
            "Executed minus planned tip in B [mm]. The paper scanned a rigid print at fifteen "
            "points, and what it calls its standard deviation is the RMS about zero. On soft "
            "tissue ours contains the indentation, which is wanted: there, compare the part across "
            f"the planned normal, {_mm(tangential)} mm (RMS); the part along it is "
            f"{_mm(normal)} mm."
        )
    )


def _rms(values: Float[np.ndarray, "n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mm(value: float) -> str:
    return f"{value:.2f}"
