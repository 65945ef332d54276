"""Force mode by its physics: newtons, millimetres and seconds, in the air, on a spring and on the
phantom.
"""

import json
from functools import lru_cache

import numpy as np
import pytest

from breastscan.geometry import se3
from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.force_mode import MASS
from sim.controller.states import Runtime, Safety
from sim.scene import HOME_Q
from sim.tissue.phantom import Phantom, PhantomConfig
from sim.tissue.soft import SoftTissue
from tests.sim.controller.programs import switched_on
from tests.sim.controller.served import address, client, served
from tests.sim.tissue.closed_form_tissue import SpringTissue
from tests.sim.tissue.press_poses import loop_pose

DAMPING, GAIN = 0.025, 0.5
"""What clients set: ur_rtde at its start, the ROS driver by default."""
SETTINGS = f"force_mode_set_damping({DAMPING})\nforce_mode_set_gain_scaling({GAIN})\n"
STIFFNESS = 1500.0
"""Of the spring [N/m]."""


@pytest.fixture
def controller(quiet_scene):
    return switched_on(quiet_scene, HOME_Q)


def begin(controller, body):
    controller.run(f"def main():\n{SETTINGS}{body}\nend")


def pass_time(controller, seconds, look=lambda: None):
    """What `look` saw in each period."""
    seen = []
    for _ in range(round(seconds / PERIOD)):
        controller.cycle()
        seen.append(look())
    assert not controller.program_error
    return np.array(seen)


def tool(controller):
    return controller.tool_pose(controller.robot.commanded[0])


def velocity(controller):
    return controller.tool_speed(*controller.robot.commanded)


def force_mode(axis, force, kind=2, frame="p[0,0,0,0,0,0]", limits=(1,) * 6):
    one = [int(i == axis) for i in range(6)]
    return f"force_mode({frame}, {one}, {[force * i for i in one]}, {kind}, {list(limits)})\n"


def test_in_the_air_the_tool_settles_at_the_speed_where_damping_takes_what_the_force_gives(
    controller,
):
    begin(controller, force_mode(2, 5.0) + "sleep(9)")
    seen = pass_time(controller, 0.6, lambda: velocity(controller))
    terminal = GAIN * 5.0 * PERIOD / (DAMPING * MASS)
    assert seen[-1, 2] == pytest.approx(terminal, rel=0.02)
    assert np.abs(np.delete(seen, 2, axis=1)).max() < 0.01 * terminal


def test_the_speed_along_a_compliant_axis_stays_within_its_limit(controller):
    limits = (1, 1, 0.004, 1, 1, 1)
    begin(controller, force_mode(2, 40.0, limits=limits) + "sleep(9)")
    seen = pass_time(controller, 0.5, lambda: velocity(controller)[2])
    assert 0.0039 < seen[-1] <= seen.max() < 0.00401


def test_without_damping_a_speed_is_kept_and_with_full_damping_it_is_gone_in_a_period(controller):
    begin(
        controller,
        "force_mode_set_damping(0)\n" + force_mode(2, 5.0) + "sleep(0.2)\n" + force_mode(2, 0.0)
        + "sleep(0.2)\nforce_mode_set_damping(1)\nsleep(9)",
    )  # fmt: skip
    pass_time(controller, 0.21)
    kept = pass_time(controller, 0.15, lambda: velocity(controller)[2])
    assert kept.min() > 0.009
    assert np.ptp(kept) < 0.02 * kept.max()
    pass_time(controller, 0.1)
    assert abs(velocity(controller)[2]) < 1e-4


def test_the_wrench_is_what_the_robot_does_to_a_spring_in_the_axes_of_the_task_frame(quiet_scene):
    level = (se3.inverse(quiet_scene.X_BS) @ tip(quiet_scene))[2, 3]
    controller = switched_on(quiet_scene, HOME_Q, SpringTissue(level - 0.002, STIFFNESS))
    turned = "p[0.2, 0.1, 0.3, 3.14159265, 0, 0]"  # z down
    begin(controller, "zero_ftsensor()\n" + force_mode(2, 8.0, frame=turned) + "sleep(9)")
    pass_time(controller, 3.0)
    assert controller.robot.contact.force_S[2] == pytest.approx(8.0, abs=0.05)
    assert controller.tool_wrench_B()[2] == pytest.approx(8.0, abs=0.05)
    assert tool(controller)[2, 3] < tip(quiet_scene)[2, 3] - 0.002


def tip(scene):
    return scene.calibration.forward(HOME_Q) @ scene.X_FP


@lru_cache(maxsize=1)
def tissue():
    return SoftTissue.build(Phantom(PhantomConfig()))


@pytest.fixture
def over_skin(quiet_scene):
    """The probe 2 mm over the flank of the phantom of 30 kPa, square to it."""
    tissue().reset()
    X_BP = quiet_scene.X_BS @ loop_pose(quiet_scene.phantom, np.pi / 2, -0.002)
    arm = quiet_scene.calibration
    solutions = arm.inverse(X_BP @ se3.inverse(quiet_scene.X_FP))
    nearest = np.abs(solutions - HOME_Q).max(axis=1).argmin()
    return switched_on(quiet_scene, solutions[nearest], tissue())


