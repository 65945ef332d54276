"""Studio's viewers, started on a thread of their own: a window, or a page for a browser."""

import errno
import os
import socket
import sys
import time
from dataclasses import dataclass

from mujoco.studio import launch_native, launch_thread, viewer_protocol
from mujoco.studio.endpoints import ViewerEndpoint
from mujoco.studio.plugin import Plugin, split_plugins
from mujoco.studio.viewer_handle import ViewerHandle
from mujoco.studio.viewer_protocol import ViewerConfig

from breastscan.errors import ConfigError

TITLE = "breastscan"
WINDOW_GRAPHICS = "opengl_software"
"""Draws to memory and shows that: the other modes of MuJoCo 4.0.0's window look for a target that
nobody makes."""
PAGE_TIME = 1 / 20
"""Shortest time between two pictures of the panel for a browser [s]: one that draws more slowly
falls ever farther behind."""
PORTS = (0, 65535)


@dataclass(frozen=True, kw_only=True)
class LiveConfig:
    """Where the scan is watched."""

    web: bool = False
    """Whether in a browser instead of a window."""
    host: str = "127.0.0.1"
    """Address that the page is served at. Who reaches it can take control and read this program's
    messages: leave it at the loopback, and come from elsewhere by `ssh -L 8080:localhost:8080`."""
    port: int = 0
    """Port of the page; 0 takes the first free one from 8080."""

    def __post_init__(self) -> None:
        if not PORTS[0] <= self.port <= PORTS[1]:
            raise ConfigError(
                f"a port lies in {PORTS[0]} .. {PORTS[1]}, got {self.port}", self.port
            )
        if not self.web and (self.host, self.port) != (LiveConfig.host, LiveConfig.port):
            raise ConfigError(
                "--host and --port are the page's: give --web as well, or leave them out",
                (self.host, self.port),
            )


def require_viewer(config: LiveConfig) -> None:
    """Pass where a viewer can be opened: ask before anything takes long.

    Raises:
        ConfigError: The page's address cannot be listened at; or there is no screen for a window,
            or no library.
    """
    if config.web:
        _require_address(config)
        return
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ConfigError(
            "a window needs a screen, and DISPLAY names none: watch in a browser with --web"
        )
    try:
        # on the viewer's thread its failure would come out of nowhere
        import mujoco.studio.native_viewer  # noqa: F401
    except ImportError as error:
        raise ConfigError(
            f"MuJoCo's window cannot be opened here ({error}); it needs Python 3.12 or newer: "
            "watch in a browser with --web",
            error,
        ) from error


def launch(config: LiveConfig, plugins: list[Plugin]) -> ViewerHandle:
    """Start the viewer."""
    if config.web:
        return _launch_page(config, plugins)
    return launch_native.launch(ViewerConfig(title=TITLE, gfx=WINDOW_GRAPHICS), plugins=plugins)


def _require_address(config: LiveConfig) -> None:
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((config.host, config.port))
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise ConfigError(
                f"port {config.port} is taken: give another with --port, or 0 for a free one",
                config.port,
            ) from error
        raise ConfigError(
            f"{config.host} is not an address of this machine ({error}): leave --host at 127.0.0.1",
            config.host,
        ) from error


def _launch_page(config: LiveConfig, plugins: list[Plugin]) -> ViewerHandle:
    from mujoco.studio.web_viewer import WebViewer  # not on every platform

    class BoundViewer(WebViewer):
        """Studio's own would listen on all interfaces: it sets its host in its constructor, to
        no avail here.
        """

        _host = property(lambda self: config.host, lambda self, value: None)
        _latest = 0.0

        def prepare_next_frame(self) -> bool:
            """As Studio's, at most every `PAGE_TIME`."""
            time.sleep(max(0.0, self._latest + PAGE_TIME - time.perf_counter()))
            self._latest = time.perf_counter()
            return super().prepare_next_frame()

    viewer_plugins, sim_plugins = split_plugins(plugins)
    settings = ViewerConfig(title=TITLE, gfx="web", http_port=config.port, open_browser=True)

    def target(endpoint: ViewerEndpoint) -> None:
        viewer_protocol.run_viewer_loop(BoundViewer(settings, endpoint, plugins=viewer_plugins))

    return launch_thread.launch_thread(target, sim_plugins=sim_plugins)
