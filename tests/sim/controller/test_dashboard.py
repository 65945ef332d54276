"""The dashboard, command by command, as the maker's manual has them."""

import socket
import time
from contextlib import closing, suppress

import pytest

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.config import ControllerConfig
from sim.controller.dashboard import COMMANDS, LOCAL, Dashboard
from sim.controller.external_control import LONGEST_PROGRAM, PORT
from sim.scene import HOME_Q
from tests.sim.controller.programs import switched_on
from tests.sim.controller.served import address

CLIENT = address(114)
LOOP = "def wait():\nwhile True:\nsync()\nend\nend\n"


@pytest.fixture
def programs(tmp_path):
    folder = tmp_path / "programs"
    (folder / "sub").mkdir(parents=True)
    for name in ("wait", "sub/other"):
        (folder / f"{name}.urp").touch()
        (folder / f"{name}.script").write_text(LOOP)
    (folder / "broken.urp").touch()
    (folder / "default.installation").touch()
    (tmp_path / "secret.urp").touch()
    (tmp_path / "secret.script").write_text(LOOP)
    return folder


@pytest.fixture
def dashboard(scene, programs):
    return dashboard_of(scene, ControllerConfig(programs=programs))


def dashboard_of(scene, config):
    told = []
    dashboard = Dashboard(switched_on(scene, HOME_Q, config=config, tell=told.append))
    dashboard.told = told
    return dashboard


def ask(dashboard, talk, seconds=0.02):
    """Ask line after line, and compare; some time passes after each."""
    for request, reply in talk:
        assert dashboard.answer(request) == reply, request
        step(dashboard, seconds)


def step(dashboard, seconds):
    for _ in range(round(seconds / PERIOD)):
        dashboard.controller.cycle()


def test_what_a_controller_at_rest_says(dashboard):
    ask(
        dashboard,
        [
            ("PolyscopeVersion", "URSoftware 5.22.0.0 (Jan 01 2025)"),
            ("version", "5.22.0.0"),
            ("get serial number", "20235500001"),
            ("get robot model", "UR5"),
            ("is in remote control", "true"),
            ("robotmode", "Robotmode: RUNNING"),
            ("ROBOTMODE\r", "Robotmode: RUNNING"),
            ("safetymode", "Safetymode: NORMAL"),
            ("safetystatus", "Safetystatus: NORMAL"),
            ("running", "Program running: false"),
            ("programState", "STOPPED null"),
            ("get loaded program", "No program loaded"),
            ("isProgramSaved", "true null"),
            ("play", "Failed to execute: play"),
            ("pause", "Failed to execute: pause"),
            ("stop", "Failed to execute: stop"),
            ("close safety popup", "closing safety popup"),
            ("saveLog", "Log saved to disk"),
            ("generate flight report system", "Flight Report generated with id: 20235500001"),
            ("generate flight report nonsense", "Error: nonsense is no type of report"),
            ("generate support file x", "Completed successfully: x/ur_20235500001.zip"),
            ("robotmodes", 'could not understand: "robotmodes"'),
            ("", 'could not understand: ""'),
        ],
    )


def test_a_program_is_loaded_played_paused_and_stopped(dashboard):
    ask(
        dashboard,
        [
            ("load wait.urp", "Loading program: wait.urp"),
            ("get loaded program", "Loaded program: wait.urp"),
            ("isProgramSaved", "true wait.urp"),
            ("play", "Starting program"),
            ("programState", "PLAYING wait.urp"),
            ("running", "Program running: true"),
            ("load sub/other.urp", "Error while loading program: sub/other.urp"),
            ("pause", "Pausing program"),
            ("programState", "PAUSED wait.urp"),
            ("play", "Starting program"),
            ("running", "Program running: true"),
            ("stop", "Stopped"),
            ("programState", "STOPPED wait.urp"),
            ("load /programs/sub/other.urp", "Loading program: /programs/sub/other.urp"),
            ("load broken.urp", "Error while loading program: broken.urp"),
            ("load installation default.installation",
             "Loading installation: default.installation"),
            ("load installation x.installation", "File not found: x.installation"),
        ],
    )  # fmt: skip


