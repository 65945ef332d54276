"""A UR controller without its sockets: modes and stops, registers, one program, one motion, and
the arm they move.
"""

import re
from collections import OrderedDict, deque
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import RobotError
from breastscan.robot.payload import Payload
from breastscan.robot.ur.ur5e import PERIOD
from sim.controller import motion
from sim.controller.config import ControllerConfig
from sim.controller.force_mode import ForceGains, ForceMode
from sim.controller.freedrive import DirectTorque, Freedrive
from sim.controller.messages import Key, Message, Popup, ProgramError, SafetyChange
from sim.controller.motion import (
    Braking,
    ImpossibleMotion,
    JointSpeed,
    Motion,
    Servo,
    ToolSpeed,
    Yielding,
)
from sim.controller.sockets import Sockets
from sim.controller.states import (
    EMERGENCY_STOPS,
    POWERING_UP,
    Cause,
    RobotMode,
    Runtime,
    Safety,
)
from sim.controller.supervision import LIMITS, SAFE_DECELERATION, Supervision, outside
from sim.controller.urscript.compiler import load
from sim.controller.urscript.program import Program, Script, Thread
from sim.controller.urscript.signature import Function
from sim.controller.urscript.values import SHOWN, ScriptError, first_column
from sim.controller.variables import BIT_WORDS, BITS, INPUTS, REGISTERS, Held, zero
from sim.robot import SimRobot
from sim.wrist.probe import payload

LOOPBACK = "127.0.0.1"
PRESSED = (Cause.COLLISION, Cause.DEVIATION)
"""Causes after which the arm yields."""
RELEASED = (*EMERGENCY_STOPS, Safety.SAFEGUARD_STOP)
"""What ends when somebody releases it."""
POWER_STEP = 0.1
"""Between two modes on the way to power [s]; assumed."""
UNLOCK_AFTER = 5.0
"""Time before a protective stop may be unlocked [s]."""
SLIDER_RATE = 0.01
"""Change of the speed scaling in a period [-]."""
HISTORY = 1000
"""Periods whose joint angles a program may ask for."""
LOADED_WORDS = 150
"""Words of a program that are taken in a period: about a millisecond, so that no cycle waits for a
long one."""
WAITING_PROGRAMS = 16
"""Of one client that have come in and are not loaded yet; what comes beyond is dropped."""
REMEMBERED_PROGRAMS, REMEMBERED_LENGTH = 16, 100_000
"""That need not be loaded again, and how many characters such a one has at most."""
SECONDARY = re.compile(r"sec\b")
"""How a secondary program begins."""
UNTOLD_MESSAGES = 64
"""That are kept until the clients are told, the latest."""


@dataclass
class Watchdog:
    """Stops the program unless a register is written often enough."""

    longest: float
    """Time between writings [s]."""
    stops: bool
    """Whether it stops the program, else it pauses it."""
    armed: float
    """When it was set [s]."""


@dataclass
class _Loading:
    """A program on its way in."""

    source: str
    words: Generator[None, None, Script]
    """Loads it, a word a turn."""
    address: str
    """Of the machine that sent it."""


