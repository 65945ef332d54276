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

    Give the scan that drives it the same --seed and the same settings of the scene: what stands
    where, both need; arm, wrist and tissue are simulated here, and the pictures (scene.camera, the
    phantom's texture) are taken there.

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
