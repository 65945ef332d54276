"""Freedrive, torques of the drives, and what the controller tells of its arm's dynamics."""

import json

import numpy as np
import pytest

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.config import ControllerConfig
from sim.controller.fault_injection import FaultInjector
from sim.controller.freedrive import DRY, VISCOUS
from sim.controller.motion import between
from sim.controller.outputs import Outputs
from sim.controller.states import Safety
from sim.scene import HOME_Q
from sim.wrist.probe import payload
from tests.sim.controller.programs import switched_on

PUSH = np.array([20.0, 15.0, -10.0])
"""Of a hand [N]."""


@pytest.fixture
def controller(quiet_scene):
    return controller_of(quiet_scene, "5.25")


def controller_of(scene, version):
    return switched_on(scene, HOME_Q, config=ControllerConfig(version=version))


def run(controller, body, seconds):
    controller.run(f"def main():\n{body}\nend")
    pass_time(controller, seconds)


def pass_time(controller, seconds):
    for _ in range(round(seconds / PERIOD)):
        controller.cycle()
    assert not controller.program_error


def tool(controller):
    return controller.tool_pose(controller.state.q)


def test_a_push_moves_the_free_axis_alone_and_friction_brings_it_to_rest(controller):
    run(controller, "freedrive_mode([1,0,0,0,0,0], p[0,0,0,0,0,0])\nsleep(99)", 0.1)
    assert controller.freedrive
    X = tool(controller)
    controller.robot.push(PUSH, 0.5)
    pass_time(controller, 0.6)
    pass_time(controller, 1.4)
    went = between(X, tool(controller))
    assert went[0] > 0.02
    np.testing.assert_allclose(went[1:], 0.0, atol=5e-4)
    assert np.abs(controller.state.qd).max() < 1e-4


def test_a_hand_at_the_control_port_is_felt_for_so_long_and_no_longer(controller):
    faults = FaultInjector(controller, Outputs(controller), lambda: None)
    push = {"do": "push", "fx": 3.0, "fy": -4.0, "fz": 12.0, "seconds": 0.1}
    assert json.loads(faults.answer(json.dumps(push)))["ok"]
    pass_time(controller, 0.1)
    np.testing.assert_allclose(controller.tool_wrench_B()[:3], [3.0, -4.0, 12.0], atol=0.1)
    pass_time(controller, 0.3)
    np.testing.assert_allclose(controller.tool_wrench_B(), 0.0, atol=0.01)
    for broken in (push | {"fx": "1"}, push | {"mass": 1.0}, {"do": "push"}):
        assert not json.loads(faults.answer(json.dumps(broken)))["ok"]


def test_the_axes_are_those_of_the_feature(controller):
    x_up = "p[0,0,0,0,-1.5707963,0]"
    run(controller, f"freedrive_mode([1,0,0,0,0,0], {x_up})\nsleep(99)", 0.1)
    X = tool(controller)
    controller.robot.push(3 * PUSH, 0.4)
    pass_time(controller, 0.8)
    went = between(X, tool(controller))
    assert went[2] < -0.01
    np.testing.assert_allclose(np.delete(went, 2), 0.0, atol=1e-3)


def test_let_go_the_arm_loses_its_energy_and_held_again_it_stays(controller):
    run(controller, "teach_mode()\nsleep(1)\nend_teach_mode()\nsleep(99)", 0.1)
    robot = controller.robot
    robot.push(PUSH, 0.15)
    pass_time(controller, 0.17)
    energy = []
    while controller.freedrive:
        controller.cycle()
        energy.append(controller.state.qd @ robot.mass_matrix() @ controller.state.qd / 2)
    assert energy[0] > 0.01
    assert (np.diff(energy) < 1e-9).all()
    pass_time(controller, 0.5)
    q = controller.state.q
    robot.push(PUSH, 0.3)
    pass_time(controller, 0.8)
    assert np.abs(controller.state.q - q).max() < 1e-3
    assert controller.safety is Safety.NORMAL


