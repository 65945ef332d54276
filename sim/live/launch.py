"""Studio's viewers, started on a thread of their own: a window, or a page for a browser."""

import os
import sys
from dataclasses import dataclass

from mujoco.studio import launch_native, launch_thread, viewer_protocol
from mujoco.studio.endpoints import ViewerEndpoint
from mujoco.studio.plugin import Plugin, split_plugins
from mujoco.studio.viewer_handle import ViewerHandle
from mujoco.studio.viewer_protocol import ViewerConfig

from breastscan.errors import ConfigError

TITLE = "breastscan"
PORTS = (0, 65535)


@dataclass(frozen=True, kw_only=True)
class LiveConfig:
    """Where the scan is watched."""

    web: bool = False
    """Whether in a browser instead of a window."""
    host: str = "127.0.0.1"
    """Address that the page is served at. Who reaches it can take control and read this program's messages: leave it at
    the loopback, and come from elsewhere by `ssh -L 8080:localhost:8080`."""
    port: int = 0
    """Port of the page; 0 takes the first free one from 8080."""

    def __post_init__(self) -> None:
        if not PORTS[0] <= self.port <= PORTS[1]:
            raise ConfigError(f"a port lies in {PORTS[0]} .. {PORTS[1]}, got {self.port}", self.port)


def launch(config: LiveConfig, plugins: list[Plugin]) -> ViewerHandle:
    """Start the viewer.

    Raises:
        ConfigError: There is no screen for a window.
    """
    if config.web:
        return _launch_page(config, plugins)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ConfigError("a window needs a screen, and DISPLAY names none: watch in a browser with --web")
    return launch_native.launch(ViewerConfig(title=TITLE), plugins=plugins)


def _launch_page(config: LiveConfig, plugins: list[Plugin]) -> ViewerHandle:
    from mujoco.studio.web_viewer import WebViewer  # not on every platform

    class BoundViewer(WebViewer):
        """Studio's own would listen on all interfaces: it sets its host in its constructor, to no avail here."""

        _host = property(lambda self: config.host, lambda self, value: None)

    viewer_plugins, sim_plugins = split_plugins(plugins)
    settings = ViewerConfig(title=TITLE, gfx="web", http_port=config.port, open_browser=True)

    def target(endpoint: ViewerEndpoint) -> None:
        viewer_protocol.run_viewer_loop(BoundViewer(settings, endpoint, plugins=viewer_plugins))

    return launch_thread.launch_thread(target, sim_plugins=sim_plugins)
