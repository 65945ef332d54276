"""What programs can call besides motions and sockets."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from sim.controller.functions import script_functions
from sim.controller.messages import Key, Popup, Text
from sim.controller.states import RobotMode, Runtime
from sim.controller.urscript.signature import ANYTHING
from sim.controller.urscript.values import Pose
from tests.sim.controller.programs import refusal, run_to_end


def call(functions, name, *arguments):
    """A function as a program calls it; arguments left out are the defaults."""
    function = functions[name]
    taken = [
        p.kind.take(value) for p, value in zip(function.parameters, arguments, strict=False)
    ] + [p.default for p in function.parameters[len(arguments) :]]
    return function.call(*taken)


MANUAL = [
    ("log", (10.0, 4.0), 0.60206),
    ("norm", (Pose([-0.2, 0.2, -0.2, -1.57, 0, 3.14]),), 3.52768),
    ("normalize", ((0, 1, 1),), (0, 0.707107, 0.707107)),
    ("binary_list_to_integer", ((True, False, False, True),), 9),
    ("binary_list_to_integer", ((True,) * 32,), -1),
    (
        "point_dist",
        (Pose([0.2, 0.5, 0.1, 1.57, 0, 3.14]), Pose([0.2, 0.5, 0.6, 0, 1.57, 3.14])),
        0.5,
    ),
    ("rotvec2rpy", ((3.14, 1.57, 0),), (-2.80856, -0.16202, 0.9)),
    ("rpy2rotvec", ((3.14, 1.57, 0),), (2.22153, 0.00177, -2.21976)),
    (
        "interpolate_pose",
        (Pose([0.2, 0.2, 0.4, 0, 0, 0]), Pose([0.2, 0.2, 0.6, 0, 0, 0]), 0.5),
        (0.2, 0.2, 0.5, 0, 0, 0),
    ),
    (
        "pose_inv",
        (Pose([0.2, 0.5, 0.1, 1.57, 0, 3.14]),),
        (0.19324, 0.41794, -0.29662, 1.23993, 0.0, 2.47985),
    ),
    (
        "pose_trans",
        (Pose([0.2, 0.5, 0.1, 1.57, 0, 0]), Pose([0.2, 0.5, 0.6, 1.57, 0, 0])),
        (0.4, -0.0996, 0.60048, 3.14, 0.0, 0.0),
    ),
]
"""The examples of [UR-script], "Module urmath"."""


@pytest.mark.parametrize(("name", "arguments", "result"), MANUAL)
def test_the_manuals_examples(controller, name, arguments, result):
    np.testing.assert_allclose(call(controller.functions, name, *arguments), result, atol=6e-6)


def test_integers_and_their_bits_are_one(controller):
    for number in (0, 57, -1, 2**31 - 1, -(2**31)):
        bits = call(controller.functions, "integer_to_binary_list", number)
        assert len(bits) == 32
        assert call(controller.functions, "binary_list_to_integer", bits) == number


def test_a_wrench_moves_as_its_power_says(controller):
    """Force times speed is the same in both frames, whatever rigid motion there is."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        T, wrench, twist = rng.normal(size=6), rng.normal(size=6), rng.normal(size=6)
        X = se3.from_rotation_vector(T[3:], T[:3])
        arguments = Pose(T.tolist()), tuple(wrench.tolist())
        moved = np.array(call(controller.functions, "wrench_trans", *arguments))
        at_new = twist[:3] + np.cross(twist[3:], X[:3, 3])
        twist_new = np.concatenate([at_new @ X[:3, :3], twist[3:] @ X[:3, :3]])
        assert moved @ twist_new == pytest.approx(wrench @ twist)


def test_half_way_between_two_poses_is_half_the_turn(controller):
    a, b = Pose([0, 0, 0, 0.3, -2.0, 1.0]), Pose([1, 0, 0, 2.0, 1.0, 0.1])
    middle = call(controller.functions, "interpolate_pose", a, b, 0.5)
    turns = [Rotation.from_rotvec(x[3:]) for x in (a, middle, b)]
    assert (turns[0].inv() * turns[1]).magnitude() == pytest.approx(
        (turns[1].inv() * turns[2]).magnitude()
    )


def test_outputs_flags_and_levels_hold(controller):
    body = (
        "set_standard_digital_out(1, True)\nset_configurable_digital_out(0, True)\n"
        "set_tool_digital_out(1, True)\nset_digital_out(8, True)\nset_digital_out(8, False)\n"
        "set_flag(31, get_digital_out(9))\nset_standard_analog_out(1, 0.5)\n"
        "set_tool_voltage(24.0)\n"
        "write_output_float_register(0, get_standard_analog_out(1))\n"
        "set_analog_outputdomain(1, 0)\nwrite_output_float_register(1, get_analog_out(1))\n"
    )
    run_to_end(controller, body)
    assert controller.digital_outputs == 1 << 1 | 1 << 8 | 1 << 17
    assert controller.flags == 1 << 31
    assert controller.analog_outputs == [0.0, 0.5]
    assert controller.out_doubles[:2] == [5.0, 0.010]
    assert controller.tool_voltage == 24


