"""Pictures of both calibrations: found corners, residuals, places of the board, rectified lines,
poses of the arm.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from breastscan.geometry import se3
from breastscan.report import theme

DOTS_PER_INCH = 130
LINES = 12
"""Horizontal lines drawn across a pair."""
AXIS_LENGTH = 0.06
"""Of the drawn frames [m]."""
FRUSTUM = 0.05
"""Depth of the drawn cameras [m]."""

Grey = UInt8[np.ndarray, "h w"]


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure on white."""
    figure.savefig(path, dpi=DOTS_PER_INCH, facecolor="white")


def corners(
    pictures: Sequence[Grey],
    pixels: Sequence[Float[np.ndarray, "n 2"]],
    titles: Sequence[str],
    columns: int = 2,
) -> Figure:
    """The found corners in some pictures, joined in the order in which they are counted [Zhang,
    Figs. 2, 17].
    """
    rows = -(-len(pictures) // columns)
    figure, axes = theme.panels(rows, columns, height_in=4.0 * rows)
    for axis, picture, found, name in zip(axes.flat, pictures, pixels, titles, strict=True):
        _show(axis, picture, name)
        axis.plot(*found.T, color=theme.TRUTH, linewidth=0.7, marker="o", markersize=2.5)
        axis.plot(*found[0], "s", color=theme.ACCENT, markersize=5, fillstyle="none")
    return figure


def residual_bars(names: Sequence[str], residuals_px: Float[np.ndarray, "n 2"]) -> Figure:
    """RMS residual of every shot in both pictures, and the mean over all [Zhang, Fig. 3]."""
    figure, ((axis,),) = theme.panels(1, 1, height_in=3.2)
    place = np.arange(len(names))
    for offset, values, colour, side in zip(
        (-0.2, 0.2), residuals_px.T, (theme.MEASURED, theme.TRUTH), ("left", "right"), strict=True
    ):
        axis.bar(place + offset, values, width=0.4, color=colour, label=side)
    total_px = float(np.sqrt(np.mean(residuals_px**2)))
    axis.axhline(total_px, **theme.PLANNED_LINE, label=f"all: {total_px:.3f} px")
    axis.set_xticks(place, names, rotation=90, fontsize=7)
    axis.set(xlabel="shot", ylabel="RMS residual [px]")
    theme.title(axis, "Reprojection")
    theme.legend_above(axis)
    return figure


def board_places(
    X_LBoard: Float[np.ndarray, "n 4 4"],
    points_Board: Float[np.ndarray, "m 3"],
    X_RL: Float[np.ndarray, "4 4"],
) -> Figure:
    """Where the board was, before both cameras [Zhang, Fig. 4]; the left camera's frame, depth
    to the right.
    """
    with _dressed():
        figure = Figure(figsize=(theme.WIDTH_IN, 5.6), layout="constrained")
        axis: Any = figure.add_subplot(projection="3d", computed_zorder=False)
        outline = _outline(points_Board)
        for X in X_LBoard:
            axis.plot(
                *_depth_first(se3.transform(X, outline)).T, color=theme.MEASURED, linewidth=0.8
            )
        for X_LC, colour in ((np.eye(4), theme.ACCENT), (se3.inverse(X_RL), theme.TRUTH)):
            axis.plot(*_depth_first(se3.transform(X_LC, _frustum())).T, color=colour, linewidth=1.0)
        axis.set(
            xlabel="z in L [m]", ylabel="x in L [m]", zlabel="y in L, upwards [m]", aspect="equal"
        )
        axis.view_init(elev=22, azim=-115)
    return figure


def rectified(before: tuple[Grey, Grey], after: tuple[Grey, Grey]) -> Figure:
    """A pair as taken and as rectified, with lines that corresponding points share only after it
    [Zhang, Fig. 5].
    """
    figure, axes = theme.panels(2, 1, height_in=8.2)
    for (axis,), pair, name in zip(axes, (before, after), ("As taken", "Rectified"), strict=True):
        both = np.hstack(pair)
        _show(axis, both, name)
        for row in np.linspace(0, both.shape[0], LINES + 2)[1:-1]:
            axis.axhline(float(row), color=theme.TRUTH, linewidth=0.6)
    return figure


def hand_eye_frames(
    X_BF: Float[np.ndarray, "n 4 4"],
    X_FBoard: Float[np.ndarray, "4 4"],
    X_BC: Sequence[Float[np.ndarray, "4 4"]],
    points_Board: Float[np.ndarray, "m 3"],
) -> Figure:
    """The base, the flange and its board at every pose, and the cameras where they were found
    [Zhang, Fig. 16].
    """
    with _dressed():
        figure = Figure(figsize=(theme.WIDTH_IN, 5.6), layout="constrained")
        axis: Any = figure.add_subplot(projection="3d", computed_zorder=False)
        _draw_frame(axis, np.eye(4))
        outline = _outline(points_Board)
        for X in X_BF:
            axis.plot(*se3.transform(X @ X_FBoard, outline).T, color=theme.MEASURED, linewidth=0.7)
            _draw_frame(axis, X, length=AXIS_LENGTH / 3)
        for X in X_BC:
            axis.plot(*se3.transform(X, _frustum()).T, color=theme.INK, linewidth=1.0)
            _draw_frame(axis, X)
        axis.set(xlabel="x in B [m]", ylabel="y in B [m]", zlabel="z in B [m]", aspect="equal")
        axis.view_init(elev=18, azim=-60)
    return figure


def _show(axis: Axes, picture: Grey, name: str) -> None:
    axis.imshow(picture, cmap="gray", vmin=0, vmax=255)
    axis.set_axis_off()
    theme.title(axis, name)


def _dressed() -> Any:
    return matplotlib.rc_context({"font.size": 8, "axes.labelcolor": theme.INK})


def _outline(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "5 3"]:
    """The closed rectangle around the board's corners."""
    (x0, y0), (x1, y1) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return np.array([(x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0), (x0, y0, 0.0)])


def _frustum() -> Float[np.ndarray, "8 3"]:
    """A camera's field of view in its own frame, drawn in one stroke [m]."""
    a, b, c, d = FRUSTUM * np.array(
        [(-0.9, -0.75, 1), (0.9, -0.75, 1), (0.9, 0.75, 1), (-0.9, 0.75, 1)]
    )
    tip = np.zeros(3)
    return np.array([tip, a, b, tip, c, d, tip, a])


def _depth_first(points_L: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Camera axes for a plot whose third axis points upwards."""
    return points_L[:, [2, 0, 1]] * (1.0, 1.0, -1.0)


def _draw_frame(axis: Any, X: Float[np.ndarray, "4 4"], length: float = AXIS_LENGTH) -> None:
    for direction, colour in zip(
        X[:3, :3].T, (theme.TRUTH, theme.ACCENT, theme.MEASURED), strict=True
    ):
        axis.plot(
            *np.stack([X[:3, 3], X[:3, 3] + length * direction]).T, color=colour, linewidth=1.2
        )
