"""How the phantom behaves, drawn: indentation, ripple, layers, breathing; and a sheet of the
whole family.
"""

from contextlib import closing
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure

from breastscan.geometry import kinematics, se3
from breastscan.report import theme
from breastscan.run import writing
from experiments.indentation import DEPTHS, FINEST, REST, Indentation, pose
from experiments.tissue_cost import LONGEST_RIPPLE, SLIDE_DEPTH, Slide
from sim.cameras.picture import Picture
from sim.cameras.video import Viewpoint
from sim.scene import HOME_Q, Scene, SceneConfig
from sim.tissue.breast import SHAPES, BreastClass
from sim.tissue.breathing import BreathingConfig, Waveform, rise
from sim.tissue.mechanics import build_mechanics
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import Mechanics, PhantomConfig, Texture

TILE_PX = (116, 88)
DRAWN_OVER_TILE = 4
SHEET_AZIMUTH = -2.2
"""Where on the breast the probe stands in the sheet [rad]."""
SHEET_DEPTH = {"soft": 0.006, "printed": 0.0004, "flex": 0.006}
"""How deep it presses [m]."""
FONT, INK = cv2.FONT_HERSHEY_DUPLEX, (40, 40, 40)
LABEL_PX = (110, 44)


def write(
    folder: Path,
    presses: dict[str, Indentation],
    others: dict[str, np.ndarray],
    slides: dict[tuple[float, int], Slide],
    inclusions: dict[str, tuple[np.ndarray, np.ndarray]],
) -> list[str]:
    """Write all figures as PNG; their names, without the ending.

    Args:
        folder: Where to.
        presses: By place.
        others: Forces of other mechanics at `DEPTHS` in the first place [N].
        slides: By height and roll.
        inclusions: Azimuths [deg] and forces [N] of a slide over each kind of tissue.
    """
    figures = {
        "twin_tissue": _indentation(presses, others),
        "twin_tissue_slides": _slides(slides, inclusions),
    }
    for name, figure in figures.items():
        theme.write_png(figure, folder / f"{name}.png")
    writing.write_image(folder / "twin_phantoms.png", cv2.cvtColor(_sheet(), cv2.COLOR_RGB2BGR))
    return [*figures, "twin_phantoms"]


def _indentation(presses: dict[str, Indentation], others: dict[str, np.ndarray]) -> Figure:
    figure, axes = theme.panels(1, 2, height_in=4.2)
    force, error = axes[0]
    depths_mm = 1e3 * DEPTHS
    for look, (name, press) in zip(theme.FAMILY, presses.items(), strict=False):
        force.plot(depths_mm, press.full, **look.dots, markersize=5, label=f"full, {name}")
        force.plot(depths_mm, press.soft, **look.line, linewidth=1.6, label=f"soft, {name}")
        error.plot(
            depths_mm,
            100 * press.error,
            **look.line,
            marker=look.marker,
            markersize=4,
            linewidth=1.6,
            label=name,
        )
    for (name, values), style in zip(others.items(), ("--", ":", "-."), strict=False):
        force.plot(depths_mm, values, style, color=theme.MUTED, linewidth=1.3, label=name)
    force.set(xlabel="indentation [mm]", ylabel="force along the probe [N]", ylim=(0, 10))
    theme.legend_under(force, 2)
    theme.title(
        force, f"Soft phantom, and full elements of {1e3 * FINEST:.0f} mm with large strain"
    )
    for start, end_mm, bar in ((0, 5, 5), (5, 8, 10)):
        for side in (-bar, bar):
            (limit,) = error.plot(
                [start, end_mm], [side, side], color=theme.MUTED, linewidth=1.0, linestyle=":"
            )
    limit.set_label("allowed")
    error.set(xlabel="indentation [mm]", ylabel="error of the force [%]", ylim=(-11, 11))
    theme.legend_under(error, 3)
    theme.title(error, "Soft phantom over full elements")
    return figure


