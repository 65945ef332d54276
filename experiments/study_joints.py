"""How far do the joints swing and how fast, with a fixed and with a free roll of the probe? [Zhang,
Fig. 19]

The paper watches the joints of a simulated UR5e along its loop and finds joint 6 swinging back and
forth. Here its own points and the twin's loop are walked by the MuJoCo arm, with the image plane
across the path or free to roll, and with the probe straight on the flange or bent by 45 degrees.
"""

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np

from breastscan.robot.ur.ur5e import PERIOD
from breastscan.run import writing
from breastscan.run.provenance import provenance
from experiments import joint_study_figures, joint_walks
from experiments.joint_walks import LIMITS, MOUNTS_DEG, ROLL_TOLERANCES, Walk


def run(out: Path, *, seed: int) -> list[Walk]:
    """Walk every loop with every roll and mount; leave figures, `study.md` and `study.json` in
    `out`.

    Args:
        out: Where the results go.
        seed: Of the phantom's shape.
    """
    loops = list(joint_walks.loops(seed))
    with writing.staged(out) as folder:
        walks = [
            joint_walks.walk(loop, mount, roll)
            for loop, roll, mount in product(loops, ROLL_TOLERANCES, MOUNTS_DEG)
        ]
        fluctuations = joint_walks.fluctuations(loops)
        figures = joint_study_figures.write(folder, walks)
        writing.write_json(
            folder / "study.json",
            {
                "seed": seed,
                "period_s": PERIOD,
                "limits": LIMITS,
                "walks": [summary(walk) for walk in walks],
                "fluctuations": fluctuations,
                **provenance(),
            },
        )
        (folder / "study.md").write_text(
            "\n".join(_page(walks, fluctuations, figures)) + "\n", encoding="utf-8"
        )
    return walks


def summary(walk: Walk) -> dict[str, object]:
    """What is tabled of one walk; joint quantities from joint 1 to 6."""
    values: dict[str, object] = {
        "loop": walk.loop,
        "mount_deg": walk.mount_deg,
        "roll": walk.roll,
        "unreachable": walk.unreachable,
    }
    if walk.planned is None or walk.q is None or walk.qd is None or walk.resampled is None:
        return {**values, "refused": walk.refused}
    joints, acceleration = walk.planned, np.diff(walk.qd, axis=0) / PERIOD
    return {
        **values,
        "time_s": PERIOD * (len(joints.q) - 1),
        "swing_deg": np.degrees(np.ptp(walk.q, axis=0)),
        "planned_speed_peak_rad_s": np.abs(joints.qd).max(axis=0),
        "speed_peak_rad_s": np.abs(walk.qd).max(axis=0),
        "planned_acceleration_peak_rad_s2": np.abs(np.diff(joints.qd, axis=0) / PERIOD).max(axis=0),
        "acceleration_peak_rad_s2": np.abs(acceleration).max(axis=0),
        "tracking_peak_deg": float(np.degrees(np.abs(walk.q - joints.q).max())),
        "largest_joint_step_deg": float(np.degrees(np.abs(np.diff(joints.q, axis=0)).max())),
        "limits": {
            use.limit: {
                "fraction": use.fraction,
                "bound": use.bound,
                "joint": use.joint,
                "time_s": use.sample * PERIOD,
            }
            for use in walk.uses
        },
        "resampled_1ms_acceleration_pct": walk.resampled[0],
        "resampled_1ms_jerk_pct": walk.resampled[1],
    }


def _page(walks: list[Walk], fluctuations: list[dict], figures: list[str]) -> Iterator[str]:
    yield "# Joints along the loop"
    yield ""
    yield (
        f"At {LIMITS.speed} m/s and {LIMITS.acceleration} m/s², {PERIOD * 1e3:.0f} ms. Walked "
        "by the MuJoCo arm."
    )
    for name in figures:
        yield f"\n![{name}]({name}.png)"
    yield "\n## Largest joint speeds [rad/s], joints 1 to 6, walked (planned)\n"
    yield "| loop | roll, mount | 1 | 2 | 3 | 4 | 5 | 6 | largest | against fixed, straight |"
    yield "|" + 10 * "---|"
    yield from (_speed_row(walk, walks) for walk in walks)
    yield "\n## Fractions of the limits, planned, and largest acceleration walked\n"
    yield (
        "| loop | roll, mount | swing of joint 6 | angle | speed | acceleration | jerk | walked "
        "rad/s² | change at 1 ms: acceleration, jerk |"
    )
    yield "|" + 9 * "---|"
    yield from (_limit_row(walk) for walk in walks if walk.planned is not None)
    yield "\n## Interpolation, 25 mm/s, 2 ms\n"
    yield "| loop | method | speed fluctuation [%] | chord error [mm] | seam: tangent | curvature |"
    yield "|" + 6 * "---|"
    for row in fluctuations:
        yield (
            f"| {row['loop']} | {row['method']} | {row['fluctuation_pct']:.2g} | "
            f"{row['chord_error_mm']:.2g} | {row['seam_tangent']:.1g} | "
            f"{row['seam_curvature']:.1g} |"
        )


def _speed_row(walk: Walk, walks: list[Walk]) -> str:
    start = f"| {walk.loop} | {walk.name} |"
    if walk.planned is None or walk.qd is None:
        points = "; ".join(walk.unreachable) or walk.refused
        return f"{start} not possible: {points} |" + 7 * " |"
    went, planned = np.abs(walk.qd).max(axis=0), np.abs(walk.planned.qd).max(axis=0)
    cells = " | ".join(f"{w:.3f} ({p:.3f})" for w, p in zip(went, planned, strict=True))
    baseline = next(w for w in walks if (w.loop, w.roll, w.mount_deg) == (walk.loop, "fixed", 0.0))
    ratio = "-" if baseline.qd is None else f"{went.max() / np.abs(baseline.qd).max():.2f}"
    return f"{start} {cells} | {went.max():.3f} | {ratio} |"


def _limit_row(walk: Walk) -> str:
    values = summary(walk)
    limits, swing = values["limits"], np.asarray(values["swing_deg"])
    assert isinstance(limits, dict)
    fractions = " | ".join(
        f"{use['fraction']:.1%} (joint {use['joint']}, {use['time_s']:.1f} s)"
        for use in limits.values()
    )
    walked = float(np.max(np.asarray(values["acceleration_peak_rad_s2"])))
    return (
        f"| {walk.loop} | {walk.name} | {swing[5]:.0f}° | {fractions} | {walked:.2f} | "
        f"{values['resampled_1ms_acceleration_pct']:.2f} %, {values['resampled_1ms_jerk_pct']:.2f} "
        "% |"
    )
