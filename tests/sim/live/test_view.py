"""The live view without a viewer: a stand-in takes its messages and plays the user."""

import numpy as np
import pytest

from breastscan.errors import ConfigError
from sim.live import launch, view
from sim.live.launch import LiveConfig
from sim.live.messages import PaceSnapshot, PicturesSnapshot, PlanEvent, ScanSnapshot
from sim.live.view import LiveView
from sim.robot import SimRobot
from sim.scene import HOME_Q
from tests.sim.tissue.closed_form_tissue import SpringTissue


class Viewer:
    """What `launch` returns, with a script: what the user does at which exchange of messages."""

    def __init__(self, script):
        self.script = script
        self.count = 0
        self.open = True
        self.sent = []
        self.commands = None
        self.data = None

    def launch(self, config, plugins):
        self.commands = plugins[1]
        return self

    def set_model(self, model, data):
        self.data = data

    def is_running(self):
        return self.open

    def send_to_viewer(self, message):
        self.sent.append(message)

    def sync(self, model, data):
        self.count += 1
        command = self.script.get(self.count)
        if command == "close":
            self.open = False
        elif command is not None:
            self.commands.on_pace(command)

    def close(self):
        self.open = False

    def latest(self, kind):
        return [message for message in self.sent if isinstance(message, kind)][-1]


RUN, PAUSE = PaceSnapshot(paused=False, speed=10.0), PaceSnapshot(paused=True, speed=10.0)


@pytest.fixture
def viewer(monkeypatch):
    def with_script(script):
        stand_in = Viewer(script)
        monkeypatch.setattr(view, "launch", stand_in.launch)
        monkeypatch.setattr(view, "FRAME_TIME", 0.002)
        return stand_in

    return with_script


@pytest.fixture
def robot(quiet_scene):
    skin_S = quiet_scene.phantom.skin.vertices_S
    return SimRobot(
        quiet_scene,
        SpringTissue(height=0.0, stiffness=0.0, skin_S=skin_S - np.array([0.0, 0.0, 0.003])),
    )


def hold(robot, periods):
    for _ in range(periods):
        robot.servo_joint(HOME_Q)


def test_the_scan_waits_until_the_user_starts_it(quiet_scene, viewer):
    stand_in = viewer({5: RUN})
    with LiveView(quiet_scene, LiveConfig(web=True), 5.0):
        assert stand_in.count == 5
        assert stand_in.latest(ScanSnapshot).stage == "ready: press Run"


def test_the_viewer_sees_arm_skin_cameras_path_and_what_the_probe_feels(quiet_scene, viewer, robot):
    stand_in = viewer({1: RUN})
    with LiveView(quiet_scene, LiveConfig(web=True), 5.0) as live:
        live.follow(robot)
        live.planned(np.zeros((4, 3)))
        live.stage("execution", 0.5)
        hold(robot, 100)
        scan = stand_in.latest(ScanSnapshot)
        assert (scan.stage, scan.fraction) == ("execution", 0.5)
        assert scan.time[-1] == pytest.approx(robot.state().time, abs=0.1)
        assert scan.force[-1] == pytest.approx(-robot.state().wrench_P[2], abs=0.05)
        assert len(scan.force) == len(scan.depth_mm) == len(scan.time) > 3
        assert stand_in.latest(PlanEvent).loop_B.shape == (4, 3)
        assert stand_in.latest(PicturesSnapshot).left.shape == (256, 320)
        np.testing.assert_allclose(stand_in.data.qpos[:6], HOME_Q, atol=1e-3)
        nipple = quiet_scene.X_BS[2, 3] + quiet_scene.phantom.height
        assert stand_in.data.mocap_pos[:, 2].max() == pytest.approx(nipple - 0.003, abs=1e-4)


def test_no_simulated_time_passes_in_a_pause(quiet_scene, viewer, robot):
    stand_in = viewer({1: RUN, 4: PAUSE, 30: RUN})
    with LiveView(quiet_scene, LiveConfig(web=True), 5.0) as live:
        live.follow(robot)
        hold(robot, 200)
        clocks = [
            message.time[-1]
            for message in stand_in.sent
            if isinstance(message, ScanSnapshot) and len(message.time)
        ]
    assert clocks.count(max(set(clocks), key=clocks.count)) >= 25
    assert clocks[-1] > clocks[0]


def test_a_viewer_that_is_closed_ends_the_scan_but_not_the_retreat(quiet_scene, viewer, robot):
    viewer({1: RUN, 6: "close"})
    with LiveView(quiet_scene, LiveConfig(web=True), 5.0) as live:
        live.follow(robot)
        with pytest.raises(KeyboardInterrupt):
            hold(robot, 500)
        before = robot.state().time
        hold(robot, 50)  # what leaves the skin is not ended half-way
        assert robot.state().time == pytest.approx(before + 0.1)


def test_a_window_without_a_screen_is_refused(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(launch.sys, "platform", "linux")
    with pytest.raises(ConfigError, match="--web"):
        launch.require_viewer(LiveConfig())


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(ConfigError, match="not an address of this machine"):
        launch.require_viewer(LiveConfig(web=True, host="192.0.2.1"))


@pytest.mark.parametrize("page", [{"host": "127.0.0.9"}, {"port": 8090}])
def test_what_only_a_page_has_is_refused_for_a_window(page):
    with pytest.raises(ConfigError, match="--web"):
        LiveConfig(**page)


def test_an_impossible_port_is_refused():
    with pytest.raises(ConfigError, match="port"):
        LiveConfig(port=70000)
