"""The controller's own force mode on the phantom: what force does it really give, where?

The simulated controller (`sim.controller.force_mode`) runs the program that a user would write: the
sensor zeroed in the air, force mode along the probe's axis, one set-point after the other, each
held and then slid 20 mm along the loop. Its law is assumed where the maker states none, and
nothing of it was fitted to a measurement, so the published deviation stands beside it as another
arm's, with another tool on another thing [Trochimczuk].
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.run.metrics import rms
from experiments import force_cell
from sim.controller.config import ControllerConfig
from sim.controller.functions import switched_on
from sim.controller.states import Runtime
from sim.controller.urscript.values import Pose
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.wrist.wrench_errors import Quality, WrenchSensorConfig

FORCES = (10.0, 5.0, 2.0, 1.0)
"""Set-points, the quickest to find the skin first [N]."""
PUBLISHED = 0.38
"""Mean deviation over 1 to 10 N on a real UR5e; 10 N gave 8.95 to 13.26 by pose [N]
[Trochimczuk]."""
HOLD_TIME, SETTLING = 3.0, 2.0
"""Each set-point is held for so long, and assessed from the second on [s]."""
SLIDE, SLIDE_SPEED = 0.020, 0.025
"""Along the loop [m], [m/s]."""
HIGH, LOW = 0.080, 0.004
"""Over the skin, where the arm travels and where force mode begins [m]."""
APPROACH_LIMIT = 0.020
"""Speed limit along the probe's axis [m/s]."""
HOLDING, SLIDING = 1, 2
"""What the program writes to its register while it does them."""


ZEROED: dict[str, tuple[Quality, bool]] = {
    "ideal sensor": ("ideal", True),
    "built-in, zeroed at each place": ("ur5e_builtin", True),
    "built-in, zeroed at the first": ("ur5e_builtin", False),
}
"""What is compared: the sensor, and whether it is zeroed where it presses."""


@dataclass(frozen=True, kw_only=True)
class Press:
    """One set-point at one place."""

    force: float
    """Asked for [N]."""
    held: float
    """True mean force along the probe while it is held [N]."""
    sliding: float
    """RMS of the true force's error while it slides [N]."""

    @property
    def deviation(self) -> float:
        """Of the mean force held [N]."""
        return abs(self.held - self.force)


def run(circumstance: str, place: float, seed: int) -> list[Press]:
    """All set-points at one place.

    Args:
        circumstance: One of `ZEROED`.
        place: Fraction of the loop.
        seed: Of the sensor.
    """
    sensor, here = ZEROED[circumstance]
    scene = Scene(SceneConfig(wrist=WrenchSensorConfig(quality=sensor, seed=seed)))
    tissue = force_cell.tissue_of(scene.config.phantom)
    tissue.reset()
    robot = SimRobot(scene, tissue, _over(scene, place if here else 0.0, HIGH))
    controller = switched_on(robot, ControllerConfig(), scene.config.mount_angle)
    controller.run(_program(scene, place))
    doing = [(0, 0)]
    while controller.runtime is Runtime.STOPPED and not controller.program_error:
        controller.cycle()  # it is loaded word by word
        doing.append((0, 0))
    while controller.runtime is Runtime.PLAYING:
        controller.cycle()
        doing.append((controller.out_ints[0], controller.out_ints[1]))
    if controller.program_error:
        raise RuntimeError(f"force mode at {place:.2f} of the loop: {controller.program_error}")
    return list(_presses(np.array(doing), robot.truth_log().force_axial))


def _row(place: float) -> float:
    """Of the loop's plan, at a fraction of its length."""
    s = force_cell.ground().motion.s
    return float(np.interp(place % 1.0, s / s[-1], np.arange(len(s))))


def _pose(scene: Scene, place: float, height: float) -> Float[np.ndarray, "4 4"]:
    """X_BP at a place of the loop, so high over the skin."""
    q = force_cell.ground().motion.at(_row(place))
    X_BP = (scene.calibration.forward(q) @ scene.X_FP).copy()
    X_BP[:3, 3] -= height * X_BP[:3, 2]
    return X_BP


