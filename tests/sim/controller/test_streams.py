"""The bytes that ports 30001 to 30003 send, taken apart by the columns and tables of the maker's
documents: a server that the tests step themselves.
"""

import socket
import struct
import time

import numpy as np
import pytest

from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.geometry.kinematics import DH_A, DH_ALPHA, DH_D
from breastscan.robot.ur.ur5e import PERIOD
from sim.controller import primary
from sim.controller.config import ControllerConfig
from sim.controller.messages import Code, Key, Popup, SafetyChange, Text
from sim.controller.outputs import Outputs
from sim.controller.realtime import Realtime
from sim.controller.robot_state import RobotState, dh_parameters
from sim.controller.server import Server
from sim.scene import HOME_Q
from tests.sim.controller.programs import switched_on
from tests.sim.controller.served import address
from tests.sim.controller.wire import Stream

HOST = address(81)
MOVE = "def main():\nspeedj([.1, .2, .3, .1, .2, .3], 5, 5)\nend\n"


def controller_of(scene, version="5.22"):
    config = ControllerConfig(version=version, host=HOST)
    return switched_on(scene, HOME_Q, config=config)


@pytest.fixture
def moving(scene):
    """An arm in motion, so that no two values are equal by chance."""
    controller = controller_of(scene)
    controller.run(MOVE)
    for _ in range(100):
        controller.cycle()
    controller.digital_outputs, controller.analog_inputs = 0x10103, [1.0, 2.0, 3.0, 4.0]
    controller.digital_inputs = 5
    return controller


COLUMNS = {
    1: "timestamp", 2: "target_q", 8: "target_qd", 14: "target_qdd", 20: "target_current",
    26: "target_moment", 32: "actual_q", 38: "actual_qd", 44: "actual_current",
    50: "joint_control_output", 56: "actual_TCP_pose", 62: "actual_TCP_speed",
    68: "actual_TCP_force", 74: "target_TCP_pose", 80: "target_TCP_speed",
    86: "actual_digital_input_bits", 87: "joint_temperatures", 95: "robot_mode",
    96: "joint_mode", 102: "safety_mode", 109: "actual_tool_accelerometer",
    118: "speed_scaling", 122: "actual_main_voltage", 123: "actual_robot_voltage",
    124: "actual_robot_current", 125: "actual_joint_voltage",
    131: "actual_digital_output_bits", 132: "runtime_state", 133: "elbow_position",
    136: "elbow_velocity", 139: "safety_status", 143: "payload", 144: "payload_cog",
    147: "payload_inertia",
}  # fmt: skip
"""First column of each variable, as the document of the real-time interface numbers them."""


def test_the_realtime_port_says_what_rtde_says_at_the_same_instant(moving):
    outputs = Outputs(moving)
    package = Realtime(moving, outputs).package()
    assert struct.unpack_from(">i", package) == (len(package),) == (1220,)
    numbers = struct.unpack_from(">152d", package, 4)
    for column, name in COLUMNS.items():
        told = outputs.reader([name])()
        assert numbers[column - 1 : column - 1 + len(told)] == tuple(told), name
    assert np.linalg.norm(numbers[37:43]) > 0.1


@pytest.mark.parametrize(("version", "size"), [("3.15", 1116), ("5.11", 1220), ("10.11", 1220)])
def test_the_realtime_message_is_as_long_as_its_version_has_it(scene, version, size):
    controller = controller_of(scene, version)
    assert len(Realtime(controller, Outputs(controller)).package()) == size


def parts_of(package):
    """The bodies of a state's parts, by type."""
    assert struct.unpack_from(">iB", package) == (len(package), 16)
    found, rest = {}, package[5:]
    while rest:
        size, kind = struct.unpack_from(">iB", rest)
        found[kind], rest = rest[5:size], rest[size:]
    return found


