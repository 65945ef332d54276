"""The motions of programs: how long they take, where they pass, how fast they are on the way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.curves import Circle, Law
from sim.controller.states import Runtime
from tests.sim.controller.programs import START_Q, refusal, run_to_end

SIDE = 0.1
"""Of the square that is driven round [m]."""
CORNERS = np.array([[0.0, SIDE, 0.0], [SIDE, SIDE, 0.0], [SIDE, 0.0, 0.0]])
MOVEL_V, MOVEL_A = 0.25, 1.2
"""The manual's defaults [m/s, m/s^2]."""


@pytest.fixture
def p_start_B(controller):
    return controller.tool_pose(START_Q)[:3, 3]


def moved(by):
    """A line of a program, and the name of the pose moved by so much [m]."""
    return "pose_add(home, p[{}, {}, {}, 0, 0, 0])".format(*by)


def square(call, last="r=0"):
    """Round the square with the waypoints blended."""
    lines = ["home = get_target_tcp_pose()"]
    lines += [call.format(moved(corner)) for corner in CORNERS]
    return "\n".join([*lines, call.format("home").rpartition(",")[0] + f", {last})"])


@given(
    length=st.floats(1e-3, 2.0),
    speed=st.floats(1e-2, 3.0),
    acceleration=st.floats(0.05, 10.0),
    start=st.floats(0.0, 3.0),
)
@settings(max_examples=200, deadline=None)
def test_the_law_covers_its_length_within_its_acceleration(length, speed, acceleration, start):
    law = Law(length, speed, acceleration, start)
    t = np.linspace(0.0, law.duration, 400)
    distance, v = (np.array([f(x) for x in t]) for f in (law.distance, law.speed))
    assert distance[0] == pytest.approx(0.0, abs=1e-12)
    assert distance[-1] == pytest.approx(length)
    assert v[0] == pytest.approx(start, abs=1e-9)
    assert v[-1] == pytest.approx(0.0, abs=1e-9)
    assert v.max() <= max(speed, start) * (1 + 1e-9)
    assert np.abs(np.diff(v) / np.diff(t)).max() <= law.acceleration * (1 + 1e-6)
    between = np.abs(np.diff(distance) / np.diff(t) - (v[1:] + v[:-1]) / 2)
    assert (between <= law.acceleration * np.diff(t) + 1e-9 * max(speed, start)).all()


