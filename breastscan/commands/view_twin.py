"""The twin's scan, watched as it happens: what does the arm do, what does the skin, what does the probe feel?"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from breastscan.commands import run_folder, scan_twin
from breastscan.run import writing
from breastscan.scan import ScanConfig, ScanPlan, Stages
from breastscan.vision.camera import StereoRig
from sim.live.launch import LiveConfig, require_viewer
from sim.live.view import LiveView
from sim.robot import SimRobot
from sim.scene import SceneConfig

SHOWN = ("surface_rmse_mm", "executed_truth_rms_mm", "force_rmse_n", "force_peak_n")
"""Metrics that the panel shows at the end."""
LOOP_POINTS = 150
"""Points of the path that are shown."""


@dataclass(frozen=True)
class _Onlooker:
    """Passes on to the viewer what the scan shows."""

    view: LiveView

    def follow(self, robot: SimRobot) -> None:
        self.view.follow(robot)

    def planned(self, plan: ScanPlan) -> None:
        points_B = plan.feed.positions
        self.view.planned(points_B[:: max(len(points_B) // LOOP_POINTS, 1)])


def run(
    out: Path,
    *,
    seed: int,
    config: ScanConfig,
    scene_config: SceneConfig,
    live: LiveConfig,
    console: Console,
    rig: Path | None = None,
) -> None:
    """Scan as `scan_twin.run` does, without a video but before the user's eyes; leave the same folder in `out`.

    Args:
        out: Where the results go; earlier ones stay until these are complete.
        seed: Of the phantom's shape and of every noise.
        config: The pipeline.
        scene_config: The world; its seeds are replaced.
        live: Where it is watched.
        console: Where progress and summary are shown.
        rig: File of an estimated rig that the scan sees with, instead of the true one.

    Raises:
        ConfigError: No viewer can be opened.
        KeyboardInterrupt: The user closed the viewer or pressed Ctrl-C before the scan was complete.
    """
    require_viewer(live)
    estimated = None if rig is None else StereoRig.load(rig)
    scene_config = scan_twin.seeded(scene_config, seed)
    with run_folder.progress_bars(console) as listener:
        scene, tissue = scan_twin.build_world(scene_config, Stages(listener))
    with LiveView(scene, live, config.contact.force) as view:
        with writing.staged(out) as folder:
            stages = Stages(view.stage)
            measured = scan_twin.measure(
                scene, tissue, config, stages, estimated, _Onlooker(view),
                aborted=lambda table, error: run_folder.keep_aborted(out, table, error, console),
            )  # fmt: skip
            settings = {"seed": seed, "video": False, "rig": rig, "scan": config, "scene": scene_config}
            run_folder.write(folder, measured, settings)
            run_folder.write_report(folder, measured, stages)
        run_folder.summarise(out, measured, console)
        console.print("Close the viewer or press Ctrl-C to end.")
        with suppress(KeyboardInterrupt):
            view.linger(tuple((name, f"{measured.metrics[name]:.3f}") for name in SHOWN if name in measured.metrics))