@pytest.mark.parametrize(
    "path",
    ["none.urp", "wait.script", "../secret.urp", "/programs/../../secret.urp", "a\0.urp", "",
     "/etc/passwd", "x" * 5000 + ".urp", "sub/../../secret.urp"],
    ids=lambda path: path[:20],
)  # fmt: skip
def test_nothing_outside_the_folder_of_programs_is_found(dashboard, programs, path):
    assert dashboard.answer(f"load {path}") == f"File not found: {path}"
    absolute = (programs.parent / "secret.urp").as_posix()
    assert dashboard.answer(f"load {absolute}") == f"File not found: {absolute}"
    assert dashboard.loaded is None


def test_power_comes_step_by_step_and_goes_at_once(dashboard):
    ask(dashboard, [("power off", "Powering off"), ("robotmode", "Robotmode: POWER_OFF")])
    assert dashboard.answer("play") == "Failed to execute: play"
    assert dashboard.answer("brake release") == "Brake releasing"
    seen = []
    for _ in range(50):
        step(dashboard, 0.02)
        seen.append(dashboard.answer("robotmode").removeprefix("Robotmode: "))
    assert list(dict.fromkeys(seen)) == ["POWER_OFF", "POWER_ON", "BOOTING", "IDLE", "RUNNING"]
    ask(dashboard, [("power on", "Powering on"), ("robotmode", "Robotmode: RUNNING")], 0.5)


def test_a_protective_stop_is_unlocked_after_five_seconds_and_not_before(dashboard):
    dashboard.controller.protective_stop("a test")
    step(dashboard, 0.1)
    assert dashboard.answer("safetymode") == "Safetymode: PROTECTIVE_STOP"
    assert dashboard.answer("unlock protective stop").startswith("Cannot unlock protective stop")
    step(dashboard, 5.0)
    assert dashboard.answer("unlock protective stop") == "Protective stop releasing"
    assert dashboard.answer("safetymode") == "Safetymode: NORMAL"
    dashboard.controller.emergency_stop()
    ask(dashboard, [("restart safety", "Restarting safety"), ("safetymode", "Safetymode: NORMAL")])


def test_popups_logs_and_modes(dashboard):
    ask(dashboard, [("popup hello there", "showing popup")])
    assert dashboard.controller.popup.text == "hello there"
    ask(
        dashboard,
        [
            ("close popup", "closing popup"),
            ("addToLog a note", "Added log message"),
            ("addToLog", "No log message to add"),
            ("get operational mode", "NONE"),
            ("set operational mode automatic", "Operational mode AUTOMATIC is set"),
            ("get operational mode", "AUTOMATIC"),
            ("set operational mode x", "Failed setting operational mode: x"),
            (
                "clear operational mode",
                "No longer controlling the operational mode. Current operational mode: NONE",
            ),
            ("get operational mode", "NONE"),
        ],
    )
    assert dashboard.controller.popup is None
    assert "a note" in dashboard.told


VERSIONS = {
    "3.15": {"version", "is in remote control", "set operational mode automatic",
             "get operational mode", "clear operational mode"},
    "5.11": {"setUserRole none", "getUserRole"},
    "5.25": {"setUserRole none", "getUserRole"},
}  # fmt: skip
"""What each does not have."""


@pytest.mark.parametrize("version", VERSIONS)
def test_a_command_that_the_version_lacks_is_not_understood(scene, version):
    dashboard = dashboard_of(scene, ControllerConfig(version=version))
    for request in VERSIONS[version]:
        assert dashboard.answer(request) == f'could not understand: "{request}"'
    lacking = {request for request in COMMANDS if "understand" in dashboard.answer(request)}
    assert len(lacking) == len(VERSIONS[version])


