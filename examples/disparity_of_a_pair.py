"""A stereo pair on disk to disparity and points: the images and the rig that a scan left."""

from pathlib import Path

import numpy as np

from breastscan import Cell
from breastscan.camera.folder import FolderCamera
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate

RUN = Path("out/scan")

images = FolderCamera(RUN).capture()
pair = Cell.load(RUN / "cell.json").rig.rectify(images.left, images.right)
disparity = disparity_map(pair.left, pair.right, StereoConfig(consistency_px=2))

points_L = triangulate(disparity, pair)
known = np.isfinite(disparity)
print(f"{100 * known.mean():.0f} % of the pixels matched")
print(f"disparity {np.nanmin(disparity):.1f} to {np.nanmax(disparity):.1f} px")
print(f"nearest point {1e3 * points_L[known][:, 2].min():.0f} mm away")
