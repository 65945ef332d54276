"""The controller stops as an arm does: for what it meets, where it is sent, and when told to."""

import json
import socket
import struct
from functools import cache

import numpy as np
import pytest

from breastscan.geometry.kinematics import singularity_measure
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD
from sim.controller.controller import UNLOCK_AFTER, Controller
from sim.controller.fault_injection import FaultInjector, TwinControl
from sim.controller.messages import Code
from sim.controller.motion import LONGEST_STEP, NEAR_SINGULARITY
from sim.controller.outputs import Outputs
from sim.controller.states import SAFETY_BITS, RobotMode, Runtime, Safety
from sim.controller.supervision import LIMITS
from sim.scene import HOME_Q
from tests.sim.controller.programs import switched_on
from tests.sim.controller.served import address, served
from tests.sim.controller.wire import Wire

HOST = address(41)
IN_TIME = 0.05
"""Between what is wrong and the stop [s]."""
STATES = [
    "timestamp",
    "safety_mode",
    "safety_status_bits",
    "runtime_state",
    "robot_status_bits",
    "robot_mode",
]
TURN = "q = get_target_joint_positions()\nq[5] = q[5] + 0.5\nmovej(q, 3, 0.5)"
MOTIONS = {
    "movej": TURN,
    "movel": "x = get_target_tcp_pose()\nx[0] = x[0] + 0.1\nmovel(x, 1, 0.1)",
    "speedj": "speedj([0, 0, 0, 0, 0, 0.4], 2, 1)\nstopj(4)",
    "speedl": "speedl([0.1, 0, 0, 0, 0, 0], 1, 1)\nstopl(2)",
    "servoj": """
q = get_target_joint_positions()
i = 0
while i < 900:
  q[5] = q[5] + 0.001
  servoj(q, 0, 0, 0.002, 0.03, 2000)
  i = i + 1
end
stopj(4)""",
}


@pytest.fixture
def controller(scene):
    return switched_on(scene, HOME_Q)


def start(controller, body):
    controller.run(f"def main():\n{body}\nend")


def wait(controller, seconds, until=lambda: False):
    """So long, or until something holds; the commanded steps [rad]."""
    before, steps = controller.robot.commanded[0], []
    for _ in range(round(seconds / PERIOD)):
        controller.cycle()
        after = controller.robot.commanded[0]
        steps.append(np.abs(after - before).max())
        before = after
        if until():
            break
    return np.array(steps)


def stopped(controller):
    return controller.safety is Safety.PROTECTIVE_STOP


def codes(controller):
    return [(m.code, m.argument) for m in controller.messages if isinstance(m, Code)]


def unlock(controller):
    wait(controller, 0.4)
    assert not controller.unlock()
    controller._stopped_at -= UNLOCK_AFTER
    assert controller.unlock()


@pytest.mark.parametrize("speed", [0.02, 0.25])
def test_a_move_into_the_table_ends_and_what_it_pressed_lets_go(controller, speed):
    start(controller, "movej([4.712, -1.5, 2.2, -2.27, -1.5708, 0], 3, 2)")
    wait(controller, 2.0, lambda: controller.runtime is Runtime.STOPPED)
    start(controller, f"x = get_actual_tcp_pose()\nx[2] = -0.1\nmovel(x, 3, {speed})")
    wait(controller, 6.0, lambda: controller.supervision.collision_ratio >= 1.0)
    met = controller.time
    wait(controller, IN_TIME, lambda: stopped(controller))
    assert stopped(controller)
    assert controller.time - met < IN_TIME
    assert [code for code, _ in codes(controller)] == [157]
    wait(controller, 0.5)
    assert controller.supervision.pace <= 1.0
    assert np.abs(controller.robot.external_torques()).max() < 10.0
    unlock(controller)
    assert controller.safety is Safety.NORMAL
    start(controller, "x = get_actual_tcp_pose()\nx[2] = 0.15\nmovel(x, 1, 0.2)")
    wait(controller, 2.0)
    assert controller.tool_pose(controller.state.q)[2, 3] == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize("joint", range(6))