def _over(scene: Scene, place: float, height: float) -> Float[np.ndarray, "6"]:
    """Joint angles there [rad]."""
    q = force_cell.ground().motion.at(_row(place))
    X_BF = _pose(scene, place, height) @ se3.inverse(scene.X_FP)
    solutions = scene.calibration.inverse(X_BF)
    return solutions[np.abs(solutions - q).max(axis=1).argmin()]


def _program(scene: Scene, place: float) -> str:
    along = place + SLIDE / float(force_cell.ground().motion.s[-1])
    there, further = (_written(_pose(scene, at, LOW)) for at in (place, along))
    lines = [
        "zero_ftsensor()",
        f"movej({_over(scene, place, HIGH).tolist()}, 2, 1)",
        f"movel({there}, 0.5, 0.1)",
        "force_mode_set_damping(0.025)",
        "force_mode_set_gain_scaling(0.5)",
    ]
    limits = [0.1, 0.1, APPROACH_LIMIT, 1.0, 1.0, 1.0]
    for number, force in enumerate(FORCES):
        wrench = [0.0, 0.0, force, 0.0, 0.0, 0.0]
        lines += [
            f"force_mode(get_target_tcp_pose(), [0,0,1,0,0,0], {wrench}, 2, {limits})",
            f"write_output_integer_register(1, {number})",
            f"sleep({SETTLING})",
            f"write_output_integer_register(0, {HOLDING})",
            f"sleep({HOLD_TIME - SETTLING})",
            f"write_output_integer_register(0, {SLIDING})",
            f"movel({further if number % 2 == 0 else there}, 0.5, {SLIDE_SPEED})",
            "write_output_integer_register(0, 0)",
        ]
    return "def main():\n" + "\n".join([*lines, "end_force_mode()"]) + "\nend"


def _written(X_BT: Float[np.ndarray, "4 4"]) -> str:
    return f"p{list(Pose.of(X_BT))}"


def _presses(doing: np.ndarray, forces: Float[np.ndarray, "n"]) -> Iterable[Press]:
    for number, force in enumerate(FORCES):
        held, slid = (
            forces[(doing[:, 0] == what) & (doing[:, 1] == number)] for what in (HOLDING, SLIDING)
        )
        yield Press(force=force, held=float(held.mean()), sliding=rms(slid - force))


def table(
    pressed: dict[str, list[Press]], own: dict[Quality, list[force_cell.Outcome]]
) -> list[str]:
    """Deviations of the controller's force mode by place, beside those of the scan's law.

    Args:
        pressed: By circumstance, at several places.
        own: The scan's law by sensor, at the same set-points.
    """
    rows = {
        f"force mode, {name}": ([p.deviation for p in presses], [p.sliding for p in presses])
        for name, presses in pressed.items()
    } | {
        f"the scan's law, {sensor}": ([abs(o.bias) for o in outcomes], [o.rmse for o in outcomes])
        for sensor, outcomes in own.items()
    }
    lines = [
        f"Deviation of the mean force from {', '.join(f'{force:g}' for force in FORCES)} N, by "
        f"place and set-point, and RMS error on the way along the loop at "
        f"{SLIDE_SPEED * 1e3:.0f} mm/s [N]. Force mode is assessed at rest, the scan's law on the "
        f"way. A real UR5e with another tool: {PUBLISHED} N in the mean [Trochimczuk].",
        "",
        "| | mean | RMS | median | worst | on the way |",
        "|---|---|---|---|---|---|",
    ]
    for name, (deviations, sliding) in rows.items():
        figures = (
            np.mean(deviations), rms(np.array(deviations)), np.median(deviations),
            np.max(deviations), np.mean(sliding),
        )  # fmt: skip
        lines.append(f"| {name} | {' | '.join(f'{value:.2f}' for value in figures)} |")
    at_ten = [p.held for p in pressed["built-in, zeroed at the first"] if p.force == FORCES[0]]
    return [
        *lines,
        "",
        f"{FORCES[0]:g} N gave {min(at_ten):.2f} to {max(at_ten):.2f} N by place with the built-in "
        "sensor zeroed at the first; the real one 8.95 to 13.26 N by pose.",
        "",
    ]
