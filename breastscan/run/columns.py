"""The columns of the tables that a run leaves: one number, word or truth value each, units in the
names.

The tables here drive writing, reading, the file's own description, and docs/data.md: `python -m
breastscan.run.columns` prints what stands there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

Kind = Literal["number", "text", "yes or no"]
AXES = ("x", "y", "z")
FRAMES = {
    "B": "robot base, as Universal Robots define it, z up",
    "P": "probe tip, middle of its face: z out of it into the tissue, x along the array",
    "S": "phantom, middle of the breast's base on the chest plate, z along its outward normal",
}
"""The letters in the column `frame`."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a table."""

    name: str
    """In the file, with the unit."""
    meaning: str
    unit: str = ""
    """Empty where there is none."""
    frame: str = ""
    """Basis or reference, a letter of `FRAMES`; empty where there is none."""
    kind: Kind = "number"


Columns = Mapping[str, tuple[Column, ...]]
"""For each array, the columns that hold it: one for a value a row, one for each entry of a vector,
seven for a pose."""


def _one(name: str, meaning: str, unit: str = "", kind: Kind = "number") -> tuple[Column, ...]:
    return (Column(name=name, meaning=meaning, unit=unit, kind=kind),)


def _joints(name: str, meaning: str, unit: str) -> tuple[Column, ...]:
    return tuple(
        Column(name=name.format(k), meaning=f"joints 1 to 6, {meaning}", unit=unit)
        for k in range(1, 7)
    )


def _vector(
    name: str, meaning: str, unit: str, frame: str, axes: tuple[str, ...] = AXES
) -> tuple[Column, ...]:
    return tuple(
        Column(name=name.format(axis), meaning=meaning, unit=unit, frame=frame) for axis in axes
    )


def _pose(name: str, meaning: str, frame: str) -> tuple[Column, ...]:
    """Position and quaternion; `name` with a place for the axis."""
    turned = f"its orientation as a unit quaternion, which turns P into {frame}"
    return (
        *_vector(f"{name}_m", f"position of the {meaning}", "m", frame),
        *_vector(name, turned, "", frame, ("qw", "qx", "qy", "qz")),
    )


LOG: Columns = {
    "t": _one("t_s", "time on the robot's clock", "s"),
    "phase": _one(
        "phase",
        "what the robot was doing: travel, approach, loop, ...; `resume`: one row where a scan "
        "goes on; `overlap`: what is then done twice",
        kind="text",
    ),
    "s": _one("s_m", "path length along the loop; NaN off it", "m"),
    "q": _joints("q{}_rad", "measured angle", "rad"),
    "qd": _joints("qd{}_rad_s", "measured speed", "rad/s"),
    "target": _joints("q{}_target_rad", "angle that was sent before it", "rad"),
    "q_plan": _joints("q{}_plan_rad", "planned angle; NaN off the loop", "rad"),
    "qd_plan": _joints("qd{}_plan_rad_s", "planned speed; NaN off the loop", "rad/s"),
    "X_BP": _pose("tip_{}", "probe tip, by the measured angles", "B"),
    "X_BP_plan": _pose(
        "tip_{}_plan", "planned probe tip, moved along with drag and breath; NaN off the loop", "B"
    ),
    "wrench_P": (
        *_vector(
            "force_{}_n", "measured force on the probe; pressing is negative along z", "N", "P"
        ),
        *_vector("torque_{}_nm", "measured torque on the probe, about its tip", "N m", "P"),
    ),
    "contact": _one("contact", "whether the controller took the probe to touch", kind="yes or no"),
    "true_force": _one("true_force_n", "true force along the probe axis; pressing is > 0", "N"),
    "true_depth": _one("true_depth_m", "true indentation of the tissue", "m"),
    "true_tilt": _one(
        "true_tilt_rad", "probe axis off the true normal; NaN where nothing touches", "rad"
    ),
}
"""Of `trajectory.parquet`, by the fields of `Trajectory`; those of the truth only from the twin."""
PATH: Columns = {
    "points_B": _vector("{}_m", "point of the path", "m", "B"),
    "normals_B": _vector("n{}", "outward unit normal of the skin there", "", "B"),
}
"""Of `path.csv`."""
STROKE = "stroke"
"""Another column of it, where a scan has several strokes: which one, from 1."""
TRUTH: Columns = {
    "time": LOG["t"],
    "q": LOG["q"],
    "force_axial": LOG["true_force"],
    "depth": LOG["true_depth"],
    "X_SP": _pose("tip_{}_phantom", "probe tip in the phantom", "S"),
    "rise": _one(
        "chest_rise_m", "way of the chest from the end of an exhalation, along its normal", "m"
    ),
    "chest_S": _vector("chest_force_{}_n", "force of the chest plate on arm and tool", "N", "S"),
    "rigid_force": _one(
        "rigid_force_n", "force between the two rigid shapes that press each other hardest", "N"
    ),
    "of_arm": _one(
        "rigid_of_arm", "the arm's or tool's of the two; empty where none touch", kind="text"
    ),
    "of_other": _one("rigid_of_other", "the other", kind="text"),
}
"""Of `truth.parquet`, by the fields of `sim`'s log of the truth."""


def names(columns: Columns) -> tuple[str, ...]:
    """The columns' names in their order."""
    return tuple(column.name for group in columns.values() for column in group)


def descriptions(columns: Columns) -> dict[str, dict[str, str]]:
    """Unit, frame and meaning of each column, for the file's own metadata."""
    return {
        column.name: {"unit": column.unit, "frame": column.frame, "meaning": column.meaning}
        for group in columns.values()
        for column in group
    }


def markdown(columns: Columns) -> str:
    """A row for each run of columns that mean the same."""
    lines = ["| column | unit | frame | meaning |", "|---|---|---|---|"]
    every = (column for group in columns.values() for column in group)
    for (unit, frame, meaning), alike in groupby(every, lambda c: (c.unit, c.frame, c.meaning)):
        shown = " ".join(f"`{column.name}`" for column in alike)
        lines.append(f"| {shown} | {unit or '-'} | {frame or '-'} | {meaning} |")
    return "\n".join(lines)


if __name__ == "__main__":
    for file, columns in (
        ("trajectory.parquet", LOG),
        ("path.csv", PATH),
        ("truth.parquet", TRUTH),
    ):
        print(f"{file}\n\n{markdown(columns)}\n")