def test_an_arm_held_fast_stops_and_names_the_joint(controller, joint):
    faults = FaultInjector(controller, Outputs(controller), lambda: None)
    qd = [0.0] * 6
    qd[joint] = -0.3
    start(controller, f"speedj({qd}, 5, 5)")
    wait(controller, 0.4)
    answer = faults.answer(json.dumps({"do": "hold", "joint": joint + 1, "seconds": 2}))
    assert json.loads(answer)["ok"]
    wait(controller, IN_TIME, lambda: stopped(controller))
    assert stopped(controller)
    assert codes(controller)[0][0] in (153, 157)
    assert codes(controller)[0][1] == joint


@pytest.mark.parametrize(("force", "stops"), [(10.0, False), (100.0, False), (200.0, True)])
def test_an_arm_that_stands_is_stopped_by_what_pushes_its_tool_hard(controller, force, stops):
    faults = FaultInjector(controller, Outputs(controller), lambda: None)
    wait(controller, 0.1)
    push = {"do": "push", "fx": 0, "fy": 0, "fz": force, "seconds": 0.3}
    assert json.loads(faults.answer(json.dumps(push)))["ok"]
    wait(controller, IN_TIME)
    assert stopped(controller) == stops
    assert (controller.supervision.collision_ratio >= 1.0) == stops


@pytest.mark.parametrize(
    "target",
    [
        "q = get_target_joint_positions()\nq[0] = q[0] + 0.5\nservoj(q)",
        "servoj([7, 0, 0, 0, 0, 0])",
    ],
)
def test_a_servo_target_that_jumps_stops_the_arm_before_it_moves(controller, target):
    start(controller, target + "\nsleep(1)")
    steps = wait(controller, IN_TIME)
    assert stopped(controller)
    assert codes(controller) == [(204, 1)]
    assert steps.max() == 0


SINGULAR = {
    "elbow": "speedl([0, 0, 0.25, 0, 0, 0], 1, 6)",
    "shoulder": "x = get_actual_tcp_pose()\nx[0] = -x[0]\nx[1] = -x[1]\nmovel(x, 1, 0.1)",
    "shoulder, fast": "x = get_actual_tcp_pose()\nx[0] = -x[0]\nx[1] = -x[1]\nmovel(x, 1, 1)",
}


@pytest.mark.parametrize("name", SINGULAR)
def test_a_straight_motion_that_meets_a_singularity_stops_there(controller, name):
    start(controller, SINGULAR[name])
    steps = wait(controller, 8.0, lambda: stopped(controller))
    assert stopped(controller)
    assert codes(controller)[0] in [(154, 0), (204, 7)]
    assert steps.max() <= LONGEST_STEP
    assert singularity_measure(controller.robot.commanded[0]) > NEAR_SINGULARITY / 2
    unlock(controller)
    start(controller, f"movej({HOME_Q.tolist()}, 2, 1)")
    wait(controller, 6.0)
    assert np.abs(controller.state.q - HOME_Q).max() < 1e-3


def test_a_motion_of_its_own_is_slowed_to_the_speed_limits_and_arrives(controller):
    q = HOME_Q + np.array([1.5, 0.0, 0.0, 0.0, 0.0, 1.0])
    start(controller, f"movej({q.tolist()}, 10, 100)")
    steps = wait(controller, 3.0)
    assert controller.safety is Safety.NORMAL
    assert PERIOD * 2.9 < steps.max() <= LONGEST_STEP
    assert np.abs(controller.state.q - q).max() < 1e-3


def test_a_tool_that_a_client_wants_too_fast_is_stopped(scene):
    stretched = switched_on(scene, [0.0, -0.9, 0.4, -1.0, -1.5, 0.0])
    rush = MOTIONS["servoj"].replace("q[5] = q[5] + 0.001", "q[0] = q[0] + i * 0.00001")
    start(stretched, rush)
    wait(stretched, 1.0)
    assert stopped(stretched)
    assert codes(stretched) == [(204, 5)]
    speed = stretched.tool_speed(stretched.state.q, stretched.state.qd)
    assert np.linalg.norm(speed[:3]) < LIMITS[Safety.NORMAL].tool_speed + 0.2


