"""How clouds, pictures and block diagrams are drawn."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import FancyBboxPatch
from matplotlib.ticker import MaxNLocator

from breastscan.report import theme

SKIN = LinearSegmentedColormap.from_list("skin", theme.SKIN)
VIEW_ZOOM = 1.25
"""Of a view in space, which leaves wide margins by itself."""
TICKS = 4
"""At most, along an axis in space."""


def scattered(
    axis: Axes, points_mm: Float[np.ndarray, "n 3"], values: np.ndarray | None = None, **look: Any
) -> PathCollection:
    """Points from above, x and y in B [mm], coloured by `values` or else by their height."""
    shown = {"s": 0.6, "cmap": SKIN, "linewidths": 0, "rasterized": True, **look}
    dots = axis.scatter(
        points_mm[:, 0], points_mm[:, 1], c=points_mm[:, 2] if values is None else values, **shown
    )
    axis.set(xlabel="x in B [mm]", aspect="equal")
    return dots


def in_space(
    axis: Any,
    points_mm: Float[np.ndarray, "n 3"],
    values: np.ndarray | None = None,
    *,
    zoom: float = VIEW_ZOOM,
    **look: Any,
) -> PathCollection:
    """Points in B [mm] from the side, coloured by `values` or else by their height."""
    shown = {"s": 0.6, "cmap": SKIN, "linewidths": 0, "rasterized": True, **look}
    colours = points_mm[:, 2] if values is None else values
    dots = axis.scatter(*points_mm.T, c=colours, depthshade=False, **shown)
    axis.set(xlabel="x in B [mm]", ylabel="y in B [mm]", zlabel="z in B [mm]")
    axis.view_init(elev=28, azim=-140)
    axis.set_aspect("equal")
    axis.set_box_aspect(axis.get_box_aspect(), zoom=zoom)
    for each in (axis.xaxis, axis.yaxis, axis.zaxis):
        each.set_major_locator(MaxNLocator(TICKS))
    return dots


def picture(axis: Axes, image: np.ndarray, title: str) -> None:
    """A picture, grey or RGB, without axes."""
    axis.imshow(image, cmap="gray" if image.ndim == 2 else None)
    axis.set_axis_off()
    theme.title(axis, title)


def box(axis: Axes, x: float, y: float, text: str, width: float, height: float) -> None:
    """A block of a diagram with its text, centred."""
    axis.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2), width, height, boxstyle="round,pad=0.02",
            facecolor=theme.SHADE, edgecolor=theme.MUTED, linewidth=0.9,
        )
    )  # fmt: skip
    axis.text(x, y, text, ha="center", va="center", color=theme.INK, fontsize=8.5)


def arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float], text: str = "") -> None:
    """An arrow between blocks, with a word above its middle."""
    axis.annotate(
        "", end, start, arrowprops={"arrowstyle": "->", "color": theme.PLANNED, "linewidth": 1.1}
    )
    if text:
        x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
        axis.text(x, y + 0.1, text, ha="center", va="bottom", color=theme.INK, fontsize=8)