def pressing(controller):
    """True force along the probe's axis [N]."""
    R_SP = (se3.inverse(controller.robot._X_BS) @ tool(controller))[:3, :3]
    return -float(controller.robot.contact.force_S @ R_SP[:, 2])


def test_on_the_phantom_the_error_of_the_force_is_the_damper_s_while_a_movel_slides_over_it(
    over_skin,
):
    """At rest 5 N, and where the skin rises, m damping / (gain T) times the speed of yielding."""
    slide = "movel(pose_trans(get_target_tcp_pose(), p[0.02, 0, 0, 0, 0, 0]), 0.5, 0.01)\n"
    press = "zero_ftsensor()\n" + force_mode(2, 5.0, frame="get_actual_tcp_pose()")
    begin(over_skin, f"{press}sleep(2)\nwrite_output_integer_register(0, 1)\n{slide}sleep(9)")
    pass_time(over_skin, 1.95)
    X_start = tool(over_skin)
    assert pressing(over_skin) == pytest.approx(5.0, abs=0.1)
    forward_P = lambda: velocity(over_skin)[:3] @ tool(over_skin)[:3, 2]  # noqa: E731
    seen = pass_time(over_skin, 2.6, lambda: (pressing(over_skin), forward_P()))
    assert over_skin.out_ints[0] == 1
    damper, bias = np.polyfit(seen[:, 1], seen[:, 0] - 5.0, 1)
    assert damper == pytest.approx(-DAMPING * MASS / (GAIN * PERIOD), rel=0.05)
    assert abs(bias) < 0.02
    went_P = (se3.inverse(X_start) @ tool(over_skin))[:3, 3]
    np.testing.assert_allclose(went_P[:2], [0.02, 0.0], atol=1e-5)


def test_a_softer_and_a_harder_hand_come_to_rest_on_it_as_well(over_skin):
    """The maker's own defaults, which damp little."""
    press = "zero_ftsensor()\n" + force_mode(2, 5.0, frame="get_actual_tcp_pose()")
    over_skin.run(f"def main():\n{press}sleep(9)\nend")
    pass_time(over_skin, 3.0)
    seen = pass_time(over_skin, 1.0, lambda: pressing(over_skin))
    assert np.abs(seen - 5.0).max() < 0.5


@pytest.mark.parametrize(
    "motion",
    [
        "movel(pose_add(get_target_tcp_pose(), p[0.01, 0, 0.01, 0, 0, 0]), 0.5, 0.05)",
        "speedl([0.01, 0, 0.01, 0, 0, 0], 1, 1)\nstopl(10)",
        "q = get_inverse_kin(pose_add(get_target_tcp_pose(), p[0.01, 0, 0.01, 0, 0, 0]))\n"
        "movej(q, 0.5, 0.05)",
        "q = get_inverse_kin(pose_add(get_target_tcp_pose(), p[0.01, 0, 0.01, 0, 0, 0]))\n"
        "i = 0\nwhile i < 500:\nservoj(q, 0, 0, 0.002, 0.1, 300)\ni = i + 1\nend",
    ],
)
def test_motions_of_the_program_go_on_along_the_other_axes_alone(controller, motion):
    before = tool(controller)[:3, 3]
    begin(controller, force_mode(2, 0.0) + motion + "\nsleep(9)")
    pass_time(controller, 2.0)
    went = tool(controller)[:3, 3] - before
    assert went[0] == pytest.approx(0.01, abs=2e-4)
    np.testing.assert_allclose(went[1:], 0.0, atol=3e-4)
    assert controller.safety is Safety.NORMAL


def test_type_1_points_y_at_the_origin_of_the_frame_and_needs_some_distance(controller):
    before = tool(controller)[:3, 3]
    origin = (before + np.array([0.1, 0.0, 0.0])).tolist()
    begin(controller, force_mode(1, 5.0, kind=1, frame=f"p{[*origin, 0, 0, 0]}") + "sleep(99)")
    pass_time(controller, 0.5)
    went = tool(controller)[:3, 3] - before
    assert went[0] > 0.003
    assert np.abs(went[1:]).max() < 1e-6
    pass_time(controller, 12.0)
    assert controller.safety is Safety.PROTECTIVE_STOP
    assert 0.008 < np.linalg.norm(tool(controller)[:3, 3] - origin) < 0.0101


