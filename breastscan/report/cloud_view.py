"""The reconstructed breast with the path on it, to turn about with the mouse."""

import numpy as np
import plotly.graph_objects as go
from jaxtyping import Float

from breastscan.report import interactive, theme
from breastscan.run.trajectory import MM_PER_M, Trajectory

ELEMENT_ID = "cloud"
"""Where on the page the view is drawn."""
NARROW_PX = 720
"""Width of a page below which the view is drawn from farther away, so that its sides are seen."""
FARTHER = "for (const c of 'xyz') view.layout.scene.camera.eye[c] *= 1.3"
NORMAL_LENGTH_MM = 12.0
"""How long a normal is drawn."""
LOOP_SAMPLES = 600
"""Samples of the loop that are drawn: half a millimetre apart, or so."""


def figure(
    cloud_B: Float[np.ndarray, "n 3"],
    path_B: Float[np.ndarray, "k 3"],
    normals_B: Float[np.ndarray, "k 3"],
    trajectory: Trajectory,
) -> go.Figure:
    """Points coloured by height, the path points with their normals, and the executed loop, all
    in B [mm].
    """
    loop_B = trajectory.X_BP[trajectory.in_loop, :3, 3]
    loop_B = loop_B[:: max(1, len(loop_B) // LOOP_SAMPLES)]
    view = go.Figure(
        [
            _points(cloud_B),
            _line(_segments(path_B, normals_B), "normals", theme.PATH_ON_SKIN, width=4),
            _markers(path_B),
            _line(loop_B * MM_PER_M, "executed loop", theme.MEASURED_ON_BOTH, width=6),
        ]
    )
    axis = {
        "color": theme.READABLE_ON_BOTH,
        "gridcolor": theme.READABLE_ON_BOTH,
        "showbackground": False,
        "zeroline": False,
    }
    view.update_layout(
        **interactive.LAYOUT,
        scene={f"{name}axis": {**axis, "title": {"text": f"{name} in B [mm]"}} for name in "xyz"},
        scene_aspectmode="data",
        scene_camera={
            "eye": {"x": -1.35, "y": -1.35, "z": 1.1},
            "center": {"x": 0, "y": 0, "z": -0.15},
        },
        legend={"orientation": "h", "y": 0, "yanchor": "top", "itemsizing": "constant"},
        margin={"l": 0, "r": 0, "t": 32, "b": 48},
    )
    return view


def script(view: go.Figure) -> str:
    """The scripts that draw `view` into `ELEMENT_ID`."""
    return interactive.script(view, ELEMENT_ID, f"if (innerWidth < {NARROW_PX}) {FARTHER};")


def _points(cloud_B: Float[np.ndarray, "n 3"]) -> go.Scatter3d:
    x, y, z = (cloud_B * MM_PER_M).astype(np.float32).T
    marker = {"size": 2.2, "color": z, "colorscale": theme.SKIN, "opacity": 0.9}
    return go.Scatter3d(
        x=x, y=y, z=z, mode="markers", marker=marker, name="reconstructed skin", hoverinfo="skip"
    )


def _markers(path_B: Float[np.ndarray, "k 3"]) -> go.Scatter3d:
    x, y, z = (path_B * MM_PER_M).T
    numbers = [str(number) for number in range(1, len(path_B) + 1)]
    marker = {
        "size": 5,
        "symbol": "diamond",
        "color": theme.PATH_ON_SKIN,
        "line": {"color": theme.INK, "width": 1},
    }
    return go.Scatter3d(
        x=x, y=y, z=z, mode="markers", marker=marker, name="path points", text=numbers
    )


def _segments(
    path_B: Float[np.ndarray, "k 3"], normals_B: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "m 3"]:
    """One short line for each normal [mm], with a NaN between any two so that they stay apart."""
    start = path_B * MM_PER_M
    gap = np.full_like(start, np.nan)
    return np.stack([start, start + NORMAL_LENGTH_MM * normals_B, gap], axis=1).reshape(-1, 3)


def _line(points_mm: Float[np.ndarray, "m 3"], name: str, colour: str, width: int) -> go.Scatter3d:
    x, y, z = points_mm.astype(np.float32).T
    return go.Scatter3d(
        x=x, y=y, z=z, mode="lines", line={"color": colour, "width": width}, name=name
    )
