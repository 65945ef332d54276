import dataclasses

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.hulls import Shape
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import joint_limits, motion
from breastscan.planning.clearance import Clearance
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_limits import Corrections, JointPathConfig
from breastscan.planning.pattern import Path

PERIOD = 0.002
X_FP = se3.from_rotation_vector(np.array([0.0, np.pi / 4, 0.0]), np.array([0.099, 0.0, 0.159]))


def loop() -> Path:
    """A wavy ring at half height of a dome, its normals about 50 degrees off vertical."""
    angle = np.pi + np.linspace(0.0, 2 * np.pi, 15, endpoint=False)
    radius = 0.062 + 0.003 * np.random.default_rng(2).uniform(-1.0, 1.0, 15)
    outwards = np.stack([np.cos(angle), np.sin(angle), np.zeros(15)], axis=1)
    tilt = np.radians(50.0)
    return Path(
        points_B=np.array([0.5, 0.0, 0.1075]) + radius[:, None] * outwards,
        normals_B=np.sin(tilt) * outwards + np.array([0.0, 0.0, np.cos(tilt)]),
    )


def plan(
    limits: FeedrateLimits | None = None, period: float = PERIOD, **joints: float
) -> motion.Motion:
    return motion.plan_motion(
        loop(), X_FP, period, limits or FeedrateLimits(), JointPathConfig(**joints)
    )[0]


def largest(planned: motion.Motion, order: int, period: float = PERIOD) -> float:
    return float(np.abs(np.diff(planned.q, order, axis=0)).max() / period**order)


@pytest.fixture(scope="module")
def planned() -> motion.Motion:
    return plan()


def test_joints_that_keep_up_are_not_slowed(planned):
    assert planned.slowed == 1.0
    assert largest(planned, 1) < np.pi


@pytest.mark.parametrize(
    ("limit", "order", "bound"),
    [("speed_limit", 1, 0.2), ("acceleration_limit", 2, 0.1), ("jerk_limit", 3, 0.5)],
)
def test_a_limit_that_would_be_broken_slows_the_motion_down_until_it_just_holds(
    planned, limit, order, bound
):
    slowed = plan(**{limit: bound})
    assert 0.95 * bound < largest(slowed, order) <= bound
    factor = (largest(planned, order) / bound) ** (1 / order)
    assert slowed.slowed == pytest.approx(factor, rel=0.02)
    assert len(slowed.q) == pytest.approx(factor * len(planned.q), rel=0.02)


def test_slowing_down_leaves_path_and_fluctuation_alone(planned):
    slowed, feed = motion.plan_motion(
        loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(speed_limit=0.2)
    )
    tip_B = (kinematics.forward(slowed.q) @ X_FP)[:, :3, 3]
    np.testing.assert_allclose(tip_B, feed.positions, atol=1e-9)
    assert feed.fluctuation_pct < 1e-6
    np.testing.assert_allclose(slowed.q[-1], planned.q[-1], atol=1e-6)


def test_a_feedrate_twenty_times_too_fast_is_slowed_as_well():
    fast = plan(FeedrateLimits(speed=1.0, acceleration=5.0, normal_acceleration=5.0, jerk=50.0))
    assert fast.slowed > 1.0
    assert largest(fast, 2) <= JointPathConfig().acceleration_limit


def test_the_use_of_each_limit_names_joint_value_and_place(planned):
    angle, speed, acceleration, jerk = joint_limits.limit_uses(planned.q, PERIOD, JointPathConfig())
    assert (angle.limit, speed.limit, acceleration.limit, jerk.limit) == (
        "angle",
        "speed",
        "acceleration",
        "jerk",
    )
    by_hand = np.abs(np.diff(planned.q, axis=0)) / PERIOD
    sample, joint = np.unravel_index(by_hand.argmax(), by_hand.shape)
    assert (speed.sample, speed.joint) == (sample, joint + 1)
    assert speed.fraction == pytest.approx(by_hand.max() / np.pi)


def test_acceleration_and_jerk_do_not_depend_on_the_sampling(planned):
    """Physics: a motion whose jerk is bounded looks the same at 1 and at 2 ms; a hidden kink
    would double.
    """
    for config in ({}, {"roll_tolerance": 0.0}):
        coarse, fine = plan(**config), plan(period=PERIOD / 2, **config)
        for order in (1, 2, 3):
            assert largest(fine, order, PERIOD / 2) == pytest.approx(
                largest(coarse, order), rel=0.05
            )


def test_a_calibrated_arm_puts_the_tip_on_the_path():
    rng = np.random.default_rng(0)
    arm = KinematicCalibration.from_dh_corrections(
        theta=rng.normal(0, 1e-3, 6),
        d=rng.normal(0, 5e-4, 6),
        a=rng.normal(0, 5e-4, 6),
        alpha=rng.normal(0, 1e-3, 6),
    )
    planned, feed = motion.plan_motion(
        loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(), calibration=arm
    )
    tip_B = (arm.forward(planned.q) @ X_FP)[:, :3, 3]
    np.testing.assert_allclose(tip_B, feed.positions, atol=1e-9)
    nominal_mm = 1e3 * np.linalg.norm(
        (kinematics.forward(planned.q) @ X_FP)[:, :3, 3] - tip_B, axis=1
    )
    assert nominal_mm.max() > 0.3


def ball(p_B: np.ndarray, radius: float) -> Shape:
    return Shape(name="ball", kind="sphere", size=(radius,), X=se3.pose(np.eye(3), p_B))


