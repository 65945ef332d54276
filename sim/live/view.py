# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""A scan shown live: the simulation runs as ever, and after each period the viewer gets what it
needs.

The scan stays on its own thread, which is the main one, and waits there for the wall clock and for
the user. The viewer runs on another. Neither reads the other's data: they exchange messages.
"""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco.studio.messages import handler
from mujoco.studio.plugin import SimPlugin

from breastscan.geometry import kinematics, se3
from sim.arm.ur5e import joint_names
from sim.cameras.camera import SimStereoCamera
from sim.live.launch import LiveConfig, launch
from sim.live.messages import START, PaceSnapshot, PicturesSnapshot, PlanEvent, ScanSnapshot
from sim.live.pace import Pace
from sim.live.panel import Panel
from sim.live.skin import live_vertices
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene

FRAME_TIME = 1 / 30
"""Wall time between two pictures of the scene [s]."""
PICTURES_TIME = 0.5
"""Wall time between two pairs of the cameras' pictures, which cost as much as a tenth of a second
each [s]."""
BINNING = 4
"""Camera pixels to a shown one, each way."""


class ViewerCommands(SimPlugin):
    """The user's commands, as they arrive from the viewer."""

    def __init__(self) -> None:
        self.pace = START

    @handler
    def on_pace(self, pace: PaceSnapshot) -> None:
        """Keep the latest."""
        self.pace = pace


class LiveView:
    """Shows one scan after another in a viewer. Use it in a `with` statement."""

    def __init__(self, scene: Scene, config: LiveConfig, force: float) -> None:
        """Open the viewer and wait for the user to start the scan.

        Args:
            scene: What is shown.
            config: Where.
            force: Set-point of the contact force [N].

        Raises:
            KeyboardInterrupt: The user closed it at once.
        """
        self._scene = scene
        self._model = scene.live
        self._data = mujoco.MjData(self._model)
        self._joints = [self._model.joint(name).qposadr[0] for name in joint_names()]
        self._pace = Pace()
        self._robot: SimRobot | None = None
        self._camera: SimStereoCamera | None = None
        self._stage, self._fraction = "ready: press Run", 0.0
        self._history: list[tuple[float, float, float]] = []
        self._results: tuple[tuple[str, str], ...] = ()
        self._frame_at = self._pictures_at = 0.0
        self._ending = False
        self._arrange(HOME_Q, scene.phantom.skin.vertices_S, 0.0)
        self._commands = ViewerCommands()
        self._handle = launch(config, [Panel(force), self._commands])
        try:
            self._handle.set_model(self._model, data=self._data)
            self._wait_while_paused()
        except BaseException:
            self.close()
            raise

    def follow(self, robot: SimRobot) -> None:
        """Show this arm from now on, and hold its clock to the pace that the user wants."""
        self._robot = robot
        self._camera = SimStereoCamera(self._scene, robot, binning=BINNING)
        self._history.clear()
        robot.watch(self._period)

    def planned(self, loop_B: Float[np.ndarray, "n 3"]) -> None:
        """Show the path [m]."""
        self._handle.send_to_viewer(PlanEvent(loop_B=loop_B))

    def stage(self, name: str, fraction: float) -> None:
        """Say what is being done and how much of it is done."""
        self._stage, self._fraction = name, fraction
        self._show()

    def linger(self, results: tuple[tuple[str, str], ...]) -> None:
        """Show the results until the user closes the viewer or presses Ctrl-C."""
        self._stage = "done"
        self._fraction = 1.0
        self._results = results
        while self._handle.is_running():
            self._show()
            time.sleep(FRAME_TIME)

    def close(self) -> None:
        """Close the viewer."""
        self._ending = True
        if self._camera is not None:
            self._camera.close()
        self._handle.close()

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wait_while_paused(self) -> None:
        while self._commands.pace.paused:
            self._show()
            time.sleep(FRAME_TIME)

    def _period(self) -> None:
        """After a period of the simulation: wait for the clock, show, wait for the user."""
        if self._ending or self._robot is None:
            return
        self._pace.speed = self._commands.pace.speed
        self._pace.keep(self._robot.state().time)
        if time.perf_counter() < self._frame_at:
            return
        self._show()
        if self._commands.pace.paused:
            with _interruptible():
                self._wait_while_paused()
            self._pace.restart()

    def _show(self) -> None:
        """One picture of the scene, and from time to time of what the cameras see."""
        now = time.perf_counter()
        self._frame_at = now + FRAME_TIME
        if self._robot is not None:
            self._arrange(*self._robot.snapshot())
            self._remember(self._robot)
            if self._camera is not None and now > self._pictures_at:
                pair = self._camera.capture()
                self._handle.send_to_viewer(PicturesSnapshot(left=pair.left, right=pair.right))
                self._pictures_at = time.perf_counter() + PICTURES_TIME
        self._handle.send_to_viewer(self._snapshot())
        self._sync()

    def _remember(self, robot: SimRobot) -> None:
        """Add the present instant to the history, if it is a new one."""
        state, contact = robot.state(), robot.contact
        if not self._history or state.time > self._history[-1][0]:
            depth_mm = 0.0 if contact is None else contact.depth * 1e3
            self._history.append((state.time, -float(state.wrench_P[2]), depth_mm))

    def _snapshot(self) -> ScanSnapshot:
        time_s, force, depth_mm = np.array(self._history).reshape(-1, 3).T
        X_BP = (
            np.eye(4)
            if self._robot is None
            else kinematics.forward(self._robot.state().q) @ self._robot.X_FP
        )
        return ScanSnapshot(
            stage=self._stage,
            fraction=self._fraction,
            time=time_s,
            force=force,
            depth_mm=depth_mm,
            X_BP=X_BP,
            results=self._results,
        )

    def _arrange(
        self, q: Float[np.ndarray, "6"], skin_S: Float[np.ndarray, "n 3"] | None, time: float
    ) -> None:
        X_BS = self._scene.X_BS_at(time)
        self._data.qpos[self._joints] = q
        self._data.mocap_pos[0] = X_BS[:3, 3]
        if skin_S is not None:
            self._data.mocap_pos[1:] = se3.transform(X_BS, live_vertices(skin_S))

    def _sync(self) -> None:
        """Exchange messages with the viewer; ends the scan where it was closed."""
        if not self._handle.is_running():
            self._ending = True
            raise KeyboardInterrupt
        self._handle.sync(self._model, self._data)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C through, which a scan in contact otherwise holds back until the next command."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
