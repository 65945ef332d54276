"""A rig of any tool's, told and written for others."""

from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.markup import escape
from rich.table import Table

from breastscan.commands.console import Out, console
from breastscan.run.writing import staged
from breastscan.vision.camera import Intrinsics, StereoRig
from breastscan.vision.rigs import reading
from breastscan.vision.rigs.found import METRES
from breastscan.vision.rigs.writing import write_camera_info, write_opencv


def rig(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    unit: Literal["m", "cm", "mm", "in"] | None = None,
    out: Out | None = None,
) -> None:
    """Say what a stereo rig is: baseline, focal lengths, fields of view, vergence, its place.

    Args:
        files: Of breastscan, OpenCV (YAML, XML, JSON, .npz), ROS (both camera_info), Kalibr, MATLAB
            (toStruct(stereoParams) in a .mat or JSON) or Middlebury; two where intrinsics and
            extrinsics are apart.
        unit: Of its lengths, where the file does not say and they are no metres.
        out: Folder for rig.yaml, opencv.yaml and both camera_info files.

    Raises:
        CalibrationError: A file is missing or is not a rig.
        ConfigError: `out` cannot be written.
    """
    found = reading.read(files)
    metres = None if unit is None else METRES[unit]
    loaded = StereoRig.of(found, files[0], metres)
    console.print(_table(loaded, found.tool, metres or found.unit))
    if out is not None:
        with staged(out) as folder:
            loaded.save(folder / "rig.yaml")
            write_opencv(folder / "opencv.yaml", loaded)
            write_camera_info(folder, loaded)
        console.print(f"rig.yaml, opencv.yaml and both camera_info files in {out}", soft_wrap=True)


def _table(found: StereoRig, tool: str, metres: float | None) -> Table:
    """What there is to tell."""
    shown = Table(title=f"A rig as {tool} writes it", title_justify="left", header_style="bold")
    for heading in ("", "Left", "Right"):
        shown.add_column(heading, justify="left" if not heading else "right")
    both = (found.left, found.right)
    rows = {
        "Picture [px]": [f"{c.width} x {c.height}" for c in both],
        "Focal lengths [px]": [f"{c.K[0, 0]:.2f} {c.K[1, 1]:.2f}" for c in both],
        "Centre [px]": [f"{c.K[0, 2]:.2f} {c.K[1, 2]:.2f}" for c in both],
        "Field of view [°]": ["{:.1f} x {:.1f}".format(*_fields(c)) for c in both],
        "Lens, coefficients": [str(np.count_nonzero(c.distortion)) for c in both],
    }
    for name, values in rows.items():
        shown.add_row(escape(name), *values)
    axes = found.X_RL[2, :3]
    shown.add_row(escape("Baseline [mm]"), f"{found.baseline * 1e3:.2f}", "")
    shown.add_row(escape("Vergence [°]"), f"{np.degrees(np.arctan2(-axes[0], axes[2])):.2f}", "")
    told = "metres, not said" if metres is None else f"{metres:g} m"
    shown.add_row("Unit of the file", told, "")
    place = "not known: breastscan handeye" if found.X_BL is None else _place(found.X_BL)
    shown.add_row(escape("Left camera in B [m]"), place, "")
    return shown


def _fields(camera: Intrinsics) -> tuple[float, float]:
    """Of view, across and down, without the lens's distortion [deg]."""
    cx, cy = camera.K[:2, 2]
    across = np.arctan2(cx, camera.K[0, 0]) + np.arctan2(camera.width - cx, camera.K[0, 0])
    down = np.arctan2(cy, camera.K[1, 1]) + np.arctan2(camera.height - cy, camera.K[1, 1])
    return float(np.degrees(across)), float(np.degrees(down))


def _place(X_BL: np.ndarray) -> str:
    return "{:.4f} {:.4f} {:.4f}".format(*X_BL[:3, 3])
