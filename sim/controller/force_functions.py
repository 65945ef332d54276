"""The functions of the controller that have to do with forces: force mode, freedrive, torques and
the arm's dynamics.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from sim.controller import freedrive, motion
from sim.controller.controller import Controller
from sim.controller.force_mode import ForceMode, ForceTask
from sim.controller.freedrive import DirectTorque, Freedrive
from sim.controller.motion import Braking
from sim.controller.urscript.signature import (
    CONDITION,
    JOINTS,
    POSE,
    REFUSED,
    Function,
    Kind,
    Parameter,
    row,
    up_to,
)
from sim.controller.urscript.values import Pose, Value

Vector6 = Float[np.ndarray, "6"]
FIRST_TORQUES = {5: (5, 23), 10: (10, 10)}
"""Software of each generation that has `direct_torque`."""
FIRST_SCALES = {5: (5, 25, 1), 10: (10, 12, 1)}
"""The same for its scales of the friction model."""
VISCOUS_SCALE = np.array([0.9, 0.9, 0.8, 0.9, 0.9, 0.9])
COULOMB_SCALE = np.array([0.8, 0.8, 0.7, 0.8, 0.8, 0.8])
"""Their defaults [-] [UR-script]."""
DERIVATIVE_TIME = 1e-5
"""Over which the Jacobian's derivative is taken [s]."""


def _six(name: str, fits: Callable[[np.ndarray], np.ndarray], make: Callable = np.asarray) -> Kind:
    """Six numbers, each of which fits."""

    def take(value: Value) -> Any:
        six = JOINTS.take(value)
        return make(six) if six is not REFUSED and fits(six).all() else REFUSED

    return Kind(name, take)


AXES = _six("six numbers of 0 and 1", lambda six: np.isin(six, (0, 1)), lambda six: six > 0)
LIMITS = _six("six numbers, none negative", lambda six: six >= 0)
SCALES = _six("six numbers from 0 to 1", lambda six: (six >= 0) & (six <= 1))
TYPE = Kind("1, 2 or 3", lambda value: int(value) if value in (1, 2, 3) else REFUSED)
"""Also as a real number: clients get it out of a division."""
FEATURE = Kind(
    'a pose, "base" or "tool"',
    lambda value: value if value in ("base", "tool") else POSE.take(value),
)


def force_functions(controller: Controller) -> Iterable[Function]:
    """All but direct_torque, which moves the arm as motions do."""
    yield from _force_mode(controller)
    yield from _freedrive(controller)
    yield from _dynamics(controller)


def _force_mode(controller: Controller) -> Iterable[Function]:
    gains = controller.force_gains

    def begin(
        frame: Pose, compliant: Bool[np.ndarray, "6"], wrench: Vector6, kind: int, limits: Vector6
    ) -> None:
        R_BC, p_BC = frame.matrix[:3, :3], frame.matrix[:3, 3]
        task = ForceTask(R_BC=R_BC, p_BC=p_BC, compliant=compliant, wrench_C=wrench, type=kind,
                         limits=limits)  # fmt: skip
        if controller.compliance is None:
            controller.compliance = ForceMode(task, gains)
        controller.compliance.task = task

    def end() -> None:
        if controller.compliance is not None:
            controller.compliance = None
            controller.motion = Braking(controller.robot)

    task = {"task_frame": POSE, "selection_vector": AXES, "wrench": JOINTS, "type": TYPE,
            "limits": LIMITS}  # fmt: skip
    yield row("force_mode", begin, *(Parameter(*each) for each in task.items()), costly=True)
    yield row("end_force_mode", end)

    def set_damping(damping: float) -> None:
        gains.damping = damping

    def set_scaling(scaling: float) -> None:
        gains.scaling = scaling

    yield row("force_mode_set_damping", set_damping, Parameter("damping", up_to(1.0)))
    yield row("force_mode_set_gain_scaling", set_scaling, Parameter("scaling", up_to(2.0)))