def test_the_older_series_has_roles(scene):
    dashboard = dashboard_of(scene, ControllerConfig(version="3.15"))
    ask(
        dashboard,
        [
            ("setUserRole operator", "Setting user role: OPERATOR"),
            ("getUserRole", "OPERATOR"),
            ("setUserRole king", "Failed setting user role: king"),
        ],
    )


def test_in_local_mode_orders_are_refused_and_questions_answered(dashboard):
    dashboard.controller.remote_control = False
    refused = {name for name in COMMANDS if dashboard.answer(name) == LOCAL}
    assert refused == {
        "load", "play", "stop", "pause", "shutdown", "power on", "power off", "brake release",
        "unlock protective stop", "restart safety", "load installation",
        "set operational mode", "clear operational mode",
    }  # fmt: skip
    assert dashboard.answer("is in remote control") == "false"
    assert dashboard.controller.mode.name == "RUNNING"


@pytest.fixture
def client():
    """Listens where whoever brings a program does."""
    with socket.create_server((CLIENT, PORT)) as server:
        server.settimeout(10)
        yield server


def press_play(dashboard):
    assert dashboard.answer("load external_control.urp").startswith("Loading program")
    assert dashboard.answer("play", CLIENT) == "Starting program"
    cycles(dashboard, 2)


def cycles(dashboard, count):
    for _ in range(count):
        dashboard.cycle()
        dashboard.controller.cycle()


def until(dashboard, happened):
    """Take turns until it has."""
    for _ in range(5000):
        cycles(dashboard, 1)
        if happened():
            return
        time.sleep(0.001)
    raise AssertionError(dashboard.told)


def asked(client):
    """The controller's connection, once it has asked."""
    peer, _ = client.accept()
    assert peer.recv(100) == b"request_program\n"
    return closing(peer)


BROUGHT = """# HEADER_BEGIN
def doubled(x):
  return 2 * x
end
# HEADER_END
write_output_integer_register(3, doubled(21))
ok = socket_open("{}", {})
write_output_boolean_register(4, ok)
while True:
  sync()
end
"""


def test_a_client_brings_the_program_of_external_control(dashboard, client):
    controller = dashboard.controller
    press_play(dashboard)
    with asked(client) as peer:
        text = BROUGHT.format(CLIENT, PORT).encode()
        peer.sendall(text[:50])
        cycles(dashboard, 10)
        peer.sendall(text[50:])
        until(dashboard, lambda: controller.out_ints[3] == 42)
    until(dashboard, lambda: controller.out_bits[4])
    client.accept()[0].close()
    ask(
        dashboard,
        [
            ("programState", "PLAYING external_control.urp"),
            ("get loaded program", "Loaded program: external_control.urp"),
            ("load external_control.urp", "Error while loading program: external_control.urp"),
            ("stop", "Stopped"),
        ],
    )
    press_play(dashboard)
    with asked(client) as peer:
        peer.sendall(b"write_output_integer_register(3, 7)")
        until(dashboard, lambda: controller.out_ints[3] == 7)


def test_a_program_that_does_not_come_is_an_error_and_nothing_waits(dashboard):
    controller = dashboard.controller
    press_play(dashboard)
    until(dashboard, lambda: controller.program_error)
    assert f"nobody listens at port {PORT} of {CLIENT}" in controller.program_error
    assert dashboard.answer("programState") == "STOPPED external_control.urp"


@pytest.mark.parametrize("sent", [b"", b"x" * (LONGEST_PROGRAM + 1)], ids=["nothing", "too much"])
def test_a_program_is_told_within_bounds(dashboard, client, sent):
    controller = dashboard.controller
    press_play(dashboard)
    with asked(client) as peer:
        peer.setblocking(False)

        def over():
            nonlocal sent
            with suppress(OSError):  # the buffer is full, or the controller has hung up
                sent = sent[peer.send(sent) :] if sent else sent
            return controller.program_error

        until(dashboard, over)
    assert "expected a program of 1 to 1000000 bytes" in controller.program_error
    assert controller.program is None
