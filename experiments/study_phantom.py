"""Can the phantom be trusted, and what does it cost?

The soft phantom against full finite elements with large deformations, its mesh in the force, its
build and its press; the other mechanics beside it; layers, breathing, and a picture of every class,
texture and mechanics.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from breastscan.run import metrics, writing
from breastscan.run.provenance import provenance
from experiments import phantom_figures, tissue_cost
from experiments.indentation import (
    DEPTHS,
    FINEST,
    SET_POINT,
    Indentation,
    against_full,
    axial_force,
    pose,
)
from experiments.tissue_cost import (
    FINER,
    HEIGHTS,
    LONGEST_RIPPLE,
    ROLLS_DEG,
    SLIDE_DEPTH,
    Build,
    Slide,
)
from sim.tissue.breast import BreastClass
from sim.tissue.flex import FlexTissue
from sim.tissue.layers import FAT_YOUNG, SKIN_YOUNG, LayerConfig
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.soft import SoftTissue

PLACES: tuple[tuple[BreastClass, float], ...] = (("standard", 0.7), ("scattered", 2.8))
"""Classes, and azimuths on their half-height loops [rad], that are pressed in full finite
elements."""
MASS = LayerConfig(mass_radius=0.010, mass_p_S=(0.045, 0.0, 0.020))
"""A hard mass about 10 mm under the skin at azimuth 0."""
TISSUES = {
    "fat alone": LayerConfig(),
    "mass of 20 mm, 4 x": MASS,
    "gland, 3 x": LayerConfig(gland_fraction=0.7),
    "gland and skin": LayerConfig(gland_fraction=0.7, skin_ratio=SKIN_YOUNG / FAT_YOUNG),
}
LAYERED_DEPTH = 0.005
"""[m]"""
LAYERED_AZIMUTHS = np.radians(np.arange(-60, 61, 1.0))
"""[rad]"""
LAYERED_DEPTHS = np.arange(1, 5) * 1e-3
"""How deep the mass is pressed in full finite elements [m]."""
FLEX_STEP = 5e-5
"""How far the probe comes down on MuJoCo's solid in a period [m]."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """All that was measured."""

    presses: dict[str, Indentation]
    layered: Indentation
    """Over the hard mass."""
    flex: np.ndarray
    """Force of MuJoCo's solid at `DEPTHS` in the first place [N]."""
    convergence: dict[int, np.ndarray]
    slides: dict[tuple[float, int], Slide]
    """By height and roll."""
    builds: dict[str, Build]


def run(out: Path, *, seed: int) -> Study:
    """Measure everything, which takes a quarter of an hour; leave figures, `study.md` and
    `study.json` in `out`.

    Args:
        out: Where the results go.
        seed: Of the phantoms' shapes.
    """
    phantom = Phantom(PhantomConfig(seed=seed))
    soft = SoftTissue.build(phantom)
    with writing.staged(out) as folder:
        study = Study(
            presses={
                f"{breast}, {np.degrees(place):.0f}°": _pressed(
                    PhantomConfig(breast=breast, seed=seed), place, DEPTHS
                )
                for breast, place in PLACES
            },
            layered=_pressed(PhantomConfig(seed=seed, layers=MASS), 0.0, LAYERED_DEPTHS),
            flex=_flex_forces(phantom, PLACES[0][1]),
            convergence=tissue_cost.convergence(phantom, soft, DEPTHS[[1, 4, 7]]),
            slides={
                (height, roll): tissue_cost.slide(phantom, soft, height, np.radians(roll))
                for height in HEIGHTS
                for roll in ROLLS_DEG
            },
            builds=tissue_cost.builds(),
        )
        figures = phantom_figures.write(
            folder,
            study.presses,
            {"MuJoCo's solid (flex)": study.flex},
            study.slides,
            _layered_slides(seed),
        )
        writing.write_json(folder / "study.json", {"seed": seed, **_summary(study), **provenance()})
        (folder / "study.md").write_text("\n".join(_page(study, figures)) + "\n", encoding="utf-8")
    return study


def _pressed(config: PhantomConfig, place: float, depths: np.ndarray) -> Indentation:
    phantom = Phantom(config)
    return against_full(phantom, SoftTissue.build(phantom), place, depths)


def _flex_forces(phantom: Phantom, place: float) -> np.ndarray:
    """Come down in small steps, as a scan does, and note the force at `DEPTHS` [N]."""
    flex, depths = FlexTissue(phantom), np.arange(-1e-3, DEPTHS[-1] + FLEX_STEP, FLEX_STEP)
    forces = [axial_force(flex, pose(phantom, place, depth)) for depth in depths]
    return np.interp(DEPTHS, depths, forces)


