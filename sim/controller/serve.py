"""`breastscan twin`: the scene behind a controller's ports, until it is told to end."""

import select
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from breastscan.robot.ur.priority import ask_for_priority
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.run import writing
from sim.controller.config import ControllerConfig
from sim.controller.functions import switched_on
from sim.controller.server import Server
from sim.controller.urscript.syntax import make_ready
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.tissue.mechanics import build_mechanics

LINK_TRANSPORT = PERIOD
"""Part of the servo's transport that a link brings along by itself [s]: a target waits for the
program's turn. The arm then trails a client's targets by 32 to 34 ms, depending on when in a period
they arrive."""
KEPT_TRUTH = 300.0
"""How much of the truth is kept, the latest [s]."""
MAX_TOLD, LONGEST_TOLD = 20, 1000
"""Lines for the operator in a second, and characters of each: clients cause them."""


def serve(
    scene_config: SceneConfig,
    config: ControllerConfig,
    out: Path | None,
    tell: Callable[[str], None],
) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        scene_config: The world.
        config: The controller.
        out: Where `truth.parquet` goes at the end; None keeps nothing.
        tell: Shown to whoever started it.

    Raises:
        RobotError: A port is in use.
    """
    servo = replace(
        scene_config.servo, transport=max(scene_config.servo.transport - LINK_TRANSPORT, PERIOD)
    )
    scene = Scene(replace(scene_config, servo=servo))
    robot = SimRobot(scene, build_mechanics(scene.phantom))
    robot.limit_truth(1 if out is None else round(KEPT_TRUTH / PERIOD))
    _compile(robot)
    make_ready()
    tell = _without_waiting(tell)
    server = Server(switched_on(robot, config, scene_config.mount_angle, tell))
    granted = config.real_time and ask_for_priority()
    tell(
        f"Ready: UR5e {config.version} at {config.host}"
        + ("" if granted else " (no real-time priority)")
    )
    with _told_to_end() as ended:
        server.serve(ended)
    if out is not None:
        with writing.staged(out) as folder:
            robot.truth_log().save(folder / "truth.parquet")
        tell(f"The truth: {out / 'truth.parquet'}")


def _without_waiting(tell: Callable[[str], None]) -> Callable[[str], None]:
    """Tells so much a second at most, and only while whoever started it reads: the cycle waits
    for nobody.
    """
    told: deque[float] = deque(maxlen=MAX_TOLD)

    def tell_some(text: str) -> None:
        now = time.monotonic()
        if len(told) == MAX_TOLD and now - told[0] < 1.0:
            return
        try:
            if not select.select([], [sys.stdout], [], 0.0)[1]:
                return
            tell(text[:LONGEST_TOLD])
        # nobody is there any more, or what stands there is no file
        except (OSError, ValueError, SystemExit):
            return
        told.append(now)

    return tell_some


def _compile(robot: SimRobot) -> None:
    """Compile what programs call: in a cycle it would take seconds, and a client gives up a
    stream silent for 2.5 s.
    """
    q, arm = robot.commanded[0], robot.calibration
    robot.follow(q)
    X_BF = arm.forward(q)
    arm.jacobian(q)
    arm.step(q, X_BF)
    arm.inverse(X_BF)


@contextmanager
def _told_to_end() -> Iterator[Callable[[], bool]]:
    """Whether somebody has asked for the end."""
    told = False

    def note(*_: object) -> None:
        nonlocal told
        told = True

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: told
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
