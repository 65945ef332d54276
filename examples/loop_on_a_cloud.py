"""A cloud on disk to a loop around the breast at half its height, points and normals."""

from pathlib import Path

from breastscan.cloud.cleaned import breast_of, cleaned
from breastscan.cloud.skin_fit import fit_cloud
from breastscan.planning.pattern import PatternConfig, half_height_loop
from breastscan.run.clouds import read_cloud
from breastscan.run.writing import write_path

RUN = Path("out/scan")

breast, cloud = breast_of(cleaned(read_cloud(RUN / "cloud.ply")))
skin = fit_cloud(cloud.points_B[breast.skin], cloud.normals_B[breast.skin], breast.chest)
path = half_height_loop(skin, breast.chest, PatternConfig(points=15))

write_path(Path("loop.csv"), path.points_B, path.normals_B)
heights = breast.chest.heights(path.points_B)
print(f"{len(path.points_B)} points at {1e3 * heights.mean():.1f} mm height")
print(f"the curve through them is {1e3 * path.curve.length:.0f} mm long")
