"""Pictures of both calibrations: found corners, residuals, places of the board, rectified lines,
poses of the arm.
"""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from breastscan.geometry import se3
from breastscan.report import theme

LINES = 12
"""Horizontal lines drawn across a pair."""
ZOOM = 2.2
"""Side of the shown part of a picture, over the extent of its corners."""
AXIS_LENGTH = 0.06
"""Of the drawn frames [m]."""
AXIS_COLOURS = {"x": theme.TRUTH, "y": theme.ACCENT, "z": theme.MEASURED}
"""Of the drawn frames: near red, green and blue."""
TICKS = 5
"""At most, along an axis of a view in three dimensions."""
VIEW_ZOOM = 1.15
"""Of a view in three dimensions, which leaves wide margins by itself."""
FRUSTUM = 0.05
"""Depth of the drawn cameras [m]."""

Grey = UInt8[np.ndarray, "h w"]


def corners(
    pictures: Sequence[Grey],
    pixels: Sequence[Float[np.ndarray, "n 2"]],
    titles: Sequence[str],
    columns: int = 2,
) -> Figure:
    """The found corners in some pictures, joined in the order in which they are counted from the
    framed one on [Zhang, Figs. 2, 17]; the part of the picture around them.
    """
    rows = -(-len(pictures) // columns)
    figure, axes = theme.panels(rows, columns, height_in=4.0 * rows)
    for axis, picture, found, name in zip(axes.flat, pictures, pixels, titles, strict=True):
        _show(axis, picture, name)
        axis.plot(*found.T, color=theme.TRUTH, linewidth=1.0, marker="o", markersize=3.5)
        axis.plot(*found[0], "s", color=theme.INK, markersize=11, fillstyle="none", mew=3.5)
        axis.plot(*found[0], "s", color=theme.YELLOW, markersize=11, fillstyle="none", mew=1.8)
        _zoom(axis, picture, found)
    return figure


def residual_bars(names: Sequence[str], residuals_px: Float[np.ndarray, "n 2"]) -> Figure:
    """RMS residual of every shot in both pictures, and the mean over all [Zhang, Fig. 3]."""
    figure, ((axis,),) = theme.panels(1, 1, height_in=3.2)
    place = np.arange(len(names))
    for offset, values, look, side in zip(
        (-0.2, 0.2), residuals_px.T, theme.FAMILY[:2], ("left", "right"), strict=True
    ):
        axis.bar(place + offset, values, width=0.4, color=look.color, label=side)
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
    figure, axis = _view()
    outline = _outline(points_Board)
    _draw_boards(axis, [_depth_first(se3.transform(X, outline)) for X in X_LBoard])
    named = {"left": (np.eye(4), theme.FAMILY[2]), "right": (se3.inverse(X_RL), theme.FAMILY[3])}
    for name, (X_LC, look) in named.items():
        points = _depth_first(se3.transform(X_LC, _frustum()))
        axis.plot(*points.T, **look.line, linewidth=1.6, label=f"{name} camera")
    axis.set(xlabel="z in L [m]", ylabel="x in L [m]", zlabel="y in L, upwards [m]")
    axis.view_init(elev=22, azim=-115)
    _finish(figure, axis, axis.get_legend_handles_labels()[0])
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
            axis.axhline(float(row), color=theme.MEASURED, linewidth=0.9)
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
    figure, axis = _view()
    _draw_frame(axis, np.eye(4))
    axis.text(0.0, 0.0, -0.03, "base", color=theme.INK, ha="center", va="top")
    for end, name in zip(1.4 * AXIS_LENGTH * np.eye(3), AXIS_COLOURS, strict=True):
        axis.text(*end, name, color=theme.INK, ha="center", va="center")
    outline = _outline(points_Board)
    _draw_boards(axis, [se3.transform(X @ X_FBoard, outline) for X in X_BF])
    for X in X_BF:
        _draw_frame(axis, X, length=AXIS_LENGTH / 3)
    for X in X_BC:
        axis.plot(*se3.transform(X, _frustum()).T, color=theme.INK, linewidth=1.0, label="cameras")
        _draw_frame(axis, X)
    axis.set(xlabel="x in B [m]", ylabel="y in B [m]", zlabel="z in B [m]")
    axis.view_init(elev=18, azim=-60)
    boards, *_, cameras = axis.get_legend_handles_labels()[0]
    named = [
        Line2D([], [], color=colour, label=f"{name} axis of base, flanges, cameras")
        for name, colour in AXIS_COLOURS.items()
    ]
    _finish(figure, axis, [boards, cameras, *named])
    return figure


def _show(axis: Axes, picture: Grey, name: str) -> None:
    axis.imshow(picture, cmap="gray", vmin=0, vmax=255)
    axis.set_axis_off()
    theme.title(axis, name)


def _zoom(axis: Axes, picture: Grey, found: Float[np.ndarray, "n 2"]) -> None:
    """Show the square around the corners, shifted to lie inside the picture."""
    height, width = picture.shape
    side = min(ZOOM * float(np.ptp(found, axis=0).max()), height, width)
    limits = np.array([width, height]) - side
    left, top = np.clip(found.mean(axis=0) - side / 2, 0, limits)
    axis.set(xlim=(left, left + side), ylim=(top + side, top))


def _view() -> tuple[Figure, Any]:
    """An empty view in three dimensions."""
    with matplotlib.rc_context({"font.size": 9, "axes.labelcolor": theme.INK}):
        figure = Figure(figsize=(theme.WIDTH_IN, 5.6), layout="constrained")
        axis = figure.add_subplot(projection="3d", computed_zorder=False)
    return figure, axis


def _finish(figure: Figure, axis: Any, lines: Sequence[Any]) -> None:
    """Equal scales, few ticks, and the legend under the view."""
    axis.set_aspect("equal")
    axis.set_box_aspect(axis.get_box_aspect(), zoom=VIEW_ZOOM)
    for each in (axis.xaxis, axis.yaxis, axis.zaxis):
        each.set_major_locator(MaxNLocator(TICKS))
    theme.legend_below(figure, lines, 3)


def _draw_boards(axis: Any, outlines: Sequence[Float[np.ndarray, "5 3"]]) -> None:
    """Boards as panes that let each other shine through."""
    panes = Poly3DCollection(
        [*outlines],
        facecolor=to_rgba(theme.FAMILY[5].color, 0.18),
        edgecolor=theme.MEASURED,
        linewidth=0.7,
        label="board",
    )
    axis.add_collection3d(panes)


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
    for direction, colour in zip(X[:3, :3].T, AXIS_COLOURS.values(), strict=True):
        ends = np.stack([X[:3, 3], X[:3, 3] + length * direction])
        axis.plot(*ends.T, color=colour, linewidth=1.4)
