# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The scan as a film and as stills: the arm at work, the skin yielding, a close-up in the
corner.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from breastscan.checks import require_positive
from breastscan.errors import ConfigError
from breastscan.geometry import kinematics, se3
from breastscan.run.trajectory import Trajectory
from sim.cameras.picture import Picture
from sim.scene import Scene
from sim.tissue.contact import Mechanics

CODEC = "vp09"
"""The one codec that OpenCV's wheel writes and every browser plays."""
FILM_SUPERSAMPLING = 1.5
STILL_SUPERSAMPLING = 3.0
FINE_SUPERSAMPLING = 1.5
"""Drawn over delivered pixels, each way [-]; the fine renderer smooths edges by itself."""
INSET_FRACTION = 1 / 3
"""Size of the close-up over that of the film [-]."""
FONT = cv2.FONT_HERSHEY_DUPLEX
INK = (245, 245, 245)
SHADE = 0.45
MARGIN_PX, STRIP_PX = 14, 36


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """A camera looking at a point."""

    target_B: tuple[float, float, float]
    """Point in the centre of the picture [m]."""
    distance: float
    """[m]"""
    azimuth_deg: float
    """Direction of the view about z, 90 looking along y [deg]."""
    elevation_deg: float
    """Negative when looking down [deg]."""

    def camera(self) -> mujoco.MjvCamera:
        """The same as MuJoCo's free camera."""
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = self.target_B
        camera.distance = self.distance
        camera.azimuth = self.azimuth_deg
        camera.elevation = self.elevation_deg
        return camera


OVERVIEW = Viewpoint(
    target_B=(0.34, 0.02, 0.27), distance=1.5, azimuth_deg=128.0, elevation_deg=-18.0
)
CLOSE_UP = Viewpoint(
    target_B=(0.50, 0.0, 0.125), distance=0.37, azimuth_deg=118.0, elevation_deg=-32.0
)


@dataclass(frozen=True, kw_only=True)
class VideoConfig:
    """Size and pace of the film."""

    width: int = 960
    """[px]"""
    height: int = 640
    """[px]"""
    fps: float = 12.0
    """Frames per second of film [Hz]."""
    speed_up: float = 2.0
    """Scan time per film time [-]."""
    fine: bool = False
    """Whether `sim.cameras.filament` draws it; it must be usable."""

    def __post_init__(self) -> None:
        require_positive(self, "video")


