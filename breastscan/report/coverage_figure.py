"""Which skin an examination has touched."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from breastscan.report import theme
from breastscan.run.skin_map import COLOURS, SkinMap
from breastscan.run.trajectory import MM_PER_M

POINT_SIZE_PT2 = 12.0
"""Area of a point, which then touches its neighbours."""


def skin_map(skin: SkinMap) -> Figure:
    """The skin laid flat about the nipple's tip, coloured by how many strokes have touched it."""
    points_mm = skin.points_B * MM_PER_M
    out_mm = points_mm - points_mm[np.argmax(points_mm[:, 2])]
    distance = np.linalg.norm(out_mm, axis=1)
    share = distance / np.maximum(np.linalg.norm(out_mm[:, :2], axis=1), 1e-9)
    flat_mm = out_mm[:, :2] * share[:, None]
    figure, ((axis,),) = theme.panels(1, 1, height_in=6.4)
    parts = {name: part for name, part in skin.parts.items() if part.any()}
    for name, part in parts.items():
        axis.scatter(
            *flat_mm[part].T, s=POINT_SIZE_PT2, color=COLOURS[name], linewidths=0, rasterized=True
        )
    patches = [Patch(color=COLOURS[name], label=name) for name in parts]
    axis.set(aspect="equal", xlabel="out along x in B [mm]", ylabel="out along y in B [mm]")
    theme.title(axis, "Skin by strokes that touched it")
    theme.legend_below(figure, patches, len(patches))
    return figure
