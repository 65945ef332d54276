"""A path on disk to joint angles for every 2 ms, and to a URScript program that a controller runs
by itself, without force control.
"""

from pathlib import Path

import numpy as np

from breastscan import Cell
from breastscan.planning import motion
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.pattern import Path as SkinPath
from breastscan.robot.ur import program
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.run.reading import read_path

RUN = Path("out/scan")

cell = Cell.load(RUN / "cell.json")
points_B, normals_B = read_path(RUN / "path.csv")
path = SkinPath(points_B=points_B, normals_B=normals_B)
planned, feed = motion.plan_motion(path, cell.X_FP, PERIOD, FeedrateLimits(), JointPathConfig())

q_retreat = planned.lifted(len(planned.q) - 1, cell.X_FP, cell.kinematics)
text = program.urscript(planned.q, planned.qd, planned.q_approach, q_retreat, cell.X_FP)
Path("loop.script").write_text(text, encoding="utf-8")
print(
    f"{1e3 * feed.s[-1]:.0f} mm in {feed.t[-1]:.1f} s, a program of {len(text.splitlines())} lines"
)
print(f"fastest joint: {np.rad2deg(np.abs(planned.qd).max()):.1f} deg/s")
