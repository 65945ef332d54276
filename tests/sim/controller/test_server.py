"""The twin as a controller: its protocol by a client of the tests' own, its behaviour by the
unmodified ur_rtde.
"""

import json
import socket
import struct

import numpy as np
import pytest

from breastscan.errors import ConfigError, RobotError
from sim.controller.config import ControllerConfig
from sim.controller.fault_injection import TwinControl
from sim.controller.variables import Recipe, offered
from tests.sim.controller.served import address, client, served
from tests.sim.controller.wire import Wire

HOST, OTHER_HOST = address(33), address(34)


@pytest.fixture(scope="module")
def twin():
    with served(HOST):
        yield TwinControl(HOST)


@pytest.fixture
def wire(twin):
    wire = Wire(HOST)
    yield wire
    wire.close()


def test_version_and_variables_have_the_widths_of_the_protocol(wire):
    assert struct.unpack(">4I", wire.ask(b"v")) == (5, 22, 0, 0)
    names = [
        "timestamp",
        "actual_q",
        "safety_mode",
        "actual_digital_output_bits",
        "payload_cog",
        "joint_mode",
    ]
    assert wire.outputs(500, names) == b"\x01DOUBLE,VECTOR6D,INT32,UINT64,VECTOR3D,VECTOR6INT32"
    assert wire.ask(b"S") == b"\x01"
    kind, body = wire.read()
    assert kind == b"U"
    assert len(body) == 1 + 8 + 48 + 4 + 8 + 24 + 24


@pytest.mark.parametrize("frequency", [125.0, 333.0, 500.0])
def test_packages_come_at_the_rate_that_was_asked_for_by_the_controllers_clock(wire, frequency):
    wire.outputs(frequency, ["timestamp"])
    wire.ask(b"S")
    times = [struct.unpack(">d", wire.read()[1][1:])[0] for _ in range(200)]
    assert (times[-1] - times[0]) / 199 == pytest.approx(1 / frequency, rel=0.02)


def test_every_output_can_be_asked_for(wire):
    outputs = offered((5, 22))
    wire.outputs(500, list(outputs))
    wire.ask(b"S")
    recipe = Recipe(list(outputs), list(outputs.values()))
    found = recipe.unpack(wire.read()[1][1:])
    assert found["safety_mode"] == 1
    assert np.linalg.norm(found["ft_raw_wrench"][:3]) > 1.0  # the tool's weight


def test_unknown_variables_are_named_and_held_inputs_refused_until_their_holder_leaves(wire):
    assert wire.outputs(500, ["timestamp", "nonsense"]) == b"\x00DOUBLE,NOT_FOUND"
    assert wire.ask(b"I", b"input_int_register_40,") == b"\x01INT32"
    other = Wire(HOST)
    assert other.ask(b"I", b"input_int_register_40") == b"\x00IN_USE"
    wire.close()
    for _ in range(100):
        if other.ask(b"I", b"input_int_register_40") == b"\x01INT32":
            break
    else:
        pytest.fail("the register stays in use")
    other.close()


def test_a_package_that_fits_no_recipe_is_told_and_the_next_one_taken(wire):
    assert wire.ask(b"I", b"input_int_register_41") == b"\x01INT32"
    wire.outputs(10, ["input_int_register_41"])
    wire.ask(b"S")
    wire.send(b"U", b"\x09\x00")
    wire.send(b"U", b"\x01" + struct.pack(">i", 77))
    seen = [wire.read() for _ in range(4)]
    assert any(kind == b"M" and b"recipe 9" in body for kind, body in seen)
    assert any(kind == b"U" and body[1:] == struct.pack(">i", 77) for kind, body in seen)


def test_the_dashboard_answers_line_by_line(twin):
    with socket.create_connection((HOST, 29999), 10) as sock, sock.makefile("rw") as lines:
        assert lines.readline().startswith("Connected")
        for request, reply in {
            "robotmode": "Robotmode: RUNNING",
            "get robot model": "UR5",
            "is in remote control": "true",
            "PolyscopeVersion": "URSoftware 5.22.0.0",
            "play": "Failed to execute: play",
            "load x.urp": "File not found: x.urp",
            "nonsense": "could not understand",
        }.items():
            lines.write(f"{request}\n")
            lines.flush()
            assert lines.readline().startswith(reply)


def test_the_control_port_says_what_it_does_not_know(twin):
    with pytest.raises(RobotError, match="known: protective_stop"):
        twin.do("nonsense")


def test_a_second_twin_at_the_same_address_is_told_what_to_do(twin):
    with pytest.raises(AssertionError, match="ended with 1"), served(HOST):
        pass


def test_addresses_that_others_reach_must_be_meant():
    with pytest.raises(ConfigError, match="expose"):
        ControllerConfig(host="0.0.0.0")
    assert ControllerConfig(host="0.0.0.0", expose=True).host == "0.0.0.0"