def test_type_3_is_compliant_from_the_first_motion_on_and_across_it(controller):
    before = tool(controller)[:3, 3]
    body = (
        force_mode(1, 5.0, kind=3) + "sleep(0.5)\nspeedl([0, 0.02, 0, 0, 0, 0], 1, 0.5)\nsleep(9)"
    )
    begin(controller, body)
    pass_time(controller, 0.45)
    np.testing.assert_allclose(tool(controller)[:3, 3], before, atol=1e-9)
    pass_time(controller, 0.5)
    went = tool(controller)[:3, 3] - before
    assert went[0] < -0.001  # z x (the motion along y)
    assert went[1] == pytest.approx(0.02 * 0.44, abs=5e-4)


def test_a_tool_that_is_forced_off_the_program_s_path_is_stopped(controller):
    begin(controller, force_mode(2, 0.0, limits=(1e-3, 1e-3, 1, 1, 1, 1)) + "sleep(9)")
    pass_time(controller, 0.2)
    controller.robot.push(np.array([20.0, 0.0, 0.0]), 0.2)
    pass_time(controller, 0.2)
    assert controller.safety is Safety.NORMAL
    controller.robot.push(np.array([400.0, 0.0, 0.0]), 0.2)
    pass_time(controller, 0.2)
    assert controller.safety is Safety.PROTECTIVE_STOP


def test_paused_stopped_or_ended_the_arm_stays_where_it_is(controller):
    begin(controller, force_mode(2, 5.0) + "sleep(1)\nend_force_mode()\nsleep(0.5)")
    pass_time(controller, 0.5)
    controller.pause()
    pass_time(controller, 0.2)
    X = tool(controller)
    pass_time(controller, 0.5)
    np.testing.assert_allclose(tool(controller), X, atol=1e-12)
    assert controller.resume()
    pass_time(controller, 0.4)
    assert velocity(controller)[2] > 0.005
    pass_time(controller, 0.3)
    assert controller.compliance is None
    assert np.abs(velocity(controller)).max() < 1e-9
    begin(controller, force_mode(2, 5.0) + "sleep(0.2)")
    pass_time(controller, 0.6)
    assert controller.runtime is Runtime.STOPPED
    assert controller.compliance is None
    assert np.abs(velocity(controller)).max() < 1e-9


def test_another_tool_centre_point_on_the_way_moves_nothing_by_itself(controller):
    body = force_mode(2, 0.0) + "sleep(0.1)\nset_tcp(p[0.1, 0, 0.2, 0, 0, 0])\nsleep(9)"
    begin(controller, body)
    pass_time(controller, 0.3)
    np.testing.assert_allclose(controller.robot.commanded[0], HOME_Q, atol=1e-6)
    assert controller.safety is Safety.NORMAL


def test_a_payload_that_is_not_there_is_felt_as_its_weight_and_the_arm_follows_it(controller):
    begin(
        controller, force_mode(2, 0.0) + "sleep(0.1)\nset_payload(1.39, [0.05, 0, 0.1])\nsleep(9)"
    )
    pass_time(controller, 0.1)
    before = controller.robot.state().wrench_P
    assert np.linalg.norm(before) < 1e-3
    pass_time(controller, 0.5)
    excess = 1.39 - controller.robot._tool.mass
    terminal = GAIN * excess * 9.80665 * PERIOD / (DAMPING * MASS)
    assert controller.tool_wrench_B()[2] == pytest.approx(excess * 9.80665, rel=1e-3)
    assert 0.5 * terminal < velocity(controller)[2] < 1.01 * terminal


@pytest.mark.parametrize(
    "call",
    [
        "force_mode(p[0,0,0,0,0,0], [0,0,2,0,0,0], [0,0,0,0,0,0], 2, [1,1,1,1,1,1])",
        "force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,0,0,0,0], 4, [1,1,1,1,1,1])",
        "force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,0,0,0,0], 2, [1,1,-1,1,1,1])",
        "force_mode_set_damping(1.1)",
        "force_mode_set_gain_scaling(-0.1)",
    ],
)
def test_what_the_manual_does_not_allow_is_refused(controller, call):
    begin(controller, call)
    for _ in range(5):
        controller.cycle()
    assert call.split("(")[0] in controller.program_error


CLIENT = """
import json, sys, time
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

control, receive = RTDEControlInterface(sys.argv[1]), RTDEReceiveInterface(sys.argv[1])
z = lambda: receive.getTargetTCPPose()[2]
start = z()
wrench = [0.0, 0.0, 10.0, 0.0, 0.0, 0.0]
begun = control.forceMode([0.0] * 6, [0, 0, 1, 0, 0, 0], wrench, 2, [0.1] * 6)
time.sleep(1.0)
risen = z() - start
ended = control.forceModeStop()
time.sleep(0.3)
rest = z()
time.sleep(0.3)
print(json.dumps([begun, ended, risen, z() - rest, control.isProgramRunning()]))
control.stopScript()
"""


def test_the_script_of_ur_rtde_starts_and_ends_it():
    host = address(113)
    with served(host):
        begun, ended, risen, drift, running = json.loads(client(CLIENT, host).splitlines()[-1])
    assert [begun, ended, running] == [True] * 3
    assert 0.005 < risen < 0.03
    assert abs(drift) < 1e-9