def _layered_slides(seed: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Azimuths [deg] and forces [N] along the half-height loop over each of `TISSUES`."""
    found = {}
    for name, layers in TISSUES.items():
        phantom = Phantom(PhantomConfig(seed=seed, young=FAT_YOUNG, layers=layers))
        soft = SoftTissue.build(phantom)
        forces = [
            axial_force(soft, pose(phantom, azimuth, LAYERED_DEPTH)) for azimuth in LAYERED_AZIMUTHS
        ]
        found[name] = (np.degrees(LAYERED_AZIMUTHS), np.array(forces))
    return found


def _summary(study: Study) -> dict[str, object]:
    return {
        "indentation": {
            name: {
                **_forces(press, DEPTHS),
                "surface_rmse_mm": 1e3 * press.surface_rmse,
                "displacement_rmse_mm": 1e3 * press.displacement_rmse,
            }
            for name, press in study.presses.items()
        },
        "over_a_mass": _forces(study.layered, LAYERED_DEPTHS),
        "flex_n": study.flex.tolist(),
        "mesh_change_pct": {
            str(points): (100 * change).tolist() for points, change in study.convergence.items()
        },
        "ripple_n": {
            f"height {height}, roll {roll}°": s.ripple for (height, roll), s in study.slides.items()
        },
        "press_ms": 1e3 * float(np.mean([slide.press for slide in study.slides.values()])),
        "build": {
            name: {"cpu_s": b.cpu, "megabytes": b.megabytes} for name, b in study.builds.items()
        },
    }


def _forces(press: Indentation, depths: np.ndarray) -> dict[str, list[float]]:
    return {
        "depth_mm": (1e3 * depths).tolist(),
        "full_n": press.full.tolist(),
        "soft_n": press.soft.tolist(),
    }


def _page(study: Study, figures: list[str]) -> Iterator[str]:
    yield "# The phantom"
    for name in figures:
        yield f"\n![{name}]({name}.png)"
    yield (
        f"\n## The soft phantom against full finite elements (edges of {1e3 * FINEST:.0f} mm, "
        "large strain)\n"
    )
    yield (
        f"| place | largest error to 5 mm [%] | 5 to 8 mm [%] | skin at {SET_POINT:.0f} N [mm] "
        "| its points [mm] |"
    )
    yield "|---|---|---|---|---|"
    for name, press in study.presses.items():
        error = 100 * np.abs(press.error)
        yield (
            f"| {name} | {error[DEPTHS <= 5.1e-3].max():.1f} | {error[DEPTHS >= 4.9e-3].max():.1f} "
            f"| {1e3 * press.surface_rmse:.3f} | {1e3 * press.displacement_rmse:.3f} |"
        )
    yield f"| standard, over a hard mass | {100 * np.abs(study.layered.error).max():.1f} | | | |"
    flex_error = 100 * (study.flex / next(iter(study.presses.values())).full - 1)
    yield "\n## MuJoCo's solid in the first place\n"
    yield "| indentation [mm] | " + " | ".join(f"{1e3 * depth:g}" for depth in DEPTHS) + " |"
    yield "|---" * (len(DEPTHS) + 1) + "|"
    yield "| error of the force [%] | " + " | ".join(f"{error:+.0f}" for error in flex_error) + " |"
    yield (
        "\n## Change of the force at 2, 5 and 8 mm where the finite elements are finer, largest "
        "of eight places\n"
    )
    yield "| vertices on the skin | 2 mm [%] | 5 mm [%] | 8 mm [%] |"
    yield "|---|---|---|---|"
    for points in FINER:
        yield (
            f"| {points} | "
            + " | ".join(f"{100 * change:.1f}" for change in study.convergence[points])
            + " |"
        )
    yield (
        f"\n## Slid around at {1e3 * SLIDE_DEPTH:.0f} mm: force, and ripple below "
        f"{1e3 * LONGEST_RIPPLE:.0f} mm of wavelength\n"
    )
    yield (
        "| contour at | force, mean [N] | array along the path [N RMS] | across it | worst roll "
        "| all rolls |"
    )
    yield "|---|---|---|---|---|---|"
    for height in HEIGHTS:
        ripple = [study.slides[height, roll].ripple for roll in ROLLS_DEG]
        force = np.mean([study.slides[height, roll].force.mean() for roll in ROLLS_DEG])
        along, across = (study.slides[height, roll].ripple for roll in (0, 90))
        yield (
            f"| {height:g} of the height | {force:.2f} | {along:.4f} | {across:.4f} | "
            f"{max(ripple):.4f} at {ROLLS_DEG[np.argmax(ripple)]}° | "
            f"{metrics.rms(np.array(ripple)):.4f} |"
        )
    press = np.mean([slide.press for slide in study.slides.values()])
    yield f"\nA press takes {1e3 * press:.2f} ms of CPU time."
    yield "\n## Build\n"
    yield "| phantom | CPU time [s] | on disk, altogether [MB] |"
    yield "|---|---|---|"
    for name, build in study.builds.items():
        yield f"| {name} | {build.cpu:.2f} | {build.megabytes:.1f} |"