class Controller:
    """Steps the simulated arm by one period a `cycle`, as its program and its inputs want."""

    functions: Mapping[str, Function]
    """What programs can call; whoever puts the controller together says it."""

    def __init__(
        self,
        robot: SimRobot,
        config: ControllerConfig,
        mount_angle: float,
        tell: Callable[[str], None],
    ) -> None:
        """Switch on.

        Args:
            robot: The arm.
            config: What to pretend.
            mount_angle: Of the probe [rad], for the payload that is set up.
            tell: Is told what an operator would want to know.
        """
        self.robot = robot
        self.config = config
        self.tell = tell
        self.inputs: dict[str, Held] = {name: zero(kind) for name, kind in INPUTS.items()}
        self._written: dict[str, float] = {}
        self.heeded: set[str] = set()
        """Inputs that the program has read."""
        self.out_ints, self.out_doubles = [0] * REGISTERS, [0.0] * REGISTERS
        self.out_bits = [False] * BITS
        self.runtime = Runtime.STOPPED
        self.mode = RobotMode.RUNNING
        self.supervision = Supervision(robot)
        self._reduced = False
        """Whether the limits of reduced mode are asked for."""
        self.safety = Safety.RECOVERY if outside(robot.state().q) else Safety.NORMAL
        self.scaling, self.slider = 1.0, 1.0
        self._wanted_mode = self.mode
        self._told_safety = self.safety
        self.digital_outputs, self.analog_outputs = 0, [0.0, 0.0]
        self.digital_inputs, self.analog_inputs = 0, [0.0] * 4
        """Bits: 8 standard, 8 configurable, 2 of the tool; levels: 2 standard, 2 of the tool
        [V]."""
        self.flags, self.tool_voltage = 0, 0
        self.analog_types = 0b1111
        """Bits: 2 inputs, 2 outputs, 2 inputs of the tool; whether a level is a voltage, else it is
        a current."""
        self.popup: Popup | None = None
        """What the operator sees; a program that waits for him goes on once it is None."""
        self.X_FT = robot.X_FP.copy()
        """Pose of the tool centre point in the flange."""
        self.payload, self.inertia = payload(mount_angle), [0.0] * 6
        self._next_payload, self._payload_time = self.payload, 0.0
        """What the payload changes to, and the time left [s]."""
        self.force_gains = ForceGains()
        self.compliance: ForceMode | None = None
        """Force mode, while it is on."""
        self.remote_control = config.remote_control
        self.state = robot.state()
        """The latest sample that the physics gave."""
        self.motion: Motion = motion.hold
        self._interrupted: Motion | None = None
        """By a pause; None while the program goes on."""
        self.owner: Thread | None = None
        """Thread that moves the arm."""
        self.program: Program | None = None
        self.program_from = LOOPBACK
        """Address of the machine that sent it, the only one that it may connect to."""
        self.sockets = Sockets()
        self.watchdogs: dict[str, Watchdog] = {}
        self.history: deque[np.ndarray] = deque(maxlen=HISTORY)
        self.periods = 0
        self._stopped_at = -UNLOCK_AFTER
        self.program_error = ""
        """Why the last program stopped, where it did not stop by itself."""
        self.messages: deque[Message] = deque(maxlen=UNTOLD_MESSAGES)
        """That the clients have not been told yet."""
        self.functions = {}
        self._loading: dict[object, deque[_Loading]] = {}
        """Programs that are not complete yet, by who sent them: each has its first one loaded in
        turn."""
        self._scripts: OrderedDict[str, Script] = OrderedDict()

    @property
    def time(self) -> float:
        """Since the controller was switched on [s]."""
        return self.periods * PERIOD

    @property
    def operational(self) -> bool:
        """Whether the arm may move."""
        return self.safety in LIMITS and self.mode is RobotMode.RUNNING

    @property
    def freedrive(self) -> bool:
        """Whether the arm can be moved by hand."""
        return isinstance(self.motion, Freedrive)

    @property
    def hears_the_network(self) -> bool:
        """Whether programs and orders are taken from there: older pendants cannot keep it out."""
        return self.remote_control or not self.config.e_series

    @property
    def streams(self) -> bool:
        """Whether the program follows targets as they come."""
        return isinstance(self.motion, Servo)

    def read_input(self, name: str) -> Held:
        """What a program reads."""
        self.heeded.add(name)
        return self.inputs[name]

    def input_bit(self, i: int) -> bool:
        """One of the boolean registers that clients write."""
        if i >= 64:
            return bool(self.inputs[f"input_bit_register_{i}"])
        word = self.inputs[BIT_WORDS["input"][i // 32]]
        return bool(int(word) >> i % 32 & 1)  # type: ignore[arg-type]

    def write(self, values: dict[str, Held]) -> None:
        """Take in inputs; the next period sees the newest."""
        self.inputs.update(values)
        self._written.update(dict.fromkeys(values, self.time))

    def cycle(self) -> None:
        """One period."""
        self.periods += 1
        self._take_inputs()
        if self.payload is not self._next_payload:
            self._change_payload(PERIOD)
        self._power_up()
        self._load()
        if self.runtime is Runtime.PLAYING and self._goes_on():
            self._check_watchdogs()
            self._run_program()
        self._move()
        if self.safety is not self._told_safety:
            self._told_safety = self.safety
            self.messages.append(SafetyChange(int(self.safety)))
        self.history.append(self.state.q)

    def run(self, source: str, sender: object = None, address: str = LOOPBACK) -> None:
        """Start a program or what stands outside of one, as soon as it is loaded: a secondary one
        beside the program that runs, any other one in its place.

        Args:
            source: The program, or the line.
            sender: Whose it is: those of one sender are loaded one after the other, those of
                several by turns.
            address: Of the machine that sent it.
        """
        command = source.strip()
        if command in _COMMANDS:
            _COMMANDS[command](self)
            return
        # that a secondary program, which moves nothing, runs in any mode is assumed
        if not self.operational and not SECONDARY.match(command):
            self.tell("a program was refused: the arm is not operational")
            return
        waiting = self._loading.setdefault(sender, deque())
        if len(waiting) >= WAITING_PROGRAMS:
            self.report(
                "a program was dropped",
                ScriptError(f"{WAITING_PROGRAMS} others of this client wait"),
            )
            return
        waiting.append(_Loading(source, load(source, self.functions), address))

    def stop_program(self, why: str) -> None:
        """End the program, and whatever waits to be one, and bring the arm to rest."""
        self._loading.clear()
        self._end_program(why)

    def pause(self) -> None:
        """Bring the arm to rest; `resume` goes on."""
        if self.runtime is Runtime.PLAYING:
            self.runtime = Runtime.PAUSED
            self._interrupted = self._interrupted or self.motion
            self.motion = Braking(self.robot)
            if self.program is not None:
                self.program.suspended = True

    def resume(self) -> bool:
        """Go on with a paused program once the arm is at rest, where that is possible."""
        possible = self.runtime is Runtime.PAUSED and self.operational
        if possible:
            self.runtime = Runtime.PLAYING
        return possible

    def protective_stop(self, why: str, cause: Cause = Cause.REQUESTED, joint: int = 0) -> None:
        """What a controller does that finds something wrong: rest, paused, until it is unlocked.

        Args:
            why: What was found.
            cause: Of it.
            joint: Where, from 0; of causes that name one.
        """
        if self.safety in LIMITS:
            self._tell_cause("protective stop", why, cause, joint)
            self.safety, self._stopped_at = Safety.PROTECTIVE_STOP, self.time
            self.pause()
            brake = Braking(self.robot, SAFE_DECELERATION)
            self.motion = Yielding(self.robot) if cause in PRESSED else brake

    def unlock(self, after: float = UNLOCK_AFTER) -> bool:
        """End a protective stop that is old enough [s]; a script port does not wait, which no
        manual says and the maker's clients rely on.
        """
        if self.safety is Safety.PROTECTIVE_STOP and self.time - self._stopped_at < after:
            return False
        if self.safety is Safety.PROTECTIVE_STOP:
            self._clear()
        return True

    def emergency_stop(self, kind: Safety = Safety.ROBOT_EMERGENCY_STOP) -> None:
        """Somebody hit the button, the robot's own or the system's: rest, and power off."""
        self._cut_power(kind, "emergency stop")

    def safeguard_stop(self) -> None:
        """Somebody opened a door: rest, paused, until it is closed."""
        if self.safety in LIMITS:
            self.safety = Safety.SAFEGUARD_STOP
            self.pause()
            self.motion = Braking(self.robot, SAFE_DECELERATION)

    def release(self) -> None:
        """The button is pulled out again, the door closed; the arm stays without power, the
        program paused.
        """
        if self.safety in RELEASED:
            self._clear()

    def reduce(self, on: bool) -> None:
        """Keep the limits of reduced mode, or those of normal mode again."""
        self._reduced = on
        if self.safety in (Safety.NORMAL, Safety.REDUCED):
            self._clear()

    def restart_safety(self) -> None:
        """After a violation or a fault; the arm stays without power."""
        self.power(RobotMode.POWER_OFF)
        self._clear()

    def power(self, mode: RobotMode) -> None:
        """Power off at once, or on, or on with the brakes released, by and by."""
        if mode is RobotMode.POWER_OFF:
            self.stop_program("power off")
            self.mode = self._wanted_mode = mode
        elif POWERING_UP.index(mode) > POWERING_UP.index(self._wanted_mode):
            self._wanted_mode = mode

    def arm_watchdog(self, variable: str, longest: float, *, stops: bool) -> None:
        """Arm a watchdog: at least every `longest` [s] the variable must be written, the same
        value counts.
        """
        self.watchdogs[variable] = Watchdog(longest, stops, self.time)

    def set_payload(self, mass: float, centre_F: Float[np.ndarray, "3"], over: float = 0.0) -> None:
        """Tell the robot what hangs on its wrist sensor [kg, m]; it changes evenly for so long
        [s].
        """
        self._next_payload = Payload(mass=mass, centre_F=centre_F)
        self._payload_time = over
        self._change_payload(0.0)

    def _change_payload(self, seconds: float) -> None:
        """So much of the way to a payload that is changing."""
        left, goal = self._payload_time, self._next_payload
        part = 1.0 if left <= seconds else seconds / left
        mass = self.payload.mass + part * (goal.mass - self.payload.mass)
        centre_F = self.payload.centre_F + part * (goal.centre_F - self.payload.centre_F)
        self.payload = goal if part == 1.0 else Payload(mass=mass, centre_F=centre_F)
        self._payload_time = left - seconds
        self.robot.set_payload(self.payload)

    def zero_wrench(self) -> None:
        """Take the wrench for zero, as it is; in lockstep noise, drift and breath begin there."""
        if self.config.clock == "lockstep":
            self.robot.restart()
        self.robot.zero_wrench()
        self.state = self.robot.state()

    def tool_pose(self, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
        """X_BT at joint angles [rad]."""
        return self.robot.calibration.forward(q) @ self.X_FT

    def tool_speed(
        self, q: Float[np.ndarray, "6"], qd: Float[np.ndarray, "6"]
    ) -> Float[np.ndarray, "6"]:
        """Linear and angular velocity of the tool in B [m/s, rad/s] at joint angles [rad]
        and speeds [rad/s].
        """
        return motion.tool_jacobian(self.robot.calibration, q, self.X_FT[:3, 3]) @ qd

    def tool_wrench_B(self) -> Float[np.ndarray, "6"]:
        """What acts on the tool in basis B, about the tool centre point, force first [N, N m]."""
        state = self.state
        X_BF = self.robot.calibration.forward(state.q)
        R_BP = (X_BF @ self.robot.X_FP)[:3, :3]
        force, moment = R_BP @ state.wrench_P[:3], R_BP @ state.wrench_P[3:]
        lever_B = X_BF[:3, :3] @ (self.robot.X_FP[:3, 3] - self.X_FT[:3, 3])
        return np.concatenate([force, moment + motion.cross_matrix(lever_B) @ force])

    def _power_up(self) -> None:
        """One mode on, when it is time."""
        if self.safety not in LIMITS:
            self._wanted_mode = self.mode
        if self.mode is not self._wanted_mode and self.periods % round(POWER_STEP / PERIOD) == 0:
            self.mode = POWERING_UP[POWERING_UP.index(self.mode) + 1]

    def _load(self) -> None:
        """Go on with a program that has come in; once it is complete, start it."""
        if not self._loading:
            return
        sender, waiting = next(iter(self._loading.items()))
        del self._loading[sender]
        try:
            script = self._read(waiting[0])
        except ScriptError as error:
            self.report("a program was refused", error, waiting.popleft().source)
        else:
            if script is not None:
                self._start(script, waiting[0].address)
                waiting.popleft()
        if waiting:
            self._loading[sender] = waiting  # as the last of all

    def _read(self, loading: "_Loading") -> Script | None:
        """So much of a program as a period has time for; the whole once it is there."""
        known = self._scripts.get(loading.source)
        if known is not None:
            return known
        try:
            for _ in range(LOADED_WORDS):
                next(loading.words)
        except StopIteration as done:
            if len(loading.source) <= REMEMBERED_LENGTH:
                self._scripts[loading.source] = done.value
            if len(self._scripts) > REMEMBERED_PROGRAMS:
                self._scripts.popitem(last=False)
            return done.value
        return None

    def _start(self, script: Script, address: str) -> None:
        if script.secondary:
            self._run_secondary(script)
            return
        self._end_program("another program")
        if self.operational:
            self.program, self.program_from = Program(script), address
            self.runtime = Runtime.PLAYING
            self.program_error = ""
            self.heeded.clear()
            self.messages.append(Key("PROGRAM_XXX_STARTED", script.main.name))

    def _run_secondary(self, script: Script) -> None:
        """In a period, beside the program that runs [UR-script, "Secondary Programs"]."""
        program = Program(script)
        try:
            program.step()
            if program.running:
                raise ScriptError("a secondary program ends within a period", script.main.name, 1)
        except ScriptError as error:
            error.told = f"SECONDARY_PROGRAM_EXCEPTION_XXX{error.told}"
            self._tell_error(f"secondary program {program.name[:SHOWN]}", error, script.source)
        finally:
            program.end()

    def _end_program(self, why: str) -> None:
        if self.program is not None:
            self.program.end()
            self.tell(f"program {self.program.name[:SHOWN]} ended: {why}")
            self.messages.append(Key("PROGRAM_XXX_STOPPED", self.program.name))
        self.program, self.owner = None, None
        self._interrupted, self.compliance = None, None
        self.sockets.close_all()
        self.watchdogs.clear()
        if self.runtime is not Runtime.STOPPED:
            self.motion = Braking(self.robot)
        self.runtime = Runtime.STOPPED

    def report(self, what: str, error: ScriptError, source: str = "") -> None:
        """Tell everyone what is wrong with a program."""
        self.program_error = f"line {error.line}: {error}"
        self._tell_error(what, error, source)

    def _tell_error(self, what: str, error: ScriptError, source: str) -> None:
        column = error.column or first_column(source, error.line)
        self.messages.append(ProgramError(error.told, error.line, column))
        self.tell(f"{what}: line {error.line}: {error}")

    def _move(self) -> None:
        """A period of the arm."""
        if self.safety is Safety.FAULT:
            return
        try:
            pace = 1.0 if self.streams else self.supervision.pace
            if not self._go_on(pace * self.scaling):
                self.motion = motion.hold
            self.state = self.robot.state()
            self._supervise()
        except (ImpossibleMotion, ArithmeticError, ValueError) as error:  # nothing has moved yet
            cause = error.cause if isinstance(error, ImpossibleMotion) else Cause.SETPOINT
            self.protective_stop(str(error), cause)
            self.motion = Braking(self.robot, SAFE_DECELERATION)
            self._move()
        except RobotError as error:  # the physics has come to no solution, and does not go on
            self.stop_program("a fault")
            self.safety, self.mode = Safety.FAULT, RobotMode.POWER_OFF
            self.tell(f"the simulation has failed, start the twin anew: {error}")

    def _supervise(self) -> None:
        """Stop the arm where something is wrong with what it does."""
        recovers = self.safety is Safety.RECOVERY
        if recovers and not outside(self.state.q):
            self._clear()
        limits = LIMITS.get(self.safety, LIMITS[Safety.NORMAL])
        finding = self.supervision.check(limits, recovers=recovers)
        if finding is None:
            return
        cause, joint, why = finding
        if not self.operational:  # what it meets on its way to rest counts alone
            if cause in PRESSED and isinstance(self.motion, Braking):
                self.motion = Yielding(self.robot)
        elif cause.violates:
            self._tell_cause("violation", why, cause, joint)
            self._cut_power(Safety.VIOLATION, why)
        else:
            self.protective_stop(why, cause, joint)

    def _tell_cause(self, what: str, why: str, cause: Cause, joint: int) -> None:
        code = cause.code(why, joint)
        self.messages.append(code)
        self.tell(f"{what} C{code.code}A{code.argument}: {why}")

    def _cut_power(self, safety: Safety, why: str) -> None:
        """End the program, rest, and the brakes hold the arm."""
        self.stop_program(why)
        self.safety, self.mode = safety, RobotMode.POWER_OFF
        self.motion = Braking(self.robot, SAFE_DECELERATION)

    def _clear(self) -> None:
        """Nothing stops the arm any more."""
        normal = Safety.REDUCED if self._reduced else Safety.NORMAL
        self.safety = Safety.RECOVERY if outside(self.state.q) else normal

    def _goes_on(self) -> bool:
        """Whether the program has a turn: after a pause as soon as the arm is at rest.

        A motion at a speed is taken up then; any other one was to end somewhere, and is planned
        anew by whoever finds the arm `Braking`.
        """
        if self._interrupted is None:
            return True
        if np.abs(self.robot.commanded[1]).max() > 0:
            return False
        at_speed = isinstance(self._interrupted, JointSpeed | ToolSpeed)
        self.motion = self._interrupted if at_speed else Braking(self.robot)
        self._interrupted = None
        if self.program is not None:
            self.program.suspended = False
        return True

    def _go_on(self, scaling: float) -> bool:
        """A period of the motion, or of what force mode makes of it; whether it goes on."""
        holds = not isinstance(self.motion, Freedrive | DirectTorque)
        if self.compliance is None or self.runtime is not Runtime.PLAYING or not holds:
            return self.motion(self.robot, scaling)
        wrench_B = self.tool_wrench_B()
        return self.compliance.move(self.motion, self.robot, scaling, self.X_FT, wrench_B)

    def _take_inputs(self) -> None:
        """Slider and outputs, where their masks say so."""
        inputs = self.inputs
        if inputs["speed_slider_mask"]:
            fraction = float(inputs["speed_slider_fraction"])  # type: ignore[arg-type]
            self.slider = min(max(fraction, 0.0), 1.0)
        self.scaling += min(max(self.slider - self.scaling, -SLIDER_RATE), SLIDER_RATE)
        for kind, shift in (("standard", 0), ("configurable", 8), ("tool", 16)):
            mask = int(inputs[f"{kind}_digital_output_mask"])  # type: ignore[arg-type]
            if mask:
                values = int(inputs[f"{kind}_digital_output"]) & mask  # type: ignore[arg-type]
                self.digital_outputs = self.digital_outputs & ~(mask << shift) | values << shift
        for i in range(2):
            if int(inputs["standard_analog_output_mask"]) >> i & 1:  # type: ignore[arg-type]
                value = inputs[f"standard_analog_output_{i}"]
                self.analog_outputs[i] = float(value)  # type: ignore[arg-type]

    def _check_watchdogs(self) -> None:
        for name, dog in list(self.watchdogs.items()):
            if self.time - max(self._written.get(name, 0.0), dog.armed) > dog.longest:
                if dog.stops:
                    self.stop_program(
                        f"the watchdog: nothing was written to {name} for {dog.longest:.3f} s"
                    )
                else:
                    self.pause()

    def _run_program(self) -> None:
        if self.program is None:
            return
        try:
            self.program.step()
        except ScriptError as error:
            program = self.program
            self.report(f"program {program.name[:SHOWN]}", error, program.source)
            self._end_program("an error")
            return
        if self.program is not None and not self.program.running:
            self._end_program("its end")


_COMMANDS: dict[str, Callable[[Controller], object]] = {
    "stop program": lambda controller: controller.stop_program("a script port"),
    "pause program": Controller.pause,
    "resume program": Controller.resume,
    "set unlock protective stop": lambda controller: controller.unlock(after=0.0),
    "power on": lambda controller: controller.power(RobotMode.IDLE),
    "power off": lambda controller: controller.power(RobotMode.POWER_OFF),
    "set robotmode run": lambda controller: controller.power(RobotMode.RUNNING),
}
"""Lines that are no program."""
