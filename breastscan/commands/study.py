"""`breastscan study`: one question about the twin, answered by figures and tables."""

import os
from pathlib import Path

import tyro

os.environ.setdefault("MUJOCO_GL", "egl")

from breastscan.checks import require_known, require_seed
from breastscan.commands.console import Out, Seed, console
from experiments import (
    study_cameras,
    study_force,
    study_joints,
    study_phantom,
    study_twin,
    study_weights,
)

STUDIES = {
    "cameras": study_cameras,
    "force": study_force,
    "joints": study_joints,
    "phantom": study_phantom,
    "twin": study_twin,
    "weights": study_weights,
}


def study(name: tyro.conf.Positional[str], /, out: Out | None = None, seed: Seed = 0) -> None:
    """Answer one question about the twin, with figures and tables.

    Args:
        name: Which study. cameras: what the simulated cameras' errors are and cost. force: how well
            each force law holds the probe, an hour. joints: what the six joints do along the loop,
            with fixed and with free roll. phantom: how far its mechanics can be trusted, and what
            they cost. twin: how the simulated arm and its wrist sensor behave. weights: what the
            weights of a NURBS curve do.
        out: Folder for study.md, study.json and the figures; by default out/study_NAME.
        seed: Seed of everything random.
    """
    require_seed(seed)
    require_known(name, STUDIES, "study")
    folder = out or Path(f"out/study_{name}")
    STUDIES[name].run(folder, seed=seed)
    console.print(f"Figures and tables in {folder}")