def test_the_state_says_what_rtde_says_at_the_same_instant(moving):
    outputs = Outputs(moving)
    parts = parts_of(RobotState(moving, outputs).package())
    sizes = {0: 47, 1: 251, 2: 37, 3: 75, 4: 101, 7: 61, 8: 9, 9: 53, 11: 26, 12: 8}
    assert {kind: len(body) + 5 for kind, body in parts.items()} == sizes

    mode = struct.unpack(">Q7?bB3dB", parts[0])
    assert mode[0] == round(moving.time * 1e6)
    assert mode[1:10] == (True, True, True, False, False, True, False, 7, 0)
    joints = np.array([struct.unpack_from(">3d4fB", parts[1], 41 * j) for j in range(6)])
    for column, name in ((0, "actual_q"), (1, "target_q"), (2, "actual_qd"), (7, "joint_mode")):
        assert joints[:, column].tolist() == outputs.reader([name])()
    assert struct.unpack(">12d", parts[4]) == tuple(
        outputs.reader(["actual_TCP_pose", "tcp_offset"])()
    )
    board = struct.unpack(">IIBBddBBddffffBBBIBBB", parts[3])
    assert board[:2] == (5, 0x10103)
    assert board[4:6] == (1.0, 2.0)
    assert board[14] == 1
    assert struct.unpack_from(">BBdd", parts[2])[2:] == (3.0, 4.0)


def test_a_stop_and_a_fall_of_power_show_in_the_next_state(moving):
    state = RobotState(moving, Outputs(moving))
    moving.protective_stop("a test")
    moving.cycle()
    mode = struct.unpack(">Q7?bB3dB", parts_of(state.package())[0])
    assert mode[5:8] == (True, False, True)  # stopped, not running, paused
    moving.emergency_stop()
    moving.cycle()
    mode = struct.unpack(">Q7?bB3dB", parts_of(state.package())[0])
    assert (mode[3], mode[4], mode[8]) == (False, True, 3)


def test_the_arms_own_dh_parameters_are_told():
    rng = np.random.default_rng(4)
    theta, a, d, alpha = rng.uniform(-2e-3, 2e-3, (4, 6))
    theta[-1] = 0.0
    arm = KinematicCalibration.from_dh_corrections(theta=theta, d=d, a=a, alpha=alpha)
    told = dh_parameters(arm)
    assert told == pytest.approx(np.array([theta, DH_A + a, DH_D + d, DH_ALPHA + alpha]), abs=1e-12)


MESSAGES = [
    (Text("hello"), 0, "", (), b"hello"),
    (Popup("a", "title", warning=True), 2, ">IB???B5s", (0, 0, 1, 0, 0, 5, b"title"), b"a"),
    (SafetyChange(3), 5, ">iiBII", (0, 0, 3, 0, 0), b""),
    (Code(204, 3, "a jump"), 6, ">iiiII", (204, 3, 2, 0, 0), b"a jump"),
    (Key("T", "main"), 7, ">iiB1s", (0, 0, 1, b"T"), b"main"),
]


@pytest.mark.parametrize(
    ("message", "number", "form", "head", "rest"), MESSAGES, ids=lambda value: str(value)[:12]
)
def test_messages_have_the_maker_s_form(message, number, form, head, rest):
    package = primary.package(1.5, message)
    assert struct.unpack_from(">iBQbb", package) == (len(package), 20, 1_500_000, -2, number)
    assert struct.unpack_from(form, package, 15) == head
    assert package[15 + struct.calcsize(form) :] == rest


@pytest.fixture
def server(scene):
    server = Server(controller_of(scene))
    yield server
    server.close()


def step(server, seconds):
    """Let so much time pass for a server."""
    for _ in range(round(seconds / PERIOD)):
        server.step()


def join(server, *ports):
    """New clients, each at a port."""
    clients = [Stream(HOST, port) for port in ports]
    step(server, PERIOD)
    for client in clients:
        client.socket.settimeout(0.2)
    return clients


def packages(client):
    """All that has arrived."""
    found = []
    try:
        while True:
            found.append(client.read())
    except TimeoutError:
        return found


