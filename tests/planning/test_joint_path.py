import numpy as np
import pytest

from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import motion, redundancy
from breastscan.planning.feedrate import Feed, FeedrateLimits
from breastscan.planning.joint_limits import JointPathConfig, check_trajectory
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path
from breastscan.planning.roll_graph import BlockedError

PERIOD = 0.002


def probe_mount(angle_deg: float = 45.0) -> np.ndarray:
    X_rotated = se3.from_rotation_vector(
        np.array([0.0, np.radians(angle_deg), 0.0]), np.array([0.0, 0.0, 0.06])
    )
    return X_rotated @ se3.pose(np.eye(3), np.array([0.0, 0.0, 0.14]))


def loop(x: float = 0.5) -> Path:
    """A ring of 62 mm radius at half height of a dome, its normals 50 degrees off vertical."""
    angle = np.pi + np.linspace(0.0, 2 * np.pi, 15, endpoint=False)
    outwards = np.stack([np.cos(angle), np.sin(angle), np.zeros(15)], axis=1)
    tilt = np.radians(50.0)
    return Path(
        points_B=np.array([x, 0.0, 0.1075]) + 0.062 * outwards,
        normals_B=np.sin(tilt) * outwards + np.array([0.0, 0.0, np.cos(tilt)]),
    )


def plan(path: Path, mount_deg: float = 45.0, **joints: float) -> tuple[Motion, Feed]:
    return motion.plan_motion(
        path, probe_mount(mount_deg), PERIOD, FeedrateLimits(), JointPathConfig(**joints)
    )


@pytest.fixture(scope="module")
def both() -> tuple[Motion, Feed]:
    return plan(loop())


@pytest.fixture(scope="module")
def planned(both) -> Motion:
    return both[0]


@pytest.fixture(scope="module")
def ring(both) -> tuple[np.ndarray, np.ndarray]:
    """Points of the path at every period, and the normals there."""
    return both[1].positions, loop().normals(both[1].u)


def test_probe_tip_follows_the_path_with_its_axis_against_the_normal(ring, planned):
    positions_B, normals_B = ring
    X_BP = kinematics.forward(planned.q) @ probe_mount()
    np.testing.assert_allclose(X_BP[:, :3, 3], positions_B, atol=1e-9)
    np.testing.assert_allclose(X_BP[:, :3, 2], -normals_B, atol=1e-9)


def test_joints_stay_inside_every_limit_without_a_flip(planned):
    config = JointPathConfig()
    acceleration = np.diff(planned.qd, axis=0) / PERIOD
    assert np.all(np.abs(planned.q) <= config.reachable_angles)
    assert np.abs(planned.qd).max() < config.speed_limit
    assert np.abs(acceleration).max() < 1.0
    assert np.abs(np.diff(planned.q, axis=0)).max() < 0.002
    factors = kinematics.singularity_factors(planned.q)
    assert np.all(np.sign(factors) == np.sign(factors[0]))
    assert kinematics.singularity_measure(planned.q).min() >= config.singularity_margin


def test_joint_speeds_carry_the_probe_at_the_feedrate(ring, planned):
    p_F = probe_mount()[:3, 3]
    velocity_B, angular_velocity_B = np.einsum(
        "nkij,nj->kni", kinematics.jacobian(planned.q).reshape(-1, 2, 3, 6), planned.qd
    )
    velocity = velocity_B + np.cross(
        angular_velocity_B, kinematics.forward(planned.q)[:, :3, :3] @ p_F
    )
    np.testing.assert_allclose(velocity, np.gradient(ring[0], PERIOD, axis=0), atol=1e-6)


def test_elbow_stays_above_the_line_from_shoulder_to_wrist(planned):
    heights = kinematics.link_heights(planned.q)[:, 1:4]
    assert np.all(heights[:, 1] > (heights[:, 0] + heights[:, 2]) / 2)


def test_arm_stays_above_the_floor(planned):
    heights = kinematics.link_heights(planned.q)[:, 2:]
    assert heights.min() >= JointPathConfig().floor


