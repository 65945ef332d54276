"""What do the cameras see, and what becomes of it? The counterparts of [Zhang, Figs. 5, 6, 7] from
the twin.

`python -m experiments.vision_figures RUN OUT` draws them from the pair that `breastscan scan --out
RUN` left.
"""

from pathlib import Path

import cv2
import numpy as np
import tyro

from breastscan.camera.grey import read_grey
from breastscan.camera.interface import StereoPair
from breastscan.run import writing
from breastscan.scan import PerceptionConfig, Reconstruction, Stages, perceive
from sim.scene import Scene, SceneConfig

LINES = 12
"""Lines drawn across the rectified pair."""
FIGURE_WIDTH = 900
"""[px]"""
DOT = 1
"""Half the side of a point of the cloud [px]."""
CLOUD_SCALE = 4000.0
"""[px/m]"""
CLOUD_TILT_DEG = 55.0
TO_LAMP = np.array([-0.4, -0.5, -0.77])
"""Unit vector in the rotated view: x to the right, y down, z away."""
AROUND_PX = 140
"""What the disparity picture shows around the breast [px]."""


def main(run: Path, out: Path, seed: int = 0) -> None:
    """Draw the figures.

    Args:
        run: Folder of a scan of the twin.
        out: Folder for vision_rectified.png, vision_disparity.png and vision_cloud.png.
        seed: The scan's.
    """
    images = StereoPair(
        left=read_grey(run / "left.png"), right=read_grey(run / "right.png"), time=0.0
    )
    result = perceive(images, Scene(SceneConfig().seeded(seed)).rig, PerceptionConfig(), Stages())
    writing.write_image(out / "vision_rectified.png", _rectified(result))
    writing.write_image(out / "vision_disparity.png", _disparity(result))
    writing.write_image(out / "vision_cloud.png", _cloud(result))


def _rectified(result: Reconstruction) -> np.ndarray:
    """Both views side by side; matching points lie on one line [Zhang, Fig. 5]."""
    picture = cv2.cvtColor(np.hstack([result.pair.left, result.pair.right]), cv2.COLOR_GRAY2BGR)
    for y in np.linspace(0, picture.shape[0] - 1, LINES + 2)[1:-1].astype(int):
        cv2.line(picture, (0, int(y)), (picture.shape[1] - 1, int(y)), (60, 200, 60), 2)
    return _shrunk(picture, FIGURE_WIDTH)


def _disparity(result: Reconstruction) -> np.ndarray:
    """The breast and the plate around it [Zhang, Fig. 6]."""
    y, x = (np.flatnonzero(result.breast.mask.any(axis=axis)) for axis in (1, 0))
    rows = slice(max(y[0] - AROUND_PX, 0), y[-1] + AROUND_PX)
    columns = slice(max(x[0] - AROUND_PX, 0), x[-1] + AROUND_PX)
    return writing.disparity_picture(result.disparity[rows, columns])


def _cloud(result: Reconstruction) -> np.ndarray:
    """The down-sampled breast seen from the side, lit by its normals [Zhang, Fig. 7]."""
    tilt = np.radians(CLOUD_TILT_DEG)
    rotation = np.array(
        [[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]]
    )
    points = (result.sampled_L - result.sampled_L.mean(axis=0)) @ rotation.T
    light = np.clip(result.normals_L @ rotation.T @ TO_LAMP, 0.2, 1.0)
    xy = (CLOUD_SCALE * points[:, :2]).astype(int)
    xy -= xy.min(axis=0) - 20
    picture = np.full((*(xy.max(axis=0) + 20)[::-1], 3), 255, np.uint8)
    for i in np.argsort(-points[:, 2]):  # the farthest first
        x, y = (int(value) for value in xy[i])
        shade = (np.array([170, 120, 40]) * light[i]).tolist()
        cv2.rectangle(picture, (x - DOT, y - DOT), (x + DOT, y + DOT), shade, -1)
    return _shrunk(picture, 640)


def _shrunk(picture: np.ndarray, width: int) -> np.ndarray:
    height = round(picture.shape[0] * width / picture.shape[1])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


if __name__ == "__main__":
    tyro.cli(main)
