import re

import numpy as np
import pytest

from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import motion
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path
from breastscan.robot.ur import program as module

X_FP = se3.from_rotation_vector(np.array([0.0, np.pi / 4, 0.0]), np.array([0.099, 0.0, 0.159]))
NUMBERS = r"\[([^\]]*)\]"
CALLS = r"(set_tcp|movej|movel|servoj|stopj|follow)\(.*\)"
STATEMENT = rf"#.*||end|def \w+\([\w, ]*\):|while [^:]+:|(local )?[\w\[\]]+ = .+|{CALLS}"


@pytest.fixture(scope="module")
def planned() -> Motion:
    angle = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    outwards = np.stack([np.cos(angle), np.sin(angle), np.zeros(12)], axis=1)
    path = Path(
        points_B=np.array([0.5, 0.0, 0.1]) + 0.05 * outwards,
        normals_B=0.6 * outwards + np.array([0.0, 0.0, 0.8]),
    )
    return motion.plan_motion(path, X_FP, 0.002, FeedrateLimits(), JointPathConfig())[0]


@pytest.fixture(scope="module")
def q_retreat(planned) -> np.ndarray:
    return planned.lifted(len(planned.q) - 1, X_FP, KinematicCalibration.nominal())


@pytest.fixture(scope="module")
def program(planned, q_retreat) -> str:
    return module.urscript(planned.q, planned.qd, planned.q_approach, q_retreat, X_FP)


def number_lists(line: str) -> list[np.ndarray]:
    return [np.array([float(v) for v in row.split(",")]) for row in re.findall(NUMBERS, line)]


def interpreted(program: str) -> np.ndarray:
    """The servoj targets, by running the program's own `follow` with its statements taken for
    Python's.
    """
    body = program.split("def follow(q0, v0, q1, v1):\n")[1].split("\n  end\n")[0]
    lines = [line.replace("local ", "") for line in body.splitlines() if line.strip() != "end"]
    python = [
        re.sub(r"^(\s*while .*)$", r"\1:", line) if not line.endswith(":") else line
        for line in lines
    ]
    targets: list[list[float]] = []
    scope = {"servoj": lambda q, t, lookahead_time, gain: targets.append(list(q))}
    exec("def follow(q0, v0, q1, v1):\n" + "\n".join(python), scope)
    for line in program.splitlines():
        if line.startswith("  follow("):
            scope["follow"](*number_lists(line))
    return np.array(targets)


def test_the_program_sends_the_planned_joint_angles_every_two_milliseconds(planned, program):
    targets, t = interpreted(program), 0.002 * np.arange(len(planned.q))
    stretched = np.arange(1, len(targets) + 1) * t[-1] / len(targets)
    planned_q = np.stack([np.interp(stretched, t, column) for column in planned.q.T], axis=1)
    np.testing.assert_allclose(targets, planned_q, atol=2e-6)
    assert len(targets) * 0.002 == pytest.approx(t[-1], rel=0.003)


def test_the_programs_joint_speeds_have_no_jump_from_one_cubic_to_the_next(planned, program):
    acceleration = np.diff(interpreted(program), 2, axis=0) / 0.002**2
    planned_acceleration = np.diff(planned.q, 2, axis=0) / 0.002**2
    assert np.abs(acceleration).max() < 1.2 * np.abs(planned_acceleration).max() + 0.1


def test_every_block_of_the_program_is_closed_and_every_line_is_a_known_statement(program):
    depth = 0
    for line in (line.strip() for line in program.splitlines()):
        assert re.fullmatch(STATEMENT, line), line
        depth += line.endswith(":") and not line.startswith("#")
        depth -= line == "end"
        assert depth >= 0
    assert depth == 0
    assert program.isascii()


def test_the_program_comes_from_the_approach_pose_and_leaves_along_the_normal(
    planned, q_retreat, program
):
    statements = [line.strip() for line in program.splitlines()]
    (movej,) = [s for s in statements if s.startswith("movej(")]
    onto, off = [s for s in statements if s.startswith("movel(")]
    for statement, q in (
        (movej, planned.q_approach),
        (onto, planned.q[0]),
        (off, q_retreat),
    ):
        np.testing.assert_allclose(number_lists(statement)[0], q, atol=1e-7)
    order = [statements.index(s) for s in (movej, onto, "stopj(2.0)", off)]
    assert order == sorted(order)
    (tcp,) = [s for s in statements if s.startswith("set_tcp(p")]
    np.testing.assert_allclose(number_lists(tcp)[0], [0.099, 0, 0.159, 0, np.pi / 4, 0], atol=1e-7)