def test_with_its_payload_right_it_floats_and_with_a_wrong_one_it_drifts(controller, quiet_scene):
    true = payload(quiet_scene.config.mount_angle)
    at = [round(x, 6) for x in true.centre_F.tolist()]
    run(controller, "freedrive_mode()\nsleep(99)", 0.5)
    np.testing.assert_allclose(controller.state.q, HOME_Q, atol=1e-5)
    run(controller, f"freedrive_mode()\nset_payload({true.mass + 0.05}, {at})\nsleep(99)", 0.5)
    np.testing.assert_allclose(controller.state.q, HOME_Q, atol=5e-4)  # friction holds 50 g
    z = tool(controller)[2, 3]
    run(controller, f"freedrive_mode()\nset_payload({true.mass + 1.5}, {at})\nsleep(99)", 0.5)
    risen = tool(controller)[2, 3]
    run(controller, f"freedrive_mode()\nset_payload(0, {at})\nsleep(99)", 0.0)
    controller.robot.push(np.array([0.0, 0.0, -10.0]), 0.5)
    pass_time(controller, 0.5)
    assert risen > z + 0.01
    assert controller.safety is Safety.NORMAL


def test_a_wrong_payload_reads_as_its_weight_in_any_posture(controller, quiet_scene):
    true = payload(quiet_scene.config.mount_angle)
    at = true.centre_F.tolist()
    for q in (HOME_Q, HOME_Q + np.array([0.2, 0.1, -0.3, 0.8, 0.5, 1.0])):
        run(controller, f"set_payload({true.mass}, {at})\nmovej({q.tolist()}, 2, 1)", 2.5)
        right_B = controller.tool_wrench_B()[:3]
        run(controller, f"set_payload({true.mass + 0.5}, {at})", 0.01)
        change_B = controller.tool_wrench_B()[:3] - right_B
        np.testing.assert_allclose(change_B, [0.0, 0.0, 0.5 * 9.80665], atol=1e-3)


def test_a_payload_that_changes_over_a_time_changes_evenly(controller, quiet_scene):
    true = payload(quiet_scene.config.mount_angle)
    at, inertia = true.centre_F.tolist(), [0.0] * 6
    call = f"set_target_payload({true.mass + 1.0}, {at}, {inertia}, transition_time=0.4)"
    run(controller, call + "\nsleep(9)", 0.202)
    assert controller.tool_wrench_B()[2] == pytest.approx(0.5 * 9.80665, rel=0.02)
    pass_time(controller, 0.3)
    assert controller.payload.mass == true.mass + 1.0
    assert controller.tool_wrench_B()[2] == pytest.approx(9.80665, rel=1e-3)


def test_status_tells_of_singular_postures_where_axes_are_held(controller):
    ask = "write_output_integer_register(0, get_freedrive_status())\nsleep(99)"
    stretched = [0.0, -1.5, 0.0, -1.5, 1.5, 0.0]
    run(controller, f"freedrive_mode([1,1,1,0,0,0])\n{ask}", 0.1)
    assert controller.out_ints[0] == 0
    run(controller, f"movej({stretched}, 3, 2)\nfreedrive_mode([1,1,1,0,0,0])\n{ask}", 3.0)
    assert controller.out_ints[0] == 2
    run(controller, f"freedrive_mode()\n{ask}", 0.1)
    assert controller.out_ints[0] == 0


TORQUE = "while True:\ndirect_torque([0, 0, 0, 0, 0, {}], friction_comp={})\nend"


def test_a_torque_accelerates_a_joint_against_its_friction(controller):
    """Inertia M, viscous friction c and dry friction d: (t - d) / c (1 - exp(-c time / M))."""
    time, torque = 0.1, 2.0
    inertia = controller.robot.mass_matrix()[5, 5]
    run(controller, TORQUE.format(torque, False), time)
    speed = (torque - DRY[5]) / VISCOUS[5] * (1 - np.exp(-VISCOUS[5] * time / inertia))
    assert controller.robot.commanded[1][5] == pytest.approx(speed, rel=0.02)
    np.testing.assert_allclose(controller.robot.commanded[0][:3], HOME_Q[:3], atol=1e-3)


def test_friction_that_the_drives_make_up_for_lets_it_go_faster(controller, quiet_scene):
    run(controller, TORQUE.format(2.0, True), 0.2)
    slow = controller_of(quiet_scene, "5.25")
    run(slow, TORQUE.format(2.0, False), 0.2)
    assert controller.robot.commanded[1][5] > 1.5 * slow.robot.commanded[1][5]


