"""The controller without its sockets: what it does to the arm, whatever a program wants."""

import numpy as np
import pytest

from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD, SPEED_LIMIT
from sim.controller.messages import ProgramError
from sim.controller.states import Runtime, Safety
from sim.scene import HOME_Q
from tests.sim.controller.programs import switched_on


@pytest.fixture
def controller(scene):
    return switched_on(scene, HOME_Q)


def run(controller, body, seconds):
    """Run a program for so long; the highest speed of a joint that was commanded [rad/s]."""
    controller.run(f"def main():\n{body}\nend")
    fastest = 0.0
    for _ in range(round(seconds / PERIOD)):
        controller.cycle()
        fastest = max(fastest, float(np.abs(controller.robot.commanded[1]).max()))
    assert not controller.program_error
    return fastest


PUMP = """
q0 = get_target_joint_positions()
c = q0[5] - 0.3
t = q0
t[5] = c
while True:
  q = get_target_joint_positions()
  qd = get_target_joint_speeds()
  if (q[5] - c + 0.034 * qd[5]) * qd[5] < 0:
    servoj(t, 0, 0, 0.002, 0.03, 2000)
  else:
    servoj(t, 0, 0, 0.002, 0.03, 100)
  end
end
"""
"""Swings the servo up by its gain, while its target stands still."""


def test_a_servo_that_is_pumped_up_is_stopped_before_it_is_much_too_fast(controller):
    assert SPEED_LIMIT < run(controller, PUMP, 5.0) < 1.2 * SPEED_LIMIT
    assert controller.safety is Safety.PROTECTIVE_STOP
    assert np.abs(controller.robot.commanded[1]).max() == 0


def test_nothing_moves_the_arm_during_a_protective_stop(controller):
    body = (
        "thread t():\nwhile True:\nspeedj([0, 0, 0, 0, 0, 0.5], 2, 0.002)\nend\nend\nx = run "
        "t()\nsleep(0.1)\n"
    )
    run(controller, body + "protective_stop()\nspeedj([0, 0, 0, 0, 0, 0.5], 2, 1)", 0.3)
    assert controller.safety is Safety.PROTECTIVE_STOP
    assert controller.runtime is Runtime.PAUSED
    before = controller.robot.commanded[0].copy()
    run(controller, "say_nothing = 1", 1.0)
    assert np.abs(controller.robot.commanded[0] - before).max() < 1e-12


def test_a_speed_lasts_longer_where_the_arm_is_slowed_down(controller):
    body = "i = 0\nwhile i < 500:\nspeedj([0, 0, 0, 0, 0, -0.5], 1000, 0.002)\ni = i + 1\nend"
    moved = []
    for slider in (1.0, 0.5):
        controller.slider = controller.scaling = slider
        before = controller.robot.commanded[0][5]
        run(controller, body, 1.5 / slider)
        moved.append(controller.robot.commanded[0][5] - before)
    assert moved == pytest.approx([-0.5, -0.5], abs=0.02)


def test_a_time_that_is_too_short_is_stretched_and_what_is_out_of_reach_stops(controller):
    assert run(controller, "q = get_target_joint_positions()\nq[5] = q[5] - 1\n"
               "movej(q, t=0.01)", 2.0) <= SPEED_LIMIT  # fmt: skip
    assert controller.safety is Safety.NORMAL
    run(controller, "movel(p[10, 0, 0, 0, 0, 0])", 5.0)
    assert controller.safety is Safety.PROTECTIVE_STOP
    controller.run("set unlock protective stop")
    assert controller.safety is Safety.NORMAL


def test_a_secondary_program_can_stop_the_arm_and_nothing_that_takes_time_follows(controller):
    run(controller, "protective_stop()\nsync()\nwrite_output_integer_register(0, 1)", 0.1)
    assert controller.runtime is Runtime.PAUSED
    assert controller.out_ints[0] == 0
    for _ in range(round(5.0 / PERIOD)):
        controller.cycle()
    assert controller.unlock()
    assert controller.resume()
    controller.run("sec stop():\nprotective_stop()\nend")
    for _ in range(10):
        controller.cycle()
    assert controller.safety is Safety.PROTECTIVE_STOP


