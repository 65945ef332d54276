"""The examination: strokes that together touch the whole breast, laid for what the probe touches at
a time and for where it can go.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Shaped

from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import Skin
from breastscan.planning import coverage
from breastscan.planning.candidates import Limits
from breastscan.planning.coverage import Band, CoverageConfig, Kind, Patch, Track
from breastscan.planning.fitting import Fitted, Task
from breastscan.planning.pattern import Path
from breastscan.planning.roll_graph import BlockedError, rolled

ARRAY_TOLERANCE = math.radians(30.0)
"""How far the array may roll away from how a pattern has it lie [rad]."""

ROLL_ROOM = math.radians(5.0)
"""To either side, by which the array can roll away from a singularity of the wrist [rad]."""
BODY_MARGIN = 0.0025
"""Smallest planned gap between the body and the probe, rolled so far and as deep as in the softest
tissue [m]: in usual tissue, the array level, 4 mm more. A single loop need not go so low."""
CLEARANCE = 0.03
"""From the skin between two strokes [m]; a single loop is come to from farther away."""
SHORTEST = 0.03
"""Length of a piece of a stroke that is worth a touch of its own [m]."""
RESERVE = 5e-4
"""Of the margin to the body, for what a smooth curve through points adds [m]."""

Pressed = Callable[[Path], Path]
"""Turns a path's normals to those of the places to press for it."""


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """What strokes are to cover, and how they lie."""

    kind: Kind
    config: CoverageConfig
    patch: Patch
    """What the probe touches at a time."""
    band: Band
    """Where the middle of the patch is to go."""
    tracks: list[Track]

    @staticmethod
    def planned(
        skin: Skin, plate: Plane, kind: Kind, config: CoverageConfig, patch: Patch, task: Task
    ) -> "Coverage":
        """The strokes of a pattern on a breast.

        Args:
            skin: The breast's, in B.
            plate: What it stands on, in B.
            kind: The pattern, but a single loop.
            config: Its margins.
            patch: What the probe touches at a time.
            task: What the strokes are planned with, as `held` has it.

        Raises:
            PlanningError: There is no room for them, or skin was not seen.
        """
        limits = Limits(
            X_FP=task.X_FP,
            config=replace(task.config, body_margin=task.config.body_margin + RESERVE),
            clearance=task.clearance,
            corrections=None,
        ).stricter

        usual = math.pi / 2.0 if kind == "radial" else 0.0

        def clear(X_BP: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, "n"]:
            rolls = (usual - ROLL_ROOM, usual + ROLL_ROOM)
            sides = [rolled(X_BP, np.full(len(X_BP), roll)) for roll in rolls]
            return ~np.any([limits.near_body(X) for X in sides], axis=0)

        band = Band.reached(skin, plate, config, coverage.depth(kind, patch), clear)
        spacing = coverage.swath(kind, patch) * (1.0 - config.overlap)
        tracks = coverage.tracks(kind, band, spacing, twice=config.twice)
        return Coverage(kind=kind, config=config, patch=patch, band=band, tracks=tracks)

    def why_not(self, p_B: Float[np.ndarray, "n 3"]) -> Shaped[np.ndarray, "n"]:
        """Why skin at some places was not touched, a word each: no cameras saw it (`not seen`), the
        probe has to keep away from chest or nipple (`near the chest`, `near the nipple`), or the
        arm could not follow the stroke that was planned, or touched beside it (`missed`).

        Args:
            p_B: On the skin, when it was seen [m].
        """
        s, azimuth = self.band.located(p_B)
        half = coverage.depth(self.kind, self.patch) / 2.0
        reasons = np.full(len(p_B), "missed", dtype="U16")
        reasons[s > self.band.lowest(azimuth) + half] = "near the chest"
        reasons[s < self.band.first - half] = "near the nipple"
        reasons[~self.band.skin.known(self.band.skin.chart(p_B))] = "not seen"
        return reasons

    def fitted(
        self, pressed: Pressed, task: Task, progress: Callable[[float], None]
    ) -> list[Fitted]:
        """The strokes, each in as few pieces as the arm can follow: where it cannot go on as it is
        bent, or no skin was seen, it leaves the skin and comes back otherwise or behind. What it
        can follow in no way is left out.

        The first, next to the chest, most often falls into pieces in other postures, so it is
        planned after the others, which keep to one; its last piece is the nearest to them.

        Args:
            pressed: Turns a path's normals to those of the places to press for it.
            task: What is planned with, as `held` has it.
            progress: Told the share of the strokes that are planned.

        Raises:
            PlanningError: The arm can follow none of them.
        """
        first, *others = [self.band.seen(track) for track in self.tracks]
        pieces: list[Fitted] = []
        for number, track in enumerate(others):
            progress(number / len(self.tracks))
            before = pieces[-1].motion.q[-1] if pieces else None
            pieces += self._fit(track, pressed, task, before)
        after = pieces[0].motion.q[0] if pieces else None
        pieces = self._fit(first, pressed, task, after)[::-1] + pieces
        if not pieces:
            _fitted(pressed(self.band.path(self.tracks[0])), task)  # says why
        return pieces

    def _fit(
        self, seen: list[Track], pressed: Pressed, task: Task, before: np.ndarray | None
    ) -> list[Fitted]:
        """The pieces of a stroke, the first begun from near some joint angles [rad], if given."""
        pieces, left = [], list(seen)
        while left:
            track = left.pop(0)
            path = pressed(self.band.path(track))
            length = path.curve.length
            if length < SHORTEST:
                continue
            try:
                pieces.append(_fitted(path, replace(task, q_before=before)))
                before = pieces[-1].motion.q[-1]
                if track.back:
                    left.insert(0, track.reversed)
            except BlockedError as error:
                reached = error.reached * length
                if reached > SHORTEST / 2:
                    left = [track.part(0.0, error.reached), track.part(error.reached, 1.0), *left]
                else:
                    left.insert(0, track.part(SHORTEST / 2 / length, 1.0))
        return pieces


def held(task: Task) -> Task:
    """The task with the probe upright, which else touches skin beside its stroke, the array held as
    the pattern has it, and the probe let nearer to the body.
    """
    config = replace(
        task.config,
        roll_tolerance=min(task.config.roll_tolerance, ARRAY_TOLERANCE),
        largest_tilt=0.0,
        clearance=min(task.config.clearance, CLEARANCE),
        body_margin=min(task.config.body_margin, BODY_MARGIN),
    )
    return replace(task, config=config)


def _fitted(path: Path, task: Task) -> Fitted:
    planned, feed = task.plan(path)
    return Fitted(path=path, motion=planned, feed=feed, rise=0.0)
