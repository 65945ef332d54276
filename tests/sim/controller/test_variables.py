"""Which variables RTDE has, version by version, and what registers hold."""

import struct

import pytest

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.config import ControllerConfig
from sim.controller.outputs import Outputs
from sim.controller.rtde import Connection, Registry
from sim.controller.variables import OUTPUTS, offered
from sim.scene import HOME_Q
from tests.sim.controller.programs import switched_on


class Line:
    """Keeps what is sent."""

    def __init__(self):
        self.sent = []

    def send(self, data):
        self.sent.append((data[2:3], data[3:]))

    def close(self):
        self.sent.append((b"", b""))


def connected(scene, version):
    """A connection to a controller, its protocol agreed upon."""
    config = ControllerConfig(version=version)
    controller = switched_on(scene, HOME_Q, config=config)
    line = Line()
    connection = Connection(line, controller, Outputs(controller), Registry())

    def ask(kind, payload=b""):
        connection.receive(struct.pack(">HB", 3 + len(payload), kind[0]) + payload)
        return line.sent[-1][1]

    assert ask(b"V", b"\0\2") == b"\1"
    return controller, connection, line, ask


NEWER = {
    "3.15": {"ft_raw_wrench", "tool_output_mode", "collision_detection_ratio"},
    "5.11": {"collision_detection_ratio", "time_scale_source", "actual_robot_energy_consumed"},
    "5.22": {"actual_robot_energy_consumed", "actual_current_as_torque"},
    "5.25": {"target_gravity", "control_step"},
    "10.11": {"target_gravity", "target_base_wrench"},
}
OLDER = {
    "3.15": {"payload_inertia", "script_control_line", "safety_status", "elbow_position"},
    "5.11": {"ft_raw_wrench", "tool_output_mode", "joint_position_deviation_ratio"},
    "5.22": {"collision_detection_ratio", "time_scale_source"},
    "5.25": {"actual_robot_energy_consumed", "wrench_calc_from_currents"},
    "10.11": {"actual_robot_energy_consumed", "time_scale_source", "ft_raw_wrench"},
}


@pytest.mark.parametrize("version", NEWER)
def test_a_name_newer_than_the_software_is_not_found(scene, version):
    _, _, _, ask = connected(scene, version)
    for name in NEWER[version]:
        assert ask(b"O", struct.pack(">d", 1.0) + name.encode()) == b"\0NOT_FOUND"
    names = offered(ControllerConfig(version=version).numbers)
    assert names.keys() >= OLDER[version]
    assert len(names) > 380
    for name in OLDER[version]:
        assert ask(b"O", struct.pack(">d", 1.0) + name.encode()) == b"\1" + OUTPUTS[name].encode()


def test_it_starts_with_an_output_recipe_only(scene):
    _, _, _, ask = connected(scene, "5.22")
    assert ask(b"S") == b"\0"
    assert ask(b"I", b"input_int_register_0") == b"\1INT32"
    assert ask(b"S") == b"\0"
    ask(b"O", struct.pack(">d", 500.0) + b"timestamp")
    assert ask(b"S") == b"\1"


@pytest.mark.parametrize(("version", "count"), [("3.15", 25), ("5.22", 100)])
def test_the_older_series_tells_125_times_a_second_at_most(scene, version, count):
    controller, connection, line, ask = connected(scene, version)
    ask(b"O", struct.pack(">d", 500.0) + b"timestamp")
    ask(b"S")
    for _ in range(100):
        controller.periods += 1
        connection.publish()
    assert [kind for kind, _ in line.sent].count(b"U") == count


def test_bits_that_programs_and_clients_write_are_told_in_words_and_one_by_one(scene):
    controller, _, _, ask = connected(scene, "5.22")
    read = Outputs(controller).reader
    program = "".join(f"write_output_boolean_register({i}, True)\n" for i in (0, 33, 64, 127))
    controller.run(f"def main():\n{program}end")
    ask(b"I", b"input_bit_registers0_to_31,input_bit_register_70")
    ask(b"U", b"\1" + struct.pack(">I?", 1 << 5, True))
    for _ in range(5):
        controller.cycle()
    words = ["output_bit_registers0_to_31", "output_bit_registers32_to_63"]
    assert read(words)() == [1, 2]
    assert read([f"output_bit_register_{i}" for i in (64, 65, 127)])() == [True, False, True]
    assert [controller.input_bit(i) for i in (4, 5, 37, 70, 71)] == [False, True, False, True,
                                                                     False]  # fmt: skip
    assert read(["input_bit_registers0_to_31", "input_bit_register_70"])() == [32, True]


def test_the_elbows_velocity_is_the_change_of_its_position(scene):
    controller, _, _, _ = connected(scene, "5.22")
    controller.run("def main():\nspeedj([.3, -.2, .1, 0, 0, 0], 5, 5)\nend")
    for _ in range(200):
        controller.cycle()
    read = Outputs(controller).reader(["elbow_position", "elbow_velocity"])
    before = read()
    controller.cycle()
    after = read()
    for axis in range(3):
        change = (after[axis] - before[axis]) / PERIOD
        assert change == pytest.approx((before[3 + axis] + after[3 + axis]) / 2, abs=1e-3)