def _slides(
    slides: dict[tuple[float, int], Slide], inclusions: dict[str, tuple[np.ndarray, np.ndarray]]
) -> Figure:
    figure, axes = theme.panels(1, 3, height_in=4.0)
    spectrum, inclusion, breath = axes[0]
    for look, roll, name in zip(
        theme.FAMILY, (0, 90), ("array along the path", "array across it"), strict=False
    ):
        slide = slides[0.5, roll]
        amplitude = np.abs(np.fft.rfft(slide.force)) * np.sqrt(2) / len(slide.force)
        wavelength_mm = 1e3 * slide.length / np.maximum(np.arange(len(amplitude)), 1)
        spectrum.loglog(
            wavelength_mm[1:], amplitude[1:], color=look.color, linewidth=1.0, label=name
        )
    spectrum.axvline(
        1e3 * LONGEST_RIPPLE,
        color=theme.INK,
        linewidth=1.2,
        linestyle=":",
        label="ripple: right of this",
    )
    spectrum.set(
        xlabel="wavelength [mm]", ylabel="force, RMS of a line [N]", xlim=(400, 0.6), ylim=(1e-6, 1)
    )
    theme.legend_under(spectrum, 1)
    theme.title(spectrum, f"Slid at {1e3 * SLIDE_DEPTH:.0f} mm")
    for look, (name, (azimuth_deg, force)) in zip(theme.FAMILY, inclusions.items(), strict=False):
        inclusion.plot(azimuth_deg, force, **look.line, linewidth=1.5, label=name)
    inclusion.set(xlabel="azimuth on the half-height loop [°]", ylabel="force [N]")
    theme.legend_under(inclusion, 2)
    theme.title(inclusion, "5 mm deep over fat 5 kPa and more")
    time = np.linspace(0, 8, 400)
    for look, waveform in zip(theme.FAMILY, get_args(Waveform), strict=False):
        config = BreathingConfig(amplitude=0.005, waveform=waveform)
        rises_mm = [1e3 * rise(config, t) for t in time]
        breath.plot(time, rises_mm, **look.line, linewidth=1.6, label=waveform)
    breath.set(xlabel="time [s]", ylabel="rise of the chest [mm]")
    theme.legend_under(breath, 2)
    theme.title(breath, "Breathing, amplitude 5 mm, .25 Hz")
    return figure


def _sheet() -> UInt8[np.ndarray, "h w 3"]:
    """Every class (rows) with every texture and mechanics (columns), pressed by the probe."""
    rows = [_headings()]
    for breast in SHAPES:
        label = np.full((TILE_PX[1], LABEL_PX[0], 3), 255, np.uint8)
        cv2.putText(label, breast, (4, TILE_PX[1] // 2), FONT, 0.42, INK, 1, cv2.LINE_AA)
        tiles = [tile for texture in get_args(Texture) for tile in _tiles(breast, texture)]
        rows.append(np.hstack([label, *tiles]))
    return np.vstack(rows)


def _headings() -> UInt8[np.ndarray, "h w 3"]:
    strip = [np.full((LABEL_PX[1], LABEL_PX[0], 3), 255, np.uint8)]
    for texture in get_args(Texture):
        for mechanics in get_args(Mechanics):
            label = np.full((LABEL_PX[1], TILE_PX[0], 3), 255, np.uint8)
            cv2.putText(label, texture, (4, 17), FONT, 0.45, INK, 1, cv2.LINE_AA)
            cv2.putText(label, mechanics, (4, 36), FONT, 0.42, INK, 1, cv2.LINE_AA)
            strip.append(label)
    return np.hstack(strip)


def _tiles(breast: BreastClass, texture: Texture) -> list[UInt8[np.ndarray, "h w 3"]]:
    """One picture for each mechanics."""
    scene = Scene(SceneConfig(phantom=PhantomConfig(breast=breast, texture=texture)))
    phantom, (x, y, z) = scene.phantom, scene.config.p_BS
    view = Viewpoint(
        target_B=(x, y, z + phantom.height / 2),
        distance=3.6 * phantom.radius,
        azimuth_deg=118.0,
        elevation_deg=-32.0,
    )
    size = (TILE_PX[0] * DRAWN_OVER_TILE, TILE_PX[1] * DRAWN_OVER_TILE)
    with closing(Picture(scene, *size)) as picture:
        tiles = []
        for mechanics in get_args(Mechanics):
            X_SP = pose(phantom, SHEET_AZIMUTH, SHEET_DEPTH[mechanics])
            solid = build_mechanics(
                Phantom(PhantomConfig(breast=breast, texture=texture, mechanics=mechanics))
            )
            solid.press(X_SP, REST)
            solutions = kinematics.inverse(scene.X_BS @ X_SP @ se3.inverse(scene.X_FP))
            changes = (solutions - HOME_Q + np.pi) % (2 * np.pi) - np.pi
            picture.arrange(solutions[np.abs(changes).max(axis=1).argmin()], solid.deformed_skin())
            tiles.append(
                cv2.resize(picture.draw(view.camera()), TILE_PX, interpolation=cv2.INTER_AREA)
            )
    return tiles
