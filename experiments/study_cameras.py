"""How well do the simulated cameras keep their promises, and what do their errors cost the
reconstruction?
"""

import copy
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes

from breastscan.geometry import se3
from breastscan.run import writing
from breastscan.run.provenance import provenance
from breastscan.scan import PerceptionConfig, Stages, perceive
from experiments import bench_camera, camera_projection
from sim import error_analysis
from sim.cameras import filament
from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CAMERA_CLASSES, FULL_WELL, WHITE, CameraConfig, CameraErrors
from sim.cameras.lens import Lens, canvases
from sim.cameras.sensor import expose
from sim.cameras.video import CLOSE_UP, render_still
from sim.scene import HOME_Q, Scene, SceneConfig
from sim.tissue.soft import SoftTissue
from sim.truth import Truth

FLAT_PX = (300, 400)
"""Size of a flat field."""
LEVELS = np.linspace(10, 230, 12)
"""Brightness of the flat fields [grey levels]."""
EDGE_SLOPE = 0.09
"""Columns an edge moves a row: all fractions of a pixel are met."""
EDGE_BIN, EDGE_REACH = 0.25, 20.0
"""Width of a bin across the edge, and how far they go [px]."""
CROP_PX = 160
"""Side of the patch of skin that is shown."""
CROP_ZOOM = 3
STILL_PX = (640, 400)


def run(out: Path, *, seed: int) -> dict[str, float]:
    """Measure, and leave `study.md`, `study.json` and the figures `twin_camera_*.png` in `folder`.

    Args:
        out: Where the results go; earlier ones stay until these are complete.
        seed: Of the phantom and of every noise.

    Returns:
        The figures, as in `study.json`.
    """
    scene = Scene(SceneConfig().seeded(seed))
    tissue = SoftTissue.build(scene.phantom)
    with writing.staged(out) as staging:
        values = _projection(scene, seed) | _draw_errors(
            staging / "twin_camera_errors.png", scene, seed
        )
        values |= _reconstructions(staging / "twin_camera_classes.png", scene, tissue)
        values |= {what: own for what, own, *_ in bench_camera.rows()}
        _draw_stills(staging / "twin_camera_still.png", scene, tissue)
        rows = [f"| {name} | {value:.4g} |" for name, value in values.items()]
        (staging / "study.md").write_text(
            "\n".join(["| what | value |", "|---|---|", *rows]) + "\n", encoding="utf-8"
        )
        writing.write_json(staging / "study.json", {"seed": seed, "values": values, **provenance()})
    return values


def _projection(scene: Scene, seed: int) -> dict[str, float]:
    """Drawn dots against OpenCV's projection."""
    values = {}
    for side in ("left", "right"):
        found = camera_projection.measure(scene.rig, side, supersampling=2, seed=seed)
        values |= {
            f"projection_{side}_mean_px": found.mean_px,
            f"projection_{side}_corner_rms_px": found.corner_rms_px,
        }
    return values


def _draw_errors(path: Path, scene: Scene, seed: int) -> dict[str, float]:
    """Photon transfer, shading and contrast of the realistic camera, measured and as set."""
    config = CameraConfig(quality="realistic", vignetting=0.0, blur_px=0.0)
    rng = np.random.default_rng(seed)
    flats = [
        expose(np.full(FLAT_PX, level, np.float32), config, rng).astype(float) for level in LEVELS
    ]
    mean, variance = np.array([[flat.mean(), flat.var()] for flat in flats]).T
    slope, foot = np.polyfit(mean, variance - 1 / 12, 1)
    read_noise = np.sqrt(max(foot, 0.0)) / slope
    figure, (transfer, shading, contrast) = plt.subplots(
        1, 3, figsize=(12, 3.6), layout="constrained"
    )
    transfer.plot(mean, variance, "o", label="measured")
    transfer.plot(
        mean,
        slope * mean + foot + 1 / 12,
        label=f"{slope * FULL_WELL / WHITE:.3f} grey levels per set one",
    )
    transfer.set(
        xlabel="mean [grey levels]", ylabel="variance [grey levels²]", title="photon transfer"
    )
    _draw_shading(shading, scene)
    frequency, ideal, realistic = _contrasts(scene)
    contrast.plot(frequency, ideal, label="ideal")
    contrast.plot(frequency, realistic, label="realistic")
    gaussian = np.exp(-2 * (np.pi * CAMERA_CLASSES["realistic"].blur_px * frequency) ** 2)
    contrast.plot(frequency, ideal * gaussian, "k:", label="as set")
    contrast.set(
        xlabel="line pairs a pixel",
        ylabel="contrast",
        title="slanted edge",
        xlim=(0, 0.5),
        ylim=(0, 1.05),
    )
    for axis in (transfer, shading, contrast):
        axis.legend(fontsize=8)
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    half = float(np.interp(-0.5, -realistic, frequency))
    return {
        "full_well_e": WHITE / slope,
        "read_noise_e": float(read_noise),
        "contrast_half_per_px": half,
    }


