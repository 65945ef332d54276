"""What the joints do along the paper's own loop [Zhang, Sec. V-B.1, Fig. 19]."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from breastscan.report.joint_figures import SPEED_LIMIT_DEG_S
from breastscan.robot.ur.ur5e import PERIOD
from experiments import joint_study_figures, joint_walks, paper_loop
from experiments.joint_walks import Walk
from experiments.paper.item import Item, column

EVERY = 50
"""One sample in so many is kept: every 100 ms."""
WALKS = (("fixed", 0.0), ("free", 0.0))
"""Roll of the probe, and angle between probe and flange [deg]: the paper's mount."""


def items() -> Iterator[Item]:
    """What the walk of the loop answers."""
    loop = joint_walks.Loop(
        name="paper",
        path=paper_loop.vertical(),
        table_height=paper_loop.TABLE_HEIGHT,
        in_twin=False,
    )
    yield _item([joint_walks.walk(loop, mount, roll) for roll, mount in WALKS])


def _item(walks: list[Walk]) -> Item:
    fixed, free = (np.degrees(np.abs(_walked(walk)[1]).max(axis=0)) for walk in walks)
    swing = np.degrees(np.ptp(_walked(walks[0])[0], axis=0))
    step_deg = max(float(np.degrees(np.abs(np.diff(_walked(w)[0], axis=0)).max())) for w in walks)
    agrees = swing.argmax() == fixed.argmax() == 5 and fixed.max() < SPEED_LIMIT_DEG_S
    return Item(
        heading="Fig. 19",
        ours=f"image plane across the path: joint 6 turns by {swing[5]:.0f}° and up to "
        f"{fixed[5]:.0f} °/s, no other joint above {fixed[:5].max():.0f} °/s (limit "
        f"{SPEED_LIMIT_DEG_S:.0f}); no step above {step_deg:.2f}° in 2 ms. With a free roll no "
        f"joint passes {free.max():.0f} °/s",
        verdict="better" if agrees else "worse",
        why="the same peak of joint 6 on the paper's own points at its speed; it goes where the "
        "probe may roll about its axis."
        if agrees
        else "another joint is the fastest here.",
        figure=joint_study_figures.over_time(walks),
        shows="Angle, speed and acceleration of the six joints along Table 4's points, probe "
        "upright and straight on the flange: roll fixed to the path (left) and free (right). Pale "
        "bands: planned.",
        data=_data(walks),
    )  # fmt: skip


def _walked(walk: Walk) -> tuple[np.ndarray, np.ndarray]:
    assert walk.q is not None, walk.refused
    assert walk.qd is not None, walk.refused
    return walk.q, walk.qd


def _data(walks: list[Walk]) -> dict:
    parts = [(walk, *(values[::EVERY] for values in _walked(walk))) for walk in walks]
    q, qd = np.vstack([q for _, q, _ in parts]), np.vstack([qd for _, _, qd in parts])
    joints = range(6)
    return {
        column("roll", "roll of the probe", kind="text"): np.concatenate(
            [np.full(len(q), walk.roll) for walk, q, _ in parts]
        ),
        column("t_s", "time", "s"): np.concatenate(
            [EVERY * PERIOD * np.arange(len(q)) for _, q, _ in parts]
        ),
        **{
            column(f"{name}{j + 1}_{unit}", f"joint {j + 1}", unit): np.degrees(values[:, j])
            for (name, unit, values), j in product((("q", "deg", q), ("qd", "deg_s", qd)), joints)
        },
    }