@pytest.mark.parametrize("motion", ["speedj([0, 0, 0, 0, 0, 3], 10, 9)", "servoj", "speedl"])
def test_no_motion_leaves_the_joints_range(scene, motion):
    q = [np.pi, -2.356, 2.094, -1.309, -1.571, ANGLE_LIMIT - 0.3]
    near = switched_on(scene, q)
    about_the_flange = "set_tcp(p[0, 0, 0, 0, 0, 0])\n"
    turn = near.robot.calibration.forward(np.array(q))[:3, 2].tolist()
    body = {
        "servoj": MOTIONS["servoj"],
        "speedl": f"{about_the_flange}speedl([0, 0, 0, {turn[0]}, {turn[1]}, {turn[2]}], 2, 3)",
    }.get(motion, motion)
    start(near, body)
    wait(near, 2.0, lambda: stopped(near))
    assert codes(near)[0] in [(150, 0), (204, 1)]
    wait(near, 0.5)
    assert np.abs(near.robot.commanded[0]).max() <= ANGLE_LIMIT + 5e-3


def test_an_arm_beyond_its_range_recovers_slowly_inwards_alone(scene):
    lost = switched_on(scene, [np.pi, -2.356, 2.094, -1.309, -1.571, ANGLE_LIMIT + 0.1])
    assert lost.safety is Safety.RECOVERY
    start(lost, "speedj([0, 0, 0, 0, 0, 0.2], 1, 1)")
    wait(lost, 0.2)
    assert codes(lost) == [(150, 0)]
    unlock(lost)
    assert lost.safety is Safety.RECOVERY
    start(lost, f"movej([3.14, -2.356, 2.094, -1.309, -1.571, {ANGLE_LIMIT - 0.5}], 2, 2)")
    steps = wait(lost, 4.0, lambda: lost.safety is Safety.NORMAL)
    assert lost.safety is Safety.NORMAL
    assert steps.max() <= PERIOD * LIMITS[Safety.RECOVERY].joint_speed


def power_up(controller):
    controller.power(RobotMode.RUNNING)
    wait(controller, 1.0)
    assert controller.mode is RobotMode.RUNNING


def test_a_limit_of_the_safety_system_cuts_the_power_until_it_is_restarted(controller):
    wait(controller, 0.1)
    controller.robot._data.qvel[controller.robot._dofs][5] = 4.0
    wait(controller, 0.02)
    assert (controller.safety, controller.mode) == (Safety.VIOLATION, RobotMode.POWER_OFF)
    assert codes(controller) == [(191, 37)]
    assert not controller.operational
    controller.restart_safety()
    power_up(controller)
    start(controller, TURN)
    wait(controller, 2.0)
    assert np.abs(controller.state.q - HOME_Q)[5] == pytest.approx(0.5, abs=1e-3)


def slide(fraction):
    def act(controller):
        controller.write({"speed_slider_mask": 1.0, "speed_slider_fraction": fraction})

    return act


def unlocked(controller):
    unlock(controller)
    assert controller.resume()


def released(controller):
    assert not controller.resume()
    controller.release()
    assert controller.resume()


HALTS = {
    "slider": (slide(0.0), slide(1.0)),
    "pause": (Controller.pause, Controller.resume),
    "protective": (lambda controller: controller.protective_stop("a test"), unlocked),
    "safeguard": (Controller.safeguard_stop, released),
}


@cache
def untouched(scene, name):
    """Where a motion ends that nothing halts [rad]."""
    controller = switched_on(scene, HOME_Q)
    start(controller, MOTIONS[name])
    wait(controller, 4.0, lambda: controller.runtime is Runtime.STOPPED)
    return controller.robot.commanded[0]


@pytest.mark.parametrize("halt", HALTS)
@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_that_is_halted_goes_on_and_arrives(scene, name, halt):
    stop, go_on = HALTS[halt]
    halted = switched_on(scene, HOME_Q)
    start(halted, MOTIONS[name])
    wait(halted, 0.4)
    stop(halted)
    steps = wait(halted, 0.5)
    assert steps[-20:].max() < 1e-6  # servoj comes to rest by and by
    go_on(halted)
    steps = wait(halted, 4.0, lambda: halted.runtime is Runtime.STOPPED)
    assert (halted.safety, halted.runtime) == (Safety.NORMAL, Runtime.STOPPED)
    assert steps.max() < LONGEST_STEP
    q = untouched(scene, name)
    moved = np.abs(q - HOME_Q).max()
    # a speed is told for a time: what passes of it at slider 0 is lost
    of_speed = 0.6 if halt == "slider" else 0.15
    lost = moved * (of_speed if name.startswith("speed") else 0.03)
    assert np.abs(q - halted.robot.commanded[0]).max() <= lost