def _draw_shading(axis: Axes, scene: Scene) -> None:
    """Light along the image's diagonal."""
    canvas = canvases(scene.rig, 1)["right"]
    white = np.full((canvas.height, canvas.width, 3), 200, np.uint8)
    light = Lens(scene.rig.right, canvas, 1, CAMERA_CLASSES["realistic"]).bend(white) / 200
    height, width = light.shape
    along = np.linspace(0, 1, 400)
    x, y = np.rint(along * (width - 1)).astype(int), np.rint(along * (height - 1)).astype(int)
    axis.plot(np.hypot(width, height) * (along - 0.5), light[y, x], label="corner to corner")
    axis.set(xlabel="from the centre [px]", ylabel="light [-]", title="shading", ylim=(0, 1.05))


def _contrasts(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contrast over frequency [line pairs a pixel] of an ideal and the realistic lens (ISO
    12233).
    """
    finer = 3
    canvas = canvases(scene.rig, finer)["left"]
    y, x = (index / finer for index in np.indices((canvas.height, canvas.width)))
    edge = x - canvas.width / 2 / finer - EDGE_SLOPE * (y - canvas.height / 2 / finer) > 0
    drawn = np.repeat(np.where(edge, 200, 40).astype(np.uint8)[..., None], 3, axis=2)
    errors = (CameraErrors(), CameraErrors(blur_px=CAMERA_CLASSES["realistic"].blur_px))
    centre = slice(512 - 60, 512 + 60), slice(640 - 60, 640 + 60)
    transfers = [
        _transfer(Lens(scene.rig.left, canvas, finer, each).bend(drawn)[centre]) for each in errors
    ]
    return transfers[0][0], transfers[0][1], transfers[1][1]


def _transfer(light: Float[np.ndarray, "h w"]) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and the contrast left at them, from an edge whose place in each row is found
    first.
    """
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    gradient = np.abs(np.diff(light, axis=1))
    places = (gradient * x[:, 1:]).sum(axis=1) / gradient.sum(axis=1)
    line = np.polynomial.Polynomial.fit(y[:, 0], places, 1)
    slope = float(line.deriv()(0.0))
    across = (x + 0.5 - line(y)) / np.hypot(1, slope)
    bins = np.arange(-EDGE_REACH, EDGE_REACH, EDGE_BIN)
    where = np.digitize(across.ravel(), bins)
    spread = np.array([light.ravel()[where == i].mean() for i in range(1, len(bins))])
    spectrum = np.abs(np.fft.rfft(np.diff(spread) * np.hanning(len(spread) - 1)))
    return np.fft.rfftfreq(len(spread) - 1, EDGE_BIN), spectrum / spectrum[0]


def _reconstructions(path: Path, scene: Scene, tissue: SoftTissue) -> dict[str, float]:
    """The surface that each class of camera leads to; a patch of each picture side by side."""
    truth, X_SL = Truth(scene.phantom, tissue), se3.inverse(scene.X_BS) @ scene.X_BL
    values, crops = {}, []
    for quality in CAMERA_CLASSES:
        seen = copy.copy(scene)  # compiled once
        seen.config = replace(scene.config, camera=replace(scene.config.camera, quality=quality))
        with closing(SimStereoCamera(seen)) as camera:
            pair = camera.capture()
        result = perceive(pair, scene.rig, PerceptionConfig(), Stages())
        surface = error_analysis.surface_metrics(result, scene.rig, X_SL, truth)
        values |= {f"{quality}_{name}": value for name, value in surface.items()}
        crops.append(_crop(pair.left, quality))
    writing.write_image(path, np.hstack(crops))
    return values


def _crop(image: UInt8[np.ndarray, "h w"], title: str) -> UInt8[np.ndarray, "h2 w2"]:
    """A patch about the centre of the image, enlarged without smoothing."""
    centre = np.array(image.shape) // 2
    top, left = centre - CROP_PX // 2
    patch = image[top : top + CROP_PX, left : left + CROP_PX]
    large = cv2.resize(
        patch, None, fx=CROP_ZOOM, fy=CROP_ZOOM, interpolation=cv2.INTER_NEAREST
    ).astype(np.uint8)
    cv2.putText(large, title, (12, 30), cv2.FONT_HERSHEY_DUPLEX, 0.8, (255,), 1, cv2.LINE_AA)
    return large


def _draw_stills(path: Path, scene: Scene, tissue: SoftTissue) -> None:
    """The classic and, where it can be used, the physically based renderer side by side."""
    stills = [render_still(scene, tissue, np.array(HOME_Q), CLOSE_UP, STILL_PX)]
    if filament.unusable() is None:
        stills.append(render_still(scene, tissue, np.array(HOME_Q), CLOSE_UP, STILL_PX, fine=True))
    writing.write_image(path, cv2.cvtColor(np.hstack(stills), cv2.COLOR_RGB2BGR))