def test_a_client_is_greeted_with_version_arm_and_setup_and_then_told_ten_times_a_second(server):
    clients = join(server, 30001, 30002, 30011, 30012)
    step(server, 1.0)
    for client in clients:
        greeting, first, *others = packages(client)
        assert struct.unpack_from(">iBQbb", greeting)[1::3] == (20, 3)
        assert struct.unpack_from(">b9sBBii", greeting, 15) == (9, b"URControl", 5, 22, 0, 0)
        parts = parts_of(first)
        kinematics = struct.unpack(">6I24dI", parts[5])
        assert (kinematics[12:18], kinematics[30]) == (tuple(DH_A), 2)
        setup = struct.unpack(">53d4i", parts[6])
        assert setup[29:35] == tuple(DH_A)
        assert setup[-2:] == (1, 0)
        assert 9 <= len(others) <= 11
        assert all(5 not in parts_of(package) for package in others)
        client.close()


def test_the_realtime_ports_tell_every_period_and_the_older_series_every_fourth(scene):
    for version, count in (("5.22", 100), ("3.15", 25)):
        server = Server(controller_of(scene, version))
        clients = join(server, 30003, 30013)
        before = [len(packages(client)) for client in clients]
        step(server, 0.2)
        assert [len(packages(client)) for client in clients] == [count, count]
        assert max(before) <= 1
        server.close()


def test_what_programs_do_is_told_at_the_primary_ports_alone(server):
    clients = join(server, 30001, 30011, 30002)
    clients[0].socket.sendall(b"def f():\nsync()\nprotective_stop()\nsync()\nend\n")
    step(server, 0.2)
    clients[0].socket.sendall(b"stop program\n")
    step(server, 0.2)
    told = [[package[14] for package in packages(client) if package[4] == 20] for client in clients]
    # version, started, what the stop has to say, the safety system's mode, stopped
    assert told[0] == told[1]
    assert [number for number in told[0] if number in (3, 5, 7)] == [3, 7, 5, 7]
    assert told[2] == [3]


@pytest.mark.parametrize("port", [30011, 30012, 30013])
def test_programs_that_come_to_a_read_only_port_are_not_run(server, port):
    (client,) = join(server, port)
    client.socket.sendall(b"def f():\nwrite_output_integer_register(3, 1)\nend\n")
    step(server, 0.1)
    assert server.controller.out_ints[3] == 0


@pytest.mark.parametrize("port", [30001, 30002, 30003])
def test_local_mode_refuses_programs_on_every_port_by_the_makers_number(server, port):
    server.controller.remote_control = False
    client, listener = join(server, port, 30001)
    client.socket.sendall(b"def f():\nwrite_output_integer_register(3, 1)\nend\n")
    step(server, 0.1)
    assert struct.unpack_from(">ii", listener.message(6)) == (210, 0)
    assert server.controller.out_ints[3] == 0


def test_a_client_that_reads_nothing_misses_whole_packages_and_holds_nobody_up(server):
    idle, busy = join(server, 30003, 30003)
    start = time.thread_time()
    seen = 0
    for _ in range(30):
        step(server, 0.1)
        seen += len(packages(busy)) if seen == 0 else 0
    assert time.thread_time() - start < 60
    assert seen > 40
    times = [struct.unpack_from(">d", package, 4)[0] for package in packages(idle)]
    assert times[0] < 0.1
    assert len(times) < 1500
    assert np.diff(times).min() > 0.9 * PERIOD


def test_a_program_counts_whose_sender_has_left_without_reading(server):
    """A reset of the connection throws nothing away that came before it."""
    with socket.create_connection((HOST, 30003), 10) as sock:
        step(server, 0.1)
        body = b"x = 1\n" * 1000
        sock.sendall(b"def f():\n" + body + b"write_output_integer_register(4, 9)\nend\n")
    step(server, 0.5)
    assert server.controller.out_ints[4] == 9