CUTS = {
    "robot": lambda controller: controller.emergency_stop(),
    "system": lambda controller: controller.emergency_stop(Safety.SYSTEM_EMERGENCY_STOP),
    "power": lambda controller: controller.power(RobotMode.POWER_OFF),
}


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("name", MOTIONS)
def test_without_power_the_arm_stands_and_runs_a_program_again_later(controller, name, cut):
    start(controller, MOTIONS[name])
    wait(controller, 0.4)
    CUTS[cut](controller)
    assert (controller.mode, controller.runtime) == (RobotMode.POWER_OFF, Runtime.STOPPED)
    wait(controller, 0.3)
    rest = controller.state.q
    start(controller, TURN)
    wait(controller, 0.5)
    assert np.abs(controller.state.q - rest).max() < 1e-3
    controller.release()
    power_up(controller)
    start(controller, TURN)
    wait(controller, 2.0)
    assert controller.state.q[5] - rest[5] == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_whatever_motion_is_asked_for_steps_are_short_and_joints_in_range(scene, seed):
    """Straight motions to anywhere, at any speed, from wherever the last one ended."""
    rng = np.random.default_rng(seed)
    controller = switched_on(scene, HOME_Q)
    for _ in range(4):
        speed, acceleration = 10 ** rng.uniform(-1.5, 1), 10 ** rng.uniform(-1, 2)
        place = rng.uniform([-0.8, -0.8, 0.1, -3, -3, -3], [0.8, 0.8, 0.9, 3, 3, 3]).tolist()
        velocity = (speed * rng.normal(size=6)).tolist()
        start(
            controller,
            rng.choice(
                [
                    f"movel(p{place}, {acceleration}, {speed})",
                    f"movej(p{place}, {acceleration}, {speed})",
                    f"speedl({velocity}, {acceleration}, 3)",
                    f"speedj({velocity}, {acceleration}, 3)",
                ]
            ),
        )
        steps = wait(controller, 1.5, lambda: controller.safety is not Safety.NORMAL)
        assert steps.max() <= LONGEST_STEP * (1 + 1e-9)
        wait(controller, 0.3)
        assert np.abs(controller.robot.commanded[0]).max() <= ANGLE_LIMIT + 5e-3
        assert controller.safety in (Safety.NORMAL, Safety.PROTECTIVE_STOP)
        controller.stop_program("the next one")
        wait(controller, 0.5)
        if stopped(controller):
            unlock(controller)


def test_every_safety_mode_has_its_bits_once():
    assert set(SAFETY_BITS) == set(Safety)
    assert len(set(SAFETY_BITS.values())) == len(Safety)
    assert set(RobotMode) == set(range(-1, 8))


def test_a_stop_is_told_on_every_channel():
    with served(HOST):
        twin, wire = TwinControl(HOST), Wire(HOST)
        wire.outputs(500, STATES)
        wire.ask(b"S")
        with (
            socket.create_connection((HOST, 29999), 5) as sock,
            sock.makefile("rw") as lines,
            socket.create_connection((HOST, 30003), 5) as script,
        ):
            lines.readline()
            script.sendall(b"def main():\nspeedj([0, 0, 0, 0, 0, 0.5], 5, 5)\nend\n")
            while states(wire)["runtime_state"] != 2:
                pass
            for _ in range(150):
                states(wire)
            held = twin.do("status")["time"]
            twin.do("hold", joint=6, seconds=2)
            while (told := states(wire))["safety_mode"] == 1:
                pass
            assert told["timestamp"] - held < IN_TIME + 0.02  # two connections
            assert told["safety_mode"] == 3
            assert told["safety_status_bits"] == 0x404
            assert told["runtime_state"] == 4
            assert told["robot_status_bits"] == 1
            assert told["robot_mode"] == 7
            for request, answer in {
                "safetymode": "Safetymode: PROTECTIVE_STOP",
                "safetystatus": "Safetystatus: PROTECTIVE_STOP",
                "programstate": "PAUSED",
                "robotmode": "Robotmode: RUNNING",
            }.items():
                lines.write(f"{request}\n")
                lines.flush()
                assert lines.readline().startswith(answer)
        wire.close()
        twin.close()


def states(wire):
    """The next package's."""
    kind, body = wire.read()
    assert kind == b"U"
    return dict(zip(STATES, struct.unpack(">diIIIi", body[1:]), strict=True))