def _freedrive(controller: Controller) -> Iterable[Function]:
    robot = controller.robot

    def begin(free: Bool[np.ndarray, "6"], feature: Pose | str) -> None:
        if feature == "tool":
            R_BC = controller.tool_pose(robot.commanded[0])[:3, :3]
        else:
            R_BC = feature.matrix[:3, :3] if isinstance(feature, Pose) else np.eye(3)
        controller.motion = Freedrive(robot, controller.X_FT, free, R_BC)

    def end() -> None:
        if controller.freedrive:
            controller.motion = Braking(robot)

    def status() -> int:
        """Of freedrive along chosen axes; 0 in any other."""
        mode = controller.motion
        if not (isinstance(mode, Freedrive) and mode.constrained):
            return 0
        return freedrive.singularity(
            motion.tool_jacobian(robot.calibration, robot.commanded[0], controller.X_FT[:3, 3])
        )

    axes = Parameter("freeAxes", AXES, np.ones(6, bool))
    yield row("freedrive_mode", begin, axes, Parameter("feature", FEATURE, "base"), costly=True)
    yield row("end_freedrive_mode", end)
    yield row("teach_mode", lambda: begin(np.ones(6, bool), "base"))
    yield row("end_teach_mode", end)
    yield row("get_freedrive_status", status, costly=True)


def direct_torque(controller: Controller) -> Iterable[Function]:
    """The row, where the software's version has it."""
    version = controller.config.numbers

    def since(first: dict[int, tuple[int, ...]]) -> bool:
        return version[0] in first and version >= first[version[0]]

    def exert(
        torque: Vector6, viscous: Vector6 | None, coulomb: Vector6 | None, friction_comp: bool
    ) -> Iterable[None]:
        """One period; the older switch counts where no scale is given."""
        compensated = friction_comp or viscous is not None or coulomb is not None
        controller.motion = DirectTorque(
            controller.robot,
            torque,
            compensated * VISCOUS_SCALE if viscous is None else viscous,
            compensated * COULOMB_SCALE if coulomb is None else coulomb,
        )
        yield

    torque, switch = Parameter("torque", JOINTS), Parameter("friction_comp", CONDITION, True)
    scales = [Parameter(f"{kind}_scale", SCALES, None) for kind in ("viscous", "coulomb")]
    if since(FIRST_SCALES):
        yield row("direct_torque", exert, torque, *scales, switch)
    elif since(FIRST_TORQUES):
        # a client in use gives the scales by name to every software of generation 10
        named = scales if version[0] > 5 else []
        yield row(
            "direct_torque",
            lambda t, on, viscous=None, coulomb=None: exert(t, viscous, coulomb, on),
            torque, switch, *named,
        )  # fmt: skip


def _dynamics(controller: Controller) -> Iterable[Function]:
    """Of the arm and its tool, by default as they are now."""
    robot, arm = controller.robot, controller.robot.calibration
    q, qd = Parameter("q", JOINTS, None), Parameter("qd", JOINTS, None)
    tcp = Parameter("tcp", POSE, None)

    def now(q: Vector6 | None) -> Vector6:
        return controller.state.q if q is None else q

    def speed(qd: Vector6 | None) -> Vector6:
        return controller.state.qd if qd is None else qd

    def jacobian(q: Vector6 | None, tcp: Pose | None) -> np.ndarray:
        X_FT = controller.X_FT if tcp is None else tcp.matrix
        return motion.tool_jacobian(arm, now(q), X_FT[:3, 3])

    def derivative(q: Vector6 | None, qd: Vector6 | None, tcp: Pose | None) -> tuple:
        """By central differences along the motion."""
        step = DERIVATIVE_TIME * speed(qd)
        change = jacobian(now(q) + step, tcp) - jacobian(now(q) - step, tcp)
        return _matrix(change / (2 * DERIVATIVE_TIME))

    yield row("get_mass_matrix",
              lambda q, rotors: _matrix(robot.mass_matrix(now(q), rotors=rotors)), q,
              Parameter("include_rotors_inertia", CONDITION, True), costly=True)  # fmt: skip
    yield row("get_coriolis_and_centrifugal_torques",
              lambda q, qd: tuple(robot.velocity_torques(now(q), speed(qd)).tolist()), q, qd,
              costly=True)  # fmt: skip
    yield row("get_jacobian", lambda q, tcp: _matrix(jacobian(q, tcp)), q, tcp, costly=True)
    yield row("get_jacobian_time_derivative", derivative, q, qd, tcp, costly=True)


def _matrix(values: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, values.tolist()))
