"""A cloud on disk to a loop around the breast at half its height, points and normals."""

from pathlib import Path

import numpy as np

from breastscan.cloud.skin_fit import fit_cloud
from breastscan.geometry.plane import Plane
from breastscan.planning.pattern import PatternConfig, half_height_loop
from breastscan.run.reading import read_cloud
from breastscan.run.writing import write_path

RUN = Path("out/scan")

points_B, normals_B = read_cloud(RUN / "cloud.ply")
plate = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.08)
skin = fit_cloud(points_B, normals_B, plate)
path = half_height_loop(skin, plate, PatternConfig(points=15))

write_path(Path("loop.csv"), path.points_B, path.normals_B)
print(f"{len(path.points_B)} points at {1e3 * plate.heights(path.points_B).mean():.1f} mm height")
print(f"the curve through them is {1e3 * path.curve.length:.0f} mm long")
