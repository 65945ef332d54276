"""`breastscan view --web` as a user meets it: the command, its page in a real browser, Ctrl-C."""

import signal
import socket
import subprocess
import sys
import time
import urllib.request

import numpy as np
import pytest

from sim.live.panel import WIDTH_PX
from tests import chromium

START_TIME = 120.0
"""Longest wait for the page [s]: the scene is compiled and the phantom's tissue, perhaps,
solved."""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def page_port(tmp_path_factory):
    """Port of a running view; at the end Ctrl-C must stop it within seconds and leave nothing
    half done.
    """
    port, out = free_port(), tmp_path_factory.mktemp("view")
    command = [
        sys.executable,
        "-m",
        "breastscan",
        "view",
        "--web",
        "--port",
        str(port),
        "--out",
        str(out),
    ]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    until = time.monotonic() + START_TIME
    while not answers(port):
        assert child.poll() is None, child.stdout.read()
        assert time.monotonic() < until, "no page"
        time.sleep(0.3)
    yield port
    child.send_signal(signal.SIGINT)
    told, _ = child.communicate(timeout=60)
    assert child.returncode == 130, told
    assert "Traceback" not in told
    assert {path.name for path in out.iterdir()} <= {"aborted"}  # to go on with


def answers(port, host="127.0.0.1"):
    try:
        with urllib.request.urlopen(f"http://{host}:{port}/", timeout=5) as answer:
            return answer.status == 200
    except OSError:
        return False


@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux answers at every address of the loopback"
)
def test_the_page_is_served_at_the_loopback_address_alone(page_port):
    """A server that listened everywhere would answer at 127.0.0.2 too."""
    assert answers(page_port)
    assert not answers(page_port, "127.0.0.2")


def test_a_taken_port_is_a_clear_error(page_port, tmp_path):
    command = [
        sys.executable,
        "-m",
        "breastscan",
        "view",
        "--web",
        "--port",
        str(page_port),
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=START_TIME)
    assert done.returncode == 1
    assert f"ConfigError: port {page_port} is taken" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_page_shows_scene_and_panel_and_starts_on_the_space_bar(page_port, tmp_path):
    """The scene is drawn (many shades), the panel beside it (light or dark, but even), and Space
    starts the arm.
    """
    with chromium.Page(f"http://127.0.0.1:{page_port}/", tmp_path / "profile") as page:
        page.wait_for("Model loaded and scene initialized successfully", START_TIME)
        page.wait_for("First remote draw frame applied", START_TIME)
        before = until_drawn(page)
        edge = before.shape[1] - WIDTH_PX
        scene, panel = before[:300, : edge - 10], before[200:300, edge + 10 : -10]
        assert scene.std() > 15
        assert len(np.unique(scene.reshape(-1, 3), axis=0)) > 1000
        assert panel.std() < 15
        assert any(moves_on_space(page, scene) for _ in range(4)), "nothing moves"


def moves_on_space(page, scene):
    """Whether the scene changes after a stroke of the space bar: a stroke is lost while the page
    loads.
    """
    page.press_space()
    until = time.monotonic() + START_TIME / 4
    while time.monotonic() < until:
        time.sleep(1.0)
        if (
            np.abs(
                page.screenshot()[: scene.shape[0], : scene.shape[1]].astype(float) - scene
            ).max()
            >= 60
        ):
            return True
    return False


def until_drawn(page):
    """The first picture that is not a blank page."""
    until = time.monotonic() + START_TIME
    while (picture := page.screenshot())[:300, :300].std() < 15:
        assert time.monotonic() < until, "the canvas stays empty"
        time.sleep(1.0)
    return picture