@given(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
@settings(max_examples=100, deadline=None)
def test_a_circle_passes_its_points_in_their_order(numbers):
    a, b, c = np.array(numbers).reshape(3, 3)
    area = np.linalg.norm(np.cross(b - a, c - a))
    if area < 1e-3:
        return
    circle = Circle.through(a, b, c)
    np.testing.assert_allclose(circle.point(0.0), a, atol=1e-9)
    np.testing.assert_allclose(circle.point(1.0), c, atol=1e-9)
    on_the_way = [np.linalg.norm(circle.point(f) - b) for f in np.linspace(0, 1, 2000)]
    assert min(on_the_way) < circle.radius * 2 * np.pi / 2000


@pytest.mark.parametrize(
    ("call", "seconds"),
    [
        ("movel({}, t=2)", 2.0),
        ("movel({}, a=1.2, v=0.25, t=0.8)", 0.8),
        ("movel({})", SIDE / MOVEL_V + MOVEL_V / MOVEL_A),
        ("movej({}, t=1.5)", 1.5),
        ("movep({})", SIDE / MOVEL_V + MOVEL_V / MOVEL_A),
    ],
)
def test_a_move_takes_its_time_and_arrives(controller, p_start_B, call, seconds):
    program = f"home = get_target_tcp_pose()\n{call.format(moved((0, SIDE, 0)))}"
    course = run_to_end(controller, program)
    assert course.t == pytest.approx(seconds, abs=2 * PERIOD)
    np.testing.assert_allclose(course.p_B[-1] - p_start_B, [0, SIDE, 0], atol=1e-6)


def test_half_the_slider_is_twice_the_time(controller):
    controller.inputs["speed_slider_mask"] = 1
    controller.inputs["speed_slider_fraction"] = 0.5
    for _ in range(100):
        controller.cycle()
    body = f"home = get_target_tcp_pose()\nmovel({moved((0, SIDE, 0))}, t=1)"
    assert run_to_end(controller, body).t == pytest.approx(2.0, abs=2 * PERIOD)


@pytest.mark.parametrize("r", [0.005, 0.03])
@pytest.mark.parametrize(
    "call", ["movel({}, r=%g)", "movep({}, r=%g)", "movej({}, a=2, v=0.5, r=%g)"]
)
def test_a_blend_passes_within_its_radius_and_never_stops(controller, p_start_B, call, r):
    course = run_to_end(controller, square(call % r))
    way = course.p_B - p_start_B
    ramp = 125
    for corner in CORNERS:
        distance = np.linalg.norm(way - corner, axis=1)
        assert 0.1 * r < distance.min() < r
    assert course.speed[ramp:-ramp].min() > 0.06
    np.testing.assert_allclose(way[-1], 0.0, atol=1e-6)
    # outside of the blends the tool is on the lines between the waypoints
    if "movej" not in call:
        inside = np.array([np.linalg.norm(way - corner, axis=1) < r for corner in CORNERS]).any(0)
        beside = np.minimum(np.abs(way[:, :2]), np.abs(way[:, :2] - SIDE)).min(axis=1)
        assert beside[~inside].max() < 1e-6
        assert np.abs(way[:, 2]).max() < 1e-4


def test_movep_keeps_the_tools_speed_through_the_corners(controller):
    course = run_to_end(controller, square("movep({}, r=0.02)"))
    ramp = round((MOVEL_V / MOVEL_A + 2 * PERIOD) / PERIOD)
    np.testing.assert_allclose(course.speed[ramp:-ramp], MOVEL_V, rtol=0.02)


def test_a_blend_accelerates_no_harder_than_the_moves_by_half(controller):
    course = run_to_end(controller, square("movel({}, r=0.01)"))
    change = np.linalg.norm(np.diff(course.v_B, axis=0), axis=1) / PERIOD
    assert change.max() < 1.5 * MOVEL_A


def test_a_blend_into_nothing_ends_at_its_waypoint(controller, p_start_B):
    program = f"home = get_target_tcp_pose()\nmovel({moved((0, SIDE, 0))}, r=0.03)\nsleep(1)"
    course = run_to_end(controller, program)
    np.testing.assert_allclose(course.p_B[-1] - p_start_B, [0, SIDE, 0], atol=1e-6)


def test_blends_that_overlap_are_told_and_cut(controller, p_start_B):
    course = run_to_end(controller, square("movel({}, r=0.2)"))
    assert any("Overlapping Blends" in message.text for message in controller.messages)
    assert course.speed[125:-125].min() > 0.06
    np.testing.assert_allclose(course.p_B[-1], p_start_B, atol=1e-6)


def test_a_blend_goes_from_a_line_of_the_joints_into_one_in_space(controller, p_start_B):
    program = f"home = get_target_tcp_pose()\nmovej({moved((0, SIDE, 0))}, r=0.02)\n"
    course = run_to_end(
        controller, f"{program}movel({moved((SIDE, SIDE, 0))}, r=0.02)\nmovej(home)"
    )
    way = course.p_B - p_start_B
    for corner in CORNERS[:2]:
        assert np.linalg.norm(way - corner, axis=1).min() < 0.02
    assert course.speed[125:-125].min() > 0.03
    np.testing.assert_allclose(way[-1], 0.0, atol=1e-6)


def test_a_paused_blend_goes_on_to_its_waypoint(controller, p_start_B):
    periods = 0

    def pause_once():
        nonlocal periods
        periods += 1
        if periods == 250:
            controller.pause()
            for _ in range(500):
                controller.cycle()
            assert np.abs(controller.robot.commanded[1]).max() == 0
            assert controller.resume()

    course = run_to_end(controller, square("movel({}, r=0.02)"), every_period=pause_once)
    np.testing.assert_allclose(course.p_B[-1], p_start_B, atol=1e-6)
    assert controller.runtime is Runtime.STOPPED


@pytest.mark.parametrize("mode", [0, 1])
def test_a_circle_is_one_to_a_twentieth_of_a_millimetre(controller, p_start_B, mode):
    radius = 0.05
    via, to = moved((radius, radius, 0)), moved((2 * radius, 0, 0))
    program = f"home = get_target_tcp_pose()\nmovec({via}, {to}, v=0.05, mode={mode})"
    course = run_to_end(controller, program)
    from_centre = course.p_B - p_start_B - [radius, 0, 0]
    assert np.abs(np.linalg.norm(from_centre, axis=1) - radius).max() < 5e-5
    assert from_centre[:, 1].max() == pytest.approx(radius, abs=5e-5)
    np.testing.assert_allclose(from_centre[-1], [radius, 0, 0], atol=1e-6)
    assert course.speed.max() == pytest.approx(0.05, rel=2e-3)
    assert course.t == pytest.approx(np.pi * radius / 0.05 + 0.05 / MOVEL_A, abs=2 * PERIOD)
    R_start, R_end = controller.tool_pose(START_Q)[:3, :3], course.X_BT[-1, :3, :3]
    half_turn = np.diag([-1.0, -1.0, 1.0])
    expected = R_start if mode == 0 else half_turn @ R_start
    np.testing.assert_allclose(R_end, expected, atol=1e-6)


def test_no_circle_passes_three_points_on_a_line(controller):
    body = f"home = get_target_tcp_pose()\nmovec({moved((0, 0.05, 0))}, {moved((0, 0.1, 0))})"
    assert "lie on a line" in refusal(controller, body)


def test_stopl_stops_the_tool_on_its_line(controller, p_start_B):
    course = run_to_end(controller, "speedl([0, 0.2, 0, 0, 0, 0], 1.0)\nstopl(0.5)")
    way = course.p_B - p_start_B
    ramps = 0.2**2 / 2 / 1.0 + 0.2**2 / 2 / 0.5
    np.testing.assert_allclose(way[-1], [0, ramps, 0], atol=2e-3)
    assert np.abs(way[:, [0, 2]]).max() < 2e-3  # the ramps of speedl drift that much
    assert course.t == pytest.approx(0.2 / 1.0 + 0.2 / 0.5, abs=5 * PERIOD)
    assert np.abs(controller.robot.commanded[1]).max() < 1e-6


def test_the_waypoint_is_the_moves_whatever_the_arm_does_before(controller, p_start_B):
    body = (
        "thread t():\nsleep(0.1)\nw = get_target_waypoint()\nwrite_output_float_register(0, w[1])\n"
        "end\nhome = get_target_tcp_pose()\nx = run t()\n"
    )
    run_to_end(controller, f"{body}movel({moved((0, SIDE, 0))}, t=1)")
    assert controller.out_doubles[0] - p_start_B[1] == pytest.approx(SIDE, abs=1e-6)


@pytest.mark.parametrize("call", ["movej({}, a=0)", "movel({}, v=-1)", "movep({}, a=0, v=1)"])
def test_a_move_without_a_speed_or_a_time_is_refused(controller, call):
    assert "positive a and v" in refusal(controller, call.format("get_target_tcp_pose()"))


def test_shares_of_what_the_joints_can_do(controller):
    body = "q = get_target_joint_positions()\nq[5] = q[5] + 1\n"
    half = run_to_end(controller, f"{body}optimovej(q, a=0.5, v=0.5)").t
    assert half == pytest.approx(1 / (np.pi / 2) + (np.pi / 2) / 7, abs=2 * PERIOD)
    fast = run_to_end(controller, "x = get_target_tcp_pose()\nx[1] = x[1] + 0.2\noptimovel(x, v=1)")
    slow = run_to_end(controller, "x = get_target_tcp_pose()\nx[1] = x[1] - 0.2\noptimovel(x)")
    assert fast.t < slow.t