def render_video(
    scene: Scene,
    tissue: Mechanics,
    went: Trajectory,
    path: Path,
    config: VideoConfig | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Write the film of a scan; `tissue` is pressed anew for every frame and left undeformed.

    Args:
        scene: Where it happened.
        tissue: What the probe pressed.
        went: What happened, the true force in it.
        path: File to write, ending in .mp4.
        config: Size and pace.
        progress: Told the fraction done (0 to 1) and what is being done.

    Raises:
        ConfigError: The file cannot be written, or no OpenGL is usable.
    """
    config = config or VideoConfig()
    rows = _frame_rows(went.t, config.speed_up / config.fps)
    writer = _open_writer(path, config)
    try:
        with ThreadPoolExecutor(1) as encoder:  # one picture is encoded as the next is drawn
            written = encoder.submit(lambda: None)
            for count, frame in enumerate(_frames(scene, tissue, went, rows, config), start=1):
                written.result()
                written = encoder.submit(writer.write, cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
                if progress is not None:
                    progress(count / len(rows), "rendering the video")
            written.result()
    finally:
        writer.release()
    tissue.reset()


def render_still(
    scene: Scene,
    tissue: Mechanics,
    q: Float[np.ndarray, "6"],
    view: Viewpoint = OVERVIEW,
    size_px: tuple[int, int] = (1280, 800),
    *,
    fine: bool = False,
) -> UInt8[np.ndarray, "h w 3"]:
    """One RGB picture of the arm at `q` [rad] with the skin pressed by its probe, finely drawn
    if `fine`.
    """
    skin_S = pressed_skin(scene, tissue, q)
    tissue.reset()
    drawn_px = _scaled(size_px, FINE_SUPERSAMPLING if fine else STILL_SUPERSAMPLING)
    with closing(Picture(scene, *drawn_px, fine=fine)) as picture:
        return _shoot(picture, view, q, skin_S, size_px)


def pressed_skin(
    scene: Scene, tissue: Mechanics, q: Float[np.ndarray, "6"], time: float = 0.0
) -> Float[np.ndarray, "n 3"]:
    """The skin in S [m] as the probe of an arm at `q` [rad] deforms it at `time` [s]."""
    X_SP = se3.inverse(scene.X_BS_at(time)) @ kinematics.forward(q) @ scene.X_FP
    tissue.press(X_SP, np.zeros(3))
    return tissue.deformed_skin()


def _frame_rows(time: Float[np.ndarray, "n"], step: float) -> list[int]:
    """Rows of the samples nearest after each frame's instant."""
    return np.searchsorted(time, np.arange(time[0], time[-1], step)).tolist()


def _frames(
    scene: Scene, tissue: Mechanics, went: Trajectory, rows: list[int], config: VideoConfig
) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
    """RGB pictures of these rows, with close-up and caption."""
    assert went.true_force is not None, "the twin knows it"
    frame_px = (config.width, config.height)
    inset_px = _scaled(frame_px, INSET_FRACTION)
    with (
        closing(Picture(scene, *_scaled(frame_px, FILM_SUPERSAMPLING), fine=config.fine)) as wide,
        closing(
            Picture(scene, *_scaled(inset_px, FILM_SUPERSAMPLING), shadows=False, fine=config.fine)
        ) as near,
    ):
        for row in rows:
            q, time = went.q[row], float(went.t[row])
            skin_S = pressed_skin(scene, tissue, q, time)
            frame = _shoot(wide, OVERVIEW, q, skin_S, frame_px, time)
            _inset(frame, _shoot(near, CLOSE_UP, q, skin_S, inset_px, time))
            _caption(frame, went.elapsed[row], went.true_force[row], went.phase[row], config)
            yield frame


def _open_writer(path: Path, config: VideoConfig) -> cv2.VideoWriter:
    code = cv2.VideoWriter.fourcc(*CODEC)
    writer = cv2.VideoWriter(str(path), code, config.fps, (config.width, config.height))
    if not writer.isOpened():
        raise ConfigError(
            f"OpenCV cannot write {path}: give a file in a folder that exists, ending in .mp4", path
        )
    return writer


def _scaled(size_px: tuple[int, int], factor: float) -> tuple[int, int]:
    return round(size_px[0] * factor), round(size_px[1] * factor)


def _shoot(
    picture: Picture,
    view: Viewpoint,
    q: Float[np.ndarray, "6"],
    skin_S: Float[np.ndarray, "n 3"],
    size_px: tuple[int, int],
    time: float = 0.0,
) -> UInt8[np.ndarray, "h w 3"]:
    picture.arrange(q, skin_S, time)
    return cv2.resize(picture.draw(view.camera()), size_px, interpolation=cv2.INTER_AREA).astype(
        np.uint8, copy=False
    )


def _inset(frame: UInt8[np.ndarray, "h w 3"], small: UInt8[np.ndarray, "h2 w2 3"]) -> None:
    """Put the close-up, framed, into the lower left corner above the caption."""
    height, width, _ = small.shape
    top, left = frame.shape[0] - STRIP_PX - MARGIN_PX - height, MARGIN_PX
    frame[top - 2 : top + height + 2, left - 2 : left + width + 2] = INK
    frame[top : top + height, left : left + width] = small


def _caption(
    frame: UInt8[np.ndarray, "h w 3"], time: float, force: float, phase: str, config: VideoConfig
) -> None:
    """One line of text on a shaded strip along the bottom."""
    height, width, _ = frame.shape
    strip = frame[height - STRIP_PX :]
    strip[:] = (strip * SHADE).astype(np.uint8)
    baseline = height - STRIP_PX // 3
    texts = (
        (f"{time:5.1f} s", 0.02),
        (f"{max(force, 0.0):5.2f} N", 0.17),
        (phase, 0.34),
        (f"x{config.speed_up:g}", 0.94),
    )
    for text, fraction in texts:
        cv2.putText(frame, text, (int(fraction * width), baseline), FONT, 0.55, INK, 1, cv2.LINE_AA)
