"""What does the twin give for every figure and table of the paper? [Zhang]

Cameras are calibrated from rendered boards and placed by an arm that holds one; with that rig, and
with every error switched off, a printed breast is scanned at two forces. Each of the paper's
figures and tables is then set beside what came out.
"""

from collections.abc import Iterator
from pathlib import Path

from breastscan.run import writing
from experiments.paper import (
    calibration,
    curve,
    denoising,
    execution,
    extraction,
    hand_eye,
    joints,
    page,
    rig_tables,
    sampling,
    scans,
    stereo,
    stills,
)
from experiments.paper.item import Item


def run(out: Path, *, seed: int) -> list[Item]:
    """Measure every item, which takes some minutes; leave `study.html`, `study.md`, `study.json`,
    the figures (PNG, SVG) and their data (CSV, Parquet) in `out`.

    Args:
        out: Where the results go.
        seed: Of everything that is drawn: boards, poses, the breast's shape, noise.
    """
    with writing.staged(out) as folder:
        items = list(measured(seed))
        page.write(folder, items, seed=seed)
    return items


def measured(seed: int) -> Iterator[Item]:
    """Every item of the paper, subject by subject."""
    yield from curve.items()
    yield from joints.items()
    cameras = calibration.measured(seed)
    yield from calibration.items(cameras)
    yield from rig_tables.items(cameras)
    placed = hand_eye.measured(cameras.result.rig, seed)
    yield from hand_eye.items(placed)
    rig = placed.result.rig
    loud = [scans.scanned(scans.REALISTIC, force, seed=seed, rig=rig) for force in scans.FORCES]
    quiet = [scans.scanned(scans.EXACT, force, seed=seed) for force in scans.FORCES]
    yield from of_perception(loud[0], seed)
    yield from execution.items([*loud, *quiet])
    yield from stills.items(loud[0])


def of_perception(scan: scans.Scanned, seed: int) -> Iterator[Item]:
    """The items that one pair of pictures answers."""
    matched = scans.matched(scan)
    yield from stereo.items(scan, matched)
    yield from denoising.items(scan, matched)
    yield from sampling.items(scan, seed=seed)
    yield from extraction.items(scan)