CLIENT = """
import json, sys, time
import numpy as np
import rtde_control, rtde_receive
from sim.controller.fault_injection import TwinControl

host = sys.argv[1]
control = rtde_control.RTDEControlInterface(host, 500.0)
receive = rtde_receive.RTDEReceiveInterface(host, 500.0)
twin = TwinControl(host)
told = {}
q = np.array(receive.getActualQ())


def wait(seconds):
    until = receive.getTimestamp() + seconds
    while receive.getTimestamp() < until:
        time.sleep(0.0002)
"""
EXACT = (
    CLIENT
    + """
told["away"] = control.moveJ((q + 0.1).tolist(), 0.5, 1.0)
told["moved"] = float(np.abs(np.array(receive.getActualQ()) - q - 0.1).max())
pose = receive.getActualTCPPose()
told["back"] = control.moveJ(q.tolist(), 0.5, 1.0)
told["line"] = control.moveL(pose, 0.1, 0.5)
told["at_pose"] = float(np.abs(np.array(receive.getActualTCPPose()) - pose).max())
inverse = control.getInverseKinematics(pose, receive.getActualQ())
told["inverse"] = float(np.abs(np.array(inverse) - receive.getActualQ()).max())
control.moveJ(q.tolist(), 0.5, 1.0)
twin.do("reset")
for k in range(1000):
    target = q.copy()
    target[5] += 0.05 * np.sin(0.004 * k)
    told["servo"] = told.get("servo", 0) + control.servoJ(target.tolist(), 0, 0, 0.002, 0.03, 2000)
    wait(0.001)
told["cycles"] = twin.do("status")["cycles"]
told["stopped"] = control.servoStop(10.0)
told["speed"] = control.speedJ([0, 0, 0, 0, 0, 0.2], 2.0, 0.0)
wait(0.5)
told["turning"] = receive.getActualQd()[5]
told["speed_stop"] = control.speedStop(10.0)
told["watchdog"] = control.setWatchdog(10.0)
wait(0.4)
told["running"] = control.isProgramRunning()
told["again"] = control.reuploadScript()
for _ in range(2000):
    if control.isProgramRunning():
        break
    time.sleep(0.01)
twin.do("protective_stop")
wait(0.1)
told["protective"] = receive.isProtectiveStopped()
told["refused"] = control.moveJ(q.tolist(), 0.5, 1.0)
print(json.dumps(told))
"""
)


def test_the_unmodified_client_moves_the_twin_and_is_stopped_as_by_a_controller():
    with served(OTHER_HOST):
        told = json.loads(client(EXACT, OTHER_HOST).splitlines()[-1])
    done = (
        "away",
        "back",
        "line",
        "stopped",
        "speed",
        "speed_stop",
        "watchdog",
        "again",
        "protective",
    )
    assert [name for name in done if not told[name]] == []
    assert told["moved"] < 1e-3
    assert told["at_pose"] < 1e-3
    assert told["inverse"] < 1e-3
    assert told["servo"] == 1000
    assert sum(told["cycles"]) > 900
    assert told["turning"] == pytest.approx(0.2, abs=0.01)
    assert not told["running"]
    assert not told["refused"]


BLOCKING = (
    CLIENT
    + """
pose = receive.getActualTCPPose()
told = {
    "moveJ": control.moveJ(q.tolist(), 0.5, 1.0),
    "moveJ_IK": control.moveJ_IK(pose, 0.5, 1.0),
    "moveL": control.moveL(pose, 0.1, 0.5),
    "moveL_FK": control.moveL_FK(q.tolist(), 0.1, 0.5),
    "path": control.moveJ([[*q.tolist(), 0.5, 1.0, 0.0], [*(q + 0.02).tolist(), 0.5, 1.0, 0.0]]),
    "forceModeStop": control.forceModeStop(),
    "zeroFtSensor": control.zeroFtSensor(),
    "servoStop": control.servoStop(10.0),
    "speedStop": control.speedStop(10.0),
    "setPayload": control.setPayload(0.39, [0.05, 0.0, 0.1]),
    "setTargetPayload": control.setTargetPayload(0.39, [0.05, 0.0, 0.1], [0.001] * 3 + [0.0] * 3),
    "setTcp": control.setTcp([0.1, 0.0, 0.16, 0.0, 0.785, 0.0]),
    "teachMode": control.teachMode() and control.endTeachMode(),
    "freedrive": control.freedriveMode() and control.endFreedriveMode(),
    "damping": control.forceModeSetDamping(0.1) and control.forceModeSetGainScaling(0.5),
    "stops": control.stopJ(2.0) is control.stopL(10.0) is None and control.isProgramRunning(),
    "jog": control.jogStart([0.0] * 6) and control.jogStop(),
    "limits": control.isJointsWithinSafetyLimits(q.tolist()),
    "limits of poses": control.isPoseWithinSafetyLimits(pose),
    "steady": control.isSteady(),
    "forward": len(control.getForwardKinematics()) == 6,
    "inverse": len(control.getInverseKinematics(pose)) == 6,
    "solution": control.getInverseKinematicsHasSolution(pose),
    "waypoint": len(control.getTargetWaypoint()) == 6 and len(control.getTCPOffset()) == 6,
    "poseTrans": len(control.poseTrans(pose, pose)) == 6,
    "contact": control.startContactDetection([0.0] * 6) and not control.readContactDetection(),
    "no_contact": not control.stopContactDetection(),
    "gravity": control.setGravity([0.0, 0.0, 9.81]),
    "external": control.ftRtdeInputEnable(False, 0.0, [0.0] * 3, [0.0] * 3),
    "watchdog": control.setWatchdog(1.0),
}
print(json.dumps({name: bool(done) for name, done in told.items()}))
"""
)


@pytest.mark.parametrize("version", ["5.11", "5.22", "5.25", "10.11"])
def test_every_blocking_command_is_done_on_each_version(version):
    with served(OTHER_HOST, "--controller.version", version):
        told = json.loads(client(BLOCKING, OTHER_HOST).splitlines()[-1])
    assert [name for name, done in told.items() if not done] == []