def test_approach_and_retreat_are_clear_of_the_skin_along_the_normal(ring, planned):
    (positions_B, normals_B), clearance = ring, JointPathConfig().clearance
    q_retreat = planned.lifted(len(planned.q) - 1, probe_mount(), KinematicCalibration.nominal())
    for q, q_skin, sample in (
        (planned.q_approach, planned.q[0], 0),
        (q_retreat, planned.q[-1], -1),
    ):
        X_BP = kinematics.forward(q) @ probe_mount()
        np.testing.assert_allclose(
            X_BP[:3, 3], positions_B[sample] + clearance * normals_B[sample], atol=1e-9
        )
        np.testing.assert_allclose(
            X_BP[:3, :3], (kinematics.forward(q_skin) @ probe_mount())[:3, :3], atol=1e-9
        )
        assert np.abs(q - q_skin).max() < np.radians(40.0)


def test_fixed_roll_keeps_the_array_across_the_path():
    fixed, feed = plan(loop(), roll_tolerance=0.0)
    X_BP = kinematics.forward(fixed.q) @ probe_mount()
    travel = np.gradient(feed.positions, axis=0)
    travel /= np.linalg.norm(travel, axis=1, keepdims=True)
    assert np.degrees(np.abs(np.arcsin(np.sum(X_BP[:, :3, 0] * travel, axis=1)))).max() < 0.01


def test_free_roll_moves_the_joints_less_than_a_fixed_one_where_the_probe_is_straight():
    def effort(roll_tolerance: float) -> float:
        moved, _ = plan(loop(), mount_deg=0.0, roll_tolerance=roll_tolerance)
        assert moved.slowed == 1.0
        return float(np.sum(moved.qd**2))

    assert effort(np.pi / 2) < 0.8 * effort(0.0)


@pytest.mark.parametrize("x", [0.45, 0.60])
@pytest.mark.parametrize("mount_deg", [45.0, -45.0])
def test_a_mount_of_45_degrees_serves_the_whole_window_with_slow_joints(x, mount_deg):
    moved, _ = plan(loop(x), mount_deg)
    assert moved.slowed == 1.0
    assert np.abs(moved.qd).max() < 0.6


def test_a_phantom_out_of_reach_says_by_how_many_millimetres():
    with pytest.raises(PlanningError, match=r"\d+ mm out of the arm's reach"):
        plan(loop(0.95))


def test_a_phantom_under_the_floor_says_so():
    with pytest.raises(PlanningError, match="below the floor"):
        plan(loop(), floor=0.6)


def test_a_joint_that_passes_its_limit_is_named_with_the_share_of_the_path_before_it():
    """Joint 6 at an even speed to 365 degrees, of 355 that are allowed."""
    q = np.tile(np.radians([0.0, -90.0, 90.0, 0.0, 90.0, 0.0]), (366, 1))
    q[:, 5] = np.radians(np.arange(366))
    with pytest.raises(BlockedError, match=r"joint 6 would pass its limit of 6\.20 rad") as refused:
        check_trajectory(q, PERIOD, JointPathConfig())
    assert refused.value.reached == pytest.approx(355 / 365, abs=0.005)
    check_trajectory(q[:355], PERIOD, JointPathConfig())


def test_a_path_that_stands_still_is_refused(ring):
    positions_B, normals_B = ring[0].copy(), ring[1]
    positions_B[100:104] = positions_B[100]
    with pytest.raises(PlanningError, match="stands still"):
        redundancy.resolve(positions_B, normals_B, probe_mount(), PERIOD, JointPathConfig())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("position_limit", 0.0),
        ("speed_limit", -1.0),
        ("acceleration_limit", np.nan),
        ("jerk_limit", np.inf),
        ("collision_margin", -0.01),
        ("position_margin", 4.0),
        ("singularity_margin", 1.0),
        ("roll_tolerance", -0.1),
        ("floor", np.inf),
        ("body_margin", -0.001),
        ("pressed_depth", 0.2),
        ("yielding", -0.01),
        ("largest_tilt", 1.0),
    ],
)
def test_limits_that_contradict_are_named(name, value):
    with pytest.raises(ConfigError, match=name):
        JointPathConfig(**{name: float(value)})
