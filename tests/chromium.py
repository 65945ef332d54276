"""A headless Chromium, driven over the DevTools protocol."""

import base64
import json
import shutil
import subprocess
import threading
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from websockets.sync.client import connect

FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    "--remote-debugging-address=127.0.0.1",
]
ANSWER_TIME = 120.0
"""Longest wait for an answer [s]: a page that draws by software answers between two pictures."""


def find() -> str:
    """Where Chromium lies; skips the test where it does not."""
    path = (
        shutil.which("chromium")
        or shutil.which("chromium-browser")
        or shutil.which("google-chrome")
    )
    if path is None:
        pytest.skip("no chromium: on Debian, apt-get install chromium")
    return path


class Page:
    """One page. Use it in a `with` statement."""

    def __init__(self, url: str, profile: Path, width: int = 700, height: int = 500) -> None:
        self.console: list[str] = []
        self._process = subprocess.Popen(
            [
                find(),
                *FLAGS,
                f"--user-data-dir={profile}",
                f"--window-size={width},{height}",
                "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        stderr = self._process.stderr
        line = next(line for line in stderr if "DevTools listening on" in line)
        threading.Thread(target=lambda: list(stderr), daemon=True).start()
        port = line.rsplit(":", 1)[1].split("/")[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            target = next(tab for tab in json.load(answer) if tab["type"] == "page")
        self._stack = ExitStack()
        self._socket = self._stack.enter_context(
            connect(target["webSocketDebuggerUrl"], max_size=None)
        )
        self._count = 0
        self.send("Runtime.enable")
        self.send("Page.navigate", url=url)

    def send(self, method, **params):
        """Call a method of the protocol and return its result."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": params}))
        while True:
            message = json.loads(self._socket.recv(timeout=ANSWER_TIME))
            if message.get("id") == self._count:
                return message["result"]
            if message.get("method") == "Runtime.consoleAPICalled":
                self.console.append(
                    " ".join(str(value.get("value", "")) for value in message["params"]["args"])
                )

    def wait_for(self, text, timeout):
        """Wait until the page has written `text` on its console."""
        until = time.monotonic() + timeout
        while not any(text in line for line in self.console):
            assert time.monotonic() < until, f"the page never said {text!r}: {self.console[-5:]}"
            self.send("Runtime.evaluate", expression="0")
            time.sleep(0.2)

    def evaluate(self, expression):
        """Value of an expression on the page."""
        return self.send("Runtime.evaluate", expression=expression)["result"].get("value")

    def screenshot(self):
        """The page as it looks, RGB."""
        png = base64.b64decode(self.send("Page.captureScreenshot")["data"])
        return cv2.cvtColor(
            cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB
        )

    def press_space(self):
        """One stroke of the space bar."""
        key = {"key": " ", "code": "Space", "windowsVirtualKeyCode": 32, "nativeVirtualKeyCode": 32}
        self.send("Input.dispatchKeyEvent", type="rawKeyDown", **key)
        self.send("Input.dispatchKeyEvent", type="keyUp", **key)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stack.close()
        self._process.terminate()
        self._process.wait(timeout=20)
