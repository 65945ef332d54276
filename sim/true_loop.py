"""The motion around the true half-height loop, planned without cameras: what studies and tests
of contact run on.
"""

from breastscan.geometry import se3
from breastscan.planning import motion
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path
from breastscan.robot.ur.ur5e import PERIOD
from sim.scene import Scene
from sim.tissue.contact import Mechanics
from sim.truth import Truth

LOOP_POINTS = 15


def true_loop_motion(scene: Scene, tissue: Mechanics) -> Motion:
    """The motion through 15 points of the true loop, with the truth's normals and the nominal
    arm.
    """
    truth = Truth(scene.phantom, tissue)
    loop_S = truth.level_loop()
    points_S, normals_S = truth.closest(loop_S[:: len(loop_S) // LOOP_POINTS][:LOOP_POINTS])
    path = Path(
        points_B=se3.transform(scene.X_BS, points_S), normals_B=se3.rotate(scene.X_BS, normals_S)
    )
    return motion.plan_motion(path, scene.X_FP, PERIOD, FeedrateLimits(), JointPathConfig())[0]
