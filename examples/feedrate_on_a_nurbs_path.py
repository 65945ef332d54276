"""A closed curve through a few points, and a motion along it inside limits of speed, acceleration
and jerk: one position every 2 ms.
"""

import numpy as np

from breastscan.geometry.nurbs import Nurbs
from breastscan.planning import feedrate
from breastscan.planning.feedrate import FeedrateLimits

angle = np.linspace(0, 2 * np.pi, 15, endpoint=False)
points = np.stack([0.059 * np.cos(angle), 0.073 * np.sin(angle), 0.003 * np.cos(3 * angle)], axis=1)
curve = Nurbs.interpolate(points)
feed = feedrate.interpolate(curve, FeedrateLimits(speed=0.025), period=0.002)

speed = np.linalg.norm(np.diff(feed.positions, axis=0), axis=1) / 0.002
radius = 1 / curve.curvature(np.linspace(0, 1, 1000, endpoint=False)).max()
print(f"length {1e3 * curve.length:.1f} mm, sharpest radius {1e3 * radius:.1f} mm")
print(f"{len(feed.positions)} positions, {feed.t[-1]:.2f} s, fastest {1e3 * speed.max():.2f} mm/s")
print(f"the speed misses the planned one by {feed.fluctuation_pct:.1e} % at most")