def test_inputs_are_what_is_wired(controller):
    controller.digital_inputs, controller.analog_inputs = 1 << 2 | 1 << 16, [1.0, 2.0, 3.0, 4.0]
    controller.inputs.update({"input_bit_register_70": 1, "input_bit_registers0_to_31": 1 << 5})
    body = (
        "if get_digital_in(2) and get_tool_digital_in(0) and get_digital_in(8) and not "
        "get_configurable_digital_in(0):\nset_flag(0, True)\nend\n"
        "if read_input_boolean_register(70) and read_input_boolean_register(5):\n"
        "write_output_boolean_register(127, True)\nend\n"
        "write_output_float_register(0, get_analog_in(3) + 10 * get_standard_analog_in(1))\n"
    )
    run_to_end(controller, body)
    assert controller.flags == 1
    assert controller.out_bits[127]
    assert controller.out_doubles[0] == 24.0


def test_a_blocking_popup_waits_until_it_is_closed(controller):
    body = 'textmsg("a=", 1)\npopup("look", title="T", blocking=True)\nset_flag(0, True)\nsync()'
    controller.run(f"def main():\n{body}\nend")
    for _ in range(50):
        controller.cycle()
    assert controller.popup == Popup("look", "T", blocking=True)
    assert controller.flags == 0
    told = [message for message in controller.messages if not isinstance(message, Key)]
    assert told == [Text("a=1"), controller.popup]
    controller.popup = None
    for _ in range(5):
        controller.cycle()
    assert controller.flags == 1
    assert controller.runtime is Runtime.STOPPED


def test_the_program_can_power_down(controller):
    controller.run("def main():\npowerdown()\nend")
    for _ in range(5):
        controller.cycle()
    assert controller.mode is RobotMode.POWER_OFF


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("set_gravity([0, 9.82, 0])", "stands upright"),
        ("set_gravity([0, 0, -9.82])", "stands upright"),
        ("ft_rtde_input_enable(True, 0.5)", "is the only one"),
        ("position_deviation_warning(True)", "not simulated"),
        ('modbus_add_signal("10.0.0.1", 255, 5, 1, "x")', '"modbus_add_signal"'),
        ('x = request_integer_from_primary_client("?")', '"request_integer_from_primary_clie'),
        ("set_tool_voltage(13)", "0, 12 or 24"),
        ("set_standard_analog_out(0, 1.1)", "from 0 to 1"),
        ("x = normalize([0, 0, 0])", "no direction"),
        ("x = log(-1, 2)", "domain"),
    ],
)
def test_what_has_no_meaning_here_is_refused_by_name(controller, body, why):
    assert why in refusal(controller, body)


def test_what_is_so_already_is_taken(controller):
    body = (
        "set_gravity([0, 0, 9.82])\nft_rtde_input_enable(False)\nset_input_actions_to_default()\n"
        "set_safety_mode_transition_hardness(1)\nset_tool_output_mode(0)\n"
        "set_tool_communication(False, 115200, 0, 1, 1.5, 3.5)\nset_tool_digital_output_mode(0, 1)"
    )
    run_to_end(controller, body)


def test_the_inverse_of_another_tools_pose(controller):
    body = (
        "q = get_target_joint_positions()\nx = get_forward_kin(q, p[0, 0, 0.1, 0, 0, 0])\n"
        "r = get_inverse_kin(x, q, tcp=p[0, 0, 0.1, 0, 0, 0])\n"
        "write_output_float_register(0, norm(q - r))\n"
        "if get_inverse_kin_has_solution(p[2, 0, 0, 0, 0, 0]):\nset_flag(0, True)\nend"
    )
    run_to_end(controller, body)
    assert controller.out_doubles[0] < 1e-9
    assert controller.flags == 0


def test_no_two_subjects_have_the_same_function(controller):
    names = list(script_functions(controller))
    assert len(names) > 130


def test_an_output_is_read_by_the_name_that_rtde_has_for_it(controller):
    body = (
        'q = get_rtde_value("actual_q")\nd = norm(q - get_actual_joint_positions())\n'
        'write_output_float_register(0, d)\nif get_rtde_value("runtime_state") == 2 and '
        "tool_pose() == get_target_tcp_pose():\nset_flag(0, True)\nend"
    )
    run_to_end(controller, body)
    assert controller.out_doubles[0] == 0.0
    assert controller.flags == 1
    assert "the name of an output" in refusal(controller, 'x = get_rtde_value("nonsense")')


def test_a_straight_move_goes_as_far_as_the_arm_does(controller):
    """PolyScope's moves until contact ask for a kilometre."""
    run_to_end(
        controller,
        "thread go():\nmovel(pose_add(get_target_tcp_pose(), p[0, 0, 1000, 0, 0, 0]), v=0.1)\nend\n"
        "z = get_target_tcp_pose()\nt = run go()\nsleep(1.0)\nkill t\nstopl(2.0)\n"
        "write_output_float_register(0, point_dist(z, get_target_tcp_pose()))",
    )
    assert controller.out_doubles[0] == pytest.approx(0.1, abs=0.02)


def test_no_function_takes_what_it_does_not_name(controller):
    """Whatever an argument is, the error says whose it is."""
    body = "def main():\nx = struct(a=1)\n{}({})\nend"
    for name, function in controller.functions.items():
        parameters = [p for p in function.parameters if p.kind is not ANYTHING]
        if not parameters:
            continue
        given = ", ".join(f"{p.name}=x" for p in function.parameters)
        controller.program_error = ""
        controller.run(body.format(name, given))
        for _ in range(5):
            controller.cycle()
        assert f"{name}: {parameters[0].name} is " in controller.program_error
