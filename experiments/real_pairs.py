"""Photographed stereo pairs whose disparity was measured with structured light: Middlebury's.

None is shipped here. One, Motorcycle of 2014, lies in an old release of scikit-image, which pip
fetches; others are read from folders as Middlebury packs them.
"""

import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import cv2
import numpy as np
from platformdirs import user_cache_path

from breastscan.camera.grey import read_grey
from breastscan.errors import ConfigError
from experiments.depth_edges import EdgePair

SCIKIT_IMAGE = "scikit-image==0.17.2"
"""The last release that carries the pair."""
PIP_OPTIONS = ("--no-deps", "--python-version", "3.8", "--only-binary", ":all:", "--quiet")
MOTORCYCLE = ("motorcycle_left.png", "motorcycle_right.png", "motorcycle_disp.npz")
LAYOUTS = (("im0.png", "im1.png", "disp0.pfm"), ("view1.png", "view5.png", "disp1.png"))
"""Left image, right image and left disparity [px], as in the sets of 2014 and of 2005/2006 (full
size)."""


def motorcycle() -> EdgePair:
    """The Motorcycle pair, 741 x 500 px; fetched once.

    Raises:
        ConfigError: pip could not fetch it.
    """
    folder = user_cache_path("breastscan") / "motorcycle"
    if not all((folder / name).is_file() for name in MOTORCYCLE):
        _fetch_motorcycle(folder)
    left, right = (read_grey(folder / name) for name in MOTORCYCLE[:2])
    return _pair(left, right, np.load(folder / MOTORCYCLE[2])["arr_0"])


def middlebury(folder: Path) -> EdgePair:
    """The pair in a folder of Middlebury's sets of 2014, or of 2005 or 2006 in full size.

    Raises:
        ConfigError: The folder holds no such set.
        PerceptionError: An image is damaged.
    """
    for names in LAYOUTS:
        left, right, truth = (folder / name for name in names)
        if all(file.is_file() for file in (left, right, truth)):
            disparity = cv2.imread(str(truth), cv2.IMREAD_UNCHANGED)
            assert disparity is not None
            return _pair(read_grey(left), read_grey(right), disparity)
    wanted = " or ".join(", ".join(names) for names in LAYOUTS)
    raise ConfigError(f"{folder} is not a folder of Middlebury's: expected {wanted}", folder)


def _pair(left: np.ndarray, right: np.ndarray, disparity: np.ndarray) -> EdgePair:
    known = np.isfinite(disparity) & (disparity > 0)
    return EdgePair(
        left=left,
        right=right,
        disparity=np.where(known, disparity, np.nan).astype(float),
        seen_twice=known,
    )


def _fetch_motorcycle(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as downloads:
        command = [
            sys.executable,
            "-m",
            "pip",
            "download",
            *PIP_OPTIONS,
            "--dest",
            downloads,
            SCIKIT_IMAGE,
        ]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        wheels = list(Path(downloads).glob("*.whl"))
        if run.returncode or not wheels:
            reason = (run.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise ConfigError(f"pip could not fetch {SCIKIT_IMAGE}: {reason}", run.returncode)
        folder.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(wheels[0]) as wheel:
            for name in MOTORCYCLE:
                (folder / name).write_bytes(wheel.read(f"skimage/data/{name}"))