def test_a_joint_is_stopped_at_the_end_of_its_range_and_may_come_back(controller):
    run(controller, "speedj([0, 0, 0, 0, 0, 2], 10, 10)", 6.0)
    assert controller.safety is Safety.PROTECTIVE_STOP
    assert np.abs(controller.robot.commanded[0]).max() < ANGLE_LIMIT + 0.1
    for _ in range(round(5.0 / PERIOD)):
        controller.cycle()
    assert controller.unlock()
    run(controller, "speedj([0, 0, 0, 0, 0, -1], 10, 10)", 2.0)
    assert controller.safety is Safety.NORMAL
    assert np.abs(controller.robot.commanded[0]).max() < ANGLE_LIMIT


@pytest.mark.parametrize(
    "motion",
    [
        "speedj([9, 0, 0, 0, 0, 0], 1e5, 1)",
        "movej([0, -1.5, 1.5, -1.5, -1.5, 0], a=1e300, v=1e300)",
        "movej([0, -1.5, 1.5, -1.5, -1.5, 0], a=1e-300, v=1e-300)",
        "speedl([9, 0, 0, 0, 0, 0], 1e300, 1)",
        "speedl([0, 0, 0, 1e6, 1e6, 1e6], 1e300, 1)",
        # through the axis of the base
        "x = get_actual_tcp_pose()\nx[0] = -x[0]\nx[1] = -x[1]\nmovel(x, 10, 2)",
        "set_tcp(p[1e6, 1e6, 1e6, 1, 2, 3])\nspeedl([1, 0, 0, 1, 0, 0], 10, 1)",
        "stopj(1e300)",
        "stopj(-1)",
    ],
)
def test_no_motion_is_faster_than_the_joints_are(controller, motion):
    assert run(controller, motion, 1.5) <= 1.05 * SPEED_LIMIT + 1e-9
    assert controller.safety in (Safety.NORMAL, Safety.PROTECTIVE_STOP)
    assert np.isfinite(controller.state.q).all()


def test_a_simulation_that_has_failed_leaves_the_controller_there_and_told(controller):
    controller.robot._data.qvel[:] = np.nan
    for _ in range(10):
        controller.cycle()
    assert controller.safety is Safety.FAULT
    assert np.isfinite(controller.state.q).all()
    assert controller.time == pytest.approx(0.02)


def errors(controller):
    told = [message for message in controller.messages if isinstance(message, ProgramError)]
    controller.messages.clear()
    return [(message.line, message.column, message.text) for message in told]


def cycles(controller, count=20):
    for _ in range(count):
        controller.cycle()


def test_a_secondary_program_runs_beside_the_primary_one_and_cannot_end_it(controller):
    """[UR-script, "Secondary Programs"]"""
    controller.run("def main():\n while True:\n sync()\n end\nend")
    cycles(controller)
    primary = controller.program
    controller.run("sec a():\n write_output_integer_register(3, 7)\nend")
    cycles(controller)
    assert controller.out_ints[3] == 7
    assert controller.program is primary
    assert controller.runtime is Runtime.PLAYING
    for wrong, line, column in (
        ("sec b():\n  x = 1 / 0\nend", 2, 3),
        ("sec c():\n while True:\n end\nend", 1, 1),
        ("sec d():\n  sleep(1)\nend", 2, 3),
    ):
        controller.run(wrong)
        cycles(controller)
        ((told_line, told_column, _),) = errors(controller)
        assert (told_line, told_column) == (line, column)
    assert controller.program is primary
    assert not controller.program_error.startswith("line 2: division")


def test_a_program_is_replaced_by_the_next_and_not_by_what_is_none(controller):
    """A call of the program behind its end is an error that a controller tells, and no more."""
    controller.run("def first():\n  while True:\n    sync()\n  end\nend")
    controller.run("first()")
    cycles(controller)
    assert controller.program.name == "first"
    assert errors(controller) == [(1, 1, "compile_error_name_not_found:first:")]
    controller.run("write_output_integer_register(4, 9)")
    cycles(controller)
    assert controller.out_ints[4] == 9
    assert controller.program is None


def test_an_error_is_told_with_the_place_of_its_statement(controller):
    controller.run("def main():\n  x = 0\n    y = 1 / x\nend")
    cycles(controller)
    ((line, column, text),) = errors(controller)
    assert (line, column) == (3, 5)
    assert "division" in text
