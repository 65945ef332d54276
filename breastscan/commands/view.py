"""`breastscan view`: the twin's scan, watched as it happens."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float

from breastscan.commands import resumption
from breastscan.commands.console import Out, Seed, console, progress_bars
from breastscan.commands.results import leave, summarise, tell_plan
from breastscan.run.reading import OPTIONAL_FILES
from breastscan.run.writing import require_writable, staged
from breastscan.scan import ScanConfig, ScanPlan, Stages, scan
from breastscan.vision.camera import StereoRig
from sim.live.launch import LiveConfig, require_viewer
from sim.live.view import LiveView
from sim.scene import SceneConfig
from sim.twin import Twin

SHOWN = ("surface_rmse_mm", "executed_truth_rms_mm", "force_rmse_n", "force_peak_n")
"""Metrics that the panel shows at the end."""
LOOP_POINTS = 150
"""Points of the path that are shown."""


def view(
    out: Out = Path("out/view"),
    seed: Seed = 0,
    rig: Path | None = None,
    web: bool = False,
    host: str = LiveConfig.host,
    port: int = LiveConfig.port,
    config: Annotated[ScanConfig, tyro.conf.arg(name="")] = ScanConfig(),  # noqa: B008 (frozen)
    scene: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
) -> None:
    """Scan the phantom with the twin live, in a window or, with --web, in a browser.

    Args:
        out: Folder for the results, as of `scan`.
        seed: Seed of the phantom's shape, the cameras' and the sensor's noise.
        rig: File of an estimated rig to see with, from `handeye`; the twin's cameras stay those of
            the scene.
        web: Whether in a browser instead of a window.
        host: Address that the page is served at. Who reaches it can take control and read this
            program's messages: leave it at the loopback, and come from elsewhere by
            `ssh -L 8080:localhost:8080`.
        port: Port of the page; 0 takes the first free one from 8080.
        config: Every setting of the pipeline.
        scene: Every setting of the simulated world.

    Raises:
        ConfigError: No viewer can be opened, or a file or folder cannot be used.
        CalibrationError: The rig's file is none, or has no place in the robot's base.
        BreastScanError: What else ends a scan.
        KeyboardInterrupt: The user closed the viewer or pressed Ctrl-C before the scan was
            complete.
    """
    live = LiveConfig(web=web, host=host, port=port)
    settings = {"seed": seed, "rig": rig, "scene": scene}
    whole = {**settings, **vars(config)}
    require_writable(whole)
    require_viewer(live)
    estimated = None if rig is None else StereoRig.load(rig)
    with progress_bars() as listener:
        twin = Twin(scene, seed=seed, rig=estimated, stages=Stages(listener))

    def shown(plan: ScanPlan) -> None:
        viewer.planned(_loop(plan))
        tell_plan(plan)

    with twin, LiveView(twin.scene, live, config.contact.force) as viewer:
        with staged(out, OPTIONAL_FILES) as folder:
            stages = Stages(viewer.stage)
            viewer.follow(twin.robot)
            with stages.stage("cameras"):
                camera = twin.camera
            result = scan(
                twin.robot, camera, twin.cell, config,
                stages=stages, on_plan=shown,
                keep=resumption.keep(out, twin.cell, whole, explain=twin.explain),
            )  # fmt: skip
            with stages.stage("truth"):
                result = twin.measured(result)

            leave(out, folder, result, stages, settings)
        summarise(out, result)
        console.print("Close the viewer or press Ctrl-C to end.")
        with suppress(KeyboardInterrupt):
            shown_metrics = [name for name in SHOWN if name in result.metrics]
            viewer.linger(tuple((name, f"{result.metrics[name]:.3f}") for name in shown_metrics))


def _loop(planned: ScanPlan) -> Float[np.ndarray, "n 3"]:
    """Some of the path's points in B [m]."""
    points_B = np.concatenate([stroke.feed.positions for stroke in planned.strokes])
    return points_B[:: max(len(points_B) // LOOP_POINTS, 1)]