def test_the_arm_goes_another_way_round_a_collision(planned):
    """A ball where the wrist would pass half-way."""
    wrist_B = KinematicCalibration.nominal().link_frames(planned.q)[:, 3, :3, 3]
    clearance = Clearance(room=[ball(wrist_B[len(wrist_B) // 2] + [0.0, 0.0, 0.05], 0.01)])
    around, _ = motion.plan_motion(
        loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(), clearance=clearance
    )
    assert clearance(planned.q).min() < 0.0
    assert clearance(around.q[::20]).min() >= JointPathConfig().collision_margin


def test_a_collision_that_no_roll_and_no_tilt_avoids_is_named():
    """A ball on the path itself, at a hand's breadth over the skin."""
    middle_B = np.array([0.5, 0.0, 0.2])
    with pytest.raises(PlanningError, match=r"joints\.collision_margin"):
        motion.plan_motion(
            loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(),
            clearance=Clearance([ball(X_FP[:3, 3], 0.01)], [ball(middle_B, 0.12)]),
        )  # fmt: skip


def test_a_corrected_plan_keeps_the_supervisors_limits():
    """Whatever the correction does along the axis: its speed through the Jacobian, on top of the
    plan's own, is no more than a command may ask for.
    """
    corrections = Corrections(
        pressing_speed=0.06,
        retreat_speed=0.03,
        retreat_acceleration=2.5,
        stop_time=0.1,
        joint_speed=0.52,
        joint_acceleration=40.0,
    )
    free = plan()
    slowed, _ = motion.plan_motion(
        loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(), corrections=corrections
    )
    assert slowed.slowed > 1.0
    for moved, keeps in ((free, False), (slowed, True)):
        axis_B = (kinematics.forward(moved.q) @ X_FP)[:, :3, 2]
        twist = np.hstack([0.06 * axis_B, np.zeros_like(axis_B)])
        asked = np.linalg.solve(kinematics.jacobian(moved.q), twist[..., None])[..., 0]
        assert ((np.abs(moved.qd) + np.abs(asked)).max() <= 0.52 + 1e-6) == keeps


def test_a_retreat_that_leaves_nothing_to_the_plan_is_refused_by_its_reason():
    corrections = Corrections(
        pressing_speed=0.06,
        retreat_speed=0.1,
        retreat_acceleration=2.5,
        stop_time=0.1,
        joint_speed=0.1,
        joint_acceleration=40.0,
    )
    with pytest.raises(PlanningError, match="the fastest retreat"):
        motion.plan_motion(
            loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(), corrections=corrections
        )


def test_a_path_that_cannot_be_left_along_the_probes_axis_is_refused_with_its_place(planned):
    arm = KinematicCalibration.nominal()
    planned.require_lift(X_FP, arm)
    far = dataclasses.replace(planned, clearance=1.5)
    with pytest.raises(
        PlanningError, match="0 mm along the path the probe cannot be lifted by 1500 mm"
    ):
        far.require_lift(X_FP, arm)


def test_the_drag_grows_with_the_indentations_power_and_is_linear_between_rows(planned):
    drag_B = np.linspace(0.0, 1.0, len(planned.q))[:, None] * np.array([1.0, -2.0, 0.5])
    dragging = dataclasses.replace(planned, drag_B=drag_B)
    between = 0.75 * drag_B[10] + 0.25 * drag_B[11]
    np.testing.assert_allclose(dragging.drag_at(10.25, 0.004), 0.004**1.5 * between)
    last = float(len(planned.q) - 1)
    np.testing.assert_allclose(dragging.drag_at(last, 0.01), 0.01**1.5 * drag_B[-1])


@pytest.mark.parametrize("indentation", [0.0, -0.02])
def test_off_the_skin_nothing_is_dragged(planned, indentation):
    dragging = dataclasses.replace(planned, drag_B=np.ones((len(planned.q), 3)))
    np.testing.assert_array_equal(dragging.drag_at(3.0, indentation), 0.0)


def test_without_a_model_of_the_tissue_nothing_is_dragged(planned):
    np.testing.assert_array_equal(planned.drag_at(3.0, 0.006), 0.0)


def test_a_stroke_is_turned_to_where_the_last_has_left_the_joints(planned):
    """By whole rotations, and only as far as the joints reach."""
    back = dataclasses.replace(
        planned, q=planned.q[::-1] + 2 * np.pi * np.array([0, 0, 0, 0, 0, 1])
    )
    turned = back.turned(planned.q[-1], np.full(6, 2 * np.pi))
    np.testing.assert_allclose(turned.q[0], planned.q[-1], atol=1e-12)
    assert np.abs(turned.q).max() <= 2 * np.pi
    whole, rows = motion.joined([planned, turned]), len(planned.q)
    assert whole.starts == (0, rows)
    assert whole.lasts == (rows - 1, 2 * rows - 1)
    assert [whole.stroke_of(row) for row in (0, rows - 1, rows)] == [0, 0, 1]
    assert (np.diff(whole.s) >= 0).all()
    assert whole.s[-1] == pytest.approx(2 * planned.s[-1])


def test_a_stroke_of_a_plan_is_begun_on_the_branch_that_the_arm_is_on(planned):
    """From angles of another branch the path is followed on that one."""
    other = planned.q[0] * np.array([1, 1, 1, 1, -1, 1]) + np.pi * np.array([0, 0, 0, 1, 0, 1])
    again, _ = motion.plan_motion(
        loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(), q_before=planned.q[0]
    )
    assert np.abs(np.angle(np.exp(1j * (again.q[0] - planned.q[0])))).max() < 0.2
    flipped, _ = motion.plan_motion(
        loop(), X_FP, PERIOD, FeedrateLimits(), JointPathConfig(), q_before=other
    )
    away = [np.abs(np.angle(np.exp(1j * (plan.q[0] - other)))).sum() for plan in (flipped, planned)]
    assert away[0] <= away[1]
