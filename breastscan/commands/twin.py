"""`breastscan twin`: the twin as a UR controller on the network."""

from pathlib import Path

from breastscan.commands.console import Seed, console
from sim.controller.config import ControllerConfig
from sim.controller.serve import serve
from sim.scene import SceneConfig


def twin(
    out: Path | None = None,
    seed: Seed = 0,
    controller: ControllerConfig = ControllerConfig(),  # noqa: B008 (frozen)
    scene: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
) -> None:
    """Serve the twin as a UR controller until Ctrl-C: RTDE, dashboard and script ports, in real
    time.

    Args:
        out: Folder for truth.parquet, what really happened.
        seed: Of the phantom's shape and the sensor's noise, as `scan` takes it.
        controller: What to pretend, and where.
        scene: The world.
    """
    serve(
        scene.seeded(seed),
        controller,
        out,
        lambda text: console.print(text, soft_wrap=True, markup=False),
    )