def test_torques_that_are_no_longer_asked_for_end_in_a_hold(controller):
    once = "i = 0\nwhile i < 50:\ndirect_torque([0,0,0,0,0,2])\ni = i + 1\nend\nsleep(99)"
    run(controller, once, 0.1)
    assert controller.robot.commanded[1][5] > 0.5
    pass_time(controller, 0.3)
    q = controller.robot.commanded[0]
    controller.robot.push(PUSH, 0.2)
    pass_time(controller, 0.4)
    np.testing.assert_allclose(controller.robot.commanded[0], q, atol=1e-12)
    np.testing.assert_allclose(controller.state.q, q, atol=1e-3)


def test_torques_that_make_a_joint_too_fast_are_stopped(controller):
    run(controller, TORQUE.format(28.0, True), 1.0)
    assert controller.safety is Safety.PROTECTIVE_STOP
    assert np.abs(controller.robot.commanded[1]).max() < 1e-9


@pytest.mark.parametrize(
    ("version", "call", "known"),
    [
        ("5.22", "direct_torque([0,0,0,0,0,0])", False),
        ("5.25", "direct_torque([0,0,0,0,0,0])", True),
        ("5.25", "direct_torque([0,0,0,0,0,0], viscous_scale=[1,1,1,1,1,1])", False),
        ("5.26", "direct_torque([0,0,0,0,0,0], viscous_scale=[1,1,1,1,1,1])", True),
        ("10.11", "direct_torque([0,0,0,0,0,0])", True),
    ],
)
def test_versions_without_torques_or_their_scales_refuse_them(quiet_scene, version, call, known):
    controller = controller_of(quiet_scene, version)
    controller.run(f"def main():\n{call}\nend")
    for _ in range(3):
        controller.cycle()
    assert bool(controller.program_error) is not known
    assert known or "direct_torque" in controller.program_error


@pytest.fixture
def moving():
    """Joint angles and speeds that the arm is not at."""
    rng = np.random.default_rng(1)
    return HOME_Q + rng.uniform(-0.5, 0.5, 6), rng.uniform(-1, 1, 6)


def asked(controller, call):
    """What a function gives, by its row."""
    name, *arguments = call
    function = controller.functions[name]
    defaults = [p.default for p in function.parameters[len(arguments) :]]
    return np.array(function.call(*arguments, *defaults))


def test_velocity_torques_do_the_work_that_changes_the_mass_matrix(controller, moving):
    """qd^T C qd is half the rate of qd^T M qd at constant qd, for any arm."""
    q, qd = moving
    step = 1e-6
    ahead, behind = (asked(controller, ("get_mass_matrix", q + s * qd)) for s in (step, -step))
    power = qd @ asked(controller, ("get_coriolis_and_centrifugal_torques", q, qd))
    assert abs(power) > 0.01
    assert power == pytest.approx(qd @ (ahead - behind) @ qd / (4 * step), rel=1e-5)


def test_the_mass_matrix_is_of_the_angles_given_and_leaves_rotors_out_if_told(controller, moving):
    q, _ = moving
    now, there = (asked(controller, ("get_mass_matrix", *at)) for at in ((), (q,)))
    np.testing.assert_allclose(now, controller.robot.mass_matrix(), atol=1e-9)
    assert np.abs(there - now).max() > 0.05
    bare = asked(controller, ("get_mass_matrix", q, False))
    rotors = np.diag(there - bare)
    assert (rotors > 0.1).all()
    np.testing.assert_allclose(there - bare, np.diag(rotors), atol=1e-12)


def test_the_jacobian_s_derivative_is_that_along_the_motion(controller, moving):
    q, qd = moving
    step = 1e-4
    ahead, here = (asked(controller, ("get_jacobian", q + s * qd)) for s in (step, 0.0))
    derivative = asked(controller, ("get_jacobian_time_derivative", q, qd))
    np.testing.assert_allclose(derivative, (ahead - here) / step, atol=1e-3)
    assert np.abs(derivative).max() > 0.1
