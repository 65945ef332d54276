"""One run of a sweep: a scan of the twin, what was measured, and what ended it early."""

import re
import time
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan import scan_log
from breastscan.errors import BreastScanError, notes_of
from breastscan.robot.interface import Robot
from breastscan.run.provenance import provenance
from breastscan.run.trajectory import Sample
from breastscan.run.writing import as_json, write_image
from breastscan.scan import ScanConfig, ScanPlan, Stages, scan
from breastscan.vision.camera import StereoRig
from experiments.sweep.spec import Run
from sim.cameras.video import CLOSE_UP, render_still
from sim.twin import Twin

PICTURE_PX = (480, 360)
"""Of what is pictured of a scan that failed."""
NUMBER = re.compile(r"\[[^\]]*\]|[-+]?\d*\.?\d+")
"""A number, or a point's coordinates."""
EXPLAINED = "In the twin, "
"""Before what the twin knows of an error (`Twin.explain`)."""
CLAUSE = re.compile(r"[:;(]")
"""What ends the first clause of an error, which tells its kind."""


def scan_run(run: Run, pictures: Path) -> dict[str, Any]:
    """Scan, and tell how it went.

    Args:
        run: Which.
        pictures: Folder for the picture of one that fails.

    Returns:
        The metrics as docs/data.md lists them, for a scan that ended early those of what was done;
        `error`, `cause`, `picture` (None where it ended well); `touched`: whether arm or tool met
        the body; `refused`: whether it ended before they did; `wall_s` and `cpu_s` of the whole
        [s]; `version` and `commit` of what ran.
    """
    wall, cpu = time.perf_counter(), time.process_time()
    found: dict[str, Any] = {"error": None, "cause": None, "picture": None, "touched": False}
    try:
        found |= _scanned(run, pictures)
    except Exception as error:  # of the settings: nothing was built
        found |= _told(error)
    found |= _origin()
    found["refused"] = found["error"] is not None and not found["touched"]
    found["wall_s"] = time.perf_counter() - wall
    found["cpu_s"] = time.process_time() - cpu
    return as_json(found)


@cache
def _origin() -> dict[str, str | None]:
    """Once in a process: it asks git."""
    known = provenance()
    return {"version": known["versions"]["breastscan"], "commit": known["commit"]}


def _scanned(run: Run, pictures: Path) -> dict[str, Any]:
    config, stages = run.config(), Stages()
    rig = None if config.rig is None else StereoRig.load(config.rig)
    with Twin(config.scene, seed=run.seed, rig=rig, stages=stages) as twin:
        done = _Done()
        try:
            with stages.stage("cameras"):
                camera = twin.camera
            result = scan(
                twin.robot, camera, twin.cell, config, stages=stages,
                keep=done.keep,
            )  # fmt: skip
            with stages.stage("truth"):
                found: dict[str, Any] = twin.measured(result).metrics
        except Exception as error:
            twin.explain(error)
            found = _told(error) | done.metrics(twin, config)
            found["picture"] = f"{run.number:06}.png"
            write_image(pictures / found["picture"], _picture(twin, done))
        touched = bool((twin.robot.truth_log().force_any > 0).any())
    return {**found, "touched": touched, "stages": stages.wall_s}


class _Done:
    """What a scan planned and did, also where it ends early."""

    def __init__(self) -> None:
        self.plan: ScanPlan | None = None
        self.log: list[Sample] = []

    def keep(
        self, images: object, plan: ScanPlan, robot: Robot, log: list[Sample]
    ) -> nullcontext[None]:
        self.plan, self.log = plan, log
        return nullcontext()

    def metrics(self, twin: Twin, config: ScanConfig) -> dict[str, Any]:
        """Of the execution until it ended, if it began."""
        if self.plan is None or not self.log:
            return {}
        trajectory = scan_log.trajectory(self.log, self.plan.motion, twin.robot)
        return twin.contact_metrics(trajectory, config)[1]


def _told(error: Exception) -> dict[str, Any]:
    """An error with what the twin knows of it, and its kind: the first clause, whatever the numbers
    in it.
    """
    name = type(error).__name__ + ("" if isinstance(error, BreastScanError) else " (a bug)")
    notes = notes_of(error)
    known = notes[0].removeprefix(EXPLAINED).partition(",")[0] if notes else str(error)
    kind = CLAUSE.split(NUMBER.sub("#", known))[0].strip()
    return {"error": ". ".join([f"{name}: {error}", *notes]), "cause": f"{name}: {kind}"}


def _picture(twin: Twin, done: _Done) -> UInt8[np.ndarray, "h w 3"]:
    """The arm where it ended, or what the left camera saw where it never moved."""
    if done.log:
        drawn = render_still(twin.scene, twin.tissue, done.log[-1].q, CLOSE_UP, PICTURE_PX)
        return cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR).astype(np.uint8)
    seen = cv2.resize(twin.camera.capture().left, PICTURE_PX, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR).astype(np.uint8)
