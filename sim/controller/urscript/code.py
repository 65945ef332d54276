"""Flat code: for each routine a list of steps, each a Python closure that says which one is next.

A thread can be left between any two steps and taken up again, and nothing recurses while a program runs.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, Protocol

from sim.controller.urscript.values import ScriptError, Value, truth

MOVED, WAITING, LOOK = -1, -2, -3
"""In place of the next step: the thread is in another routine now; it waits for the next period; what
it did was costly, so that the clock is looked at before the next step."""
UNSET = object()
"""What a variable holds before it has a value."""

Slots = list[Any]
"""A routine's variables, parameters first."""
Evaluate = Callable[[Slots], Value]
Step = Callable[[Slots, "Machine"], int]
Jump = tuple[int, Callable[[int], Step]]
"""Where a jump stands whose target is not known yet, and what makes it a step."""


class Machine(Protocol):
    """The thread that runs the code."""

    def enter(self, code: "Code", slots: Slots, back: int, result: int) -> int:
        """Go into a routine; its value goes to the slot `result` of this one, which goes on at the step `back`."""
        ...

    def leave(self, value: Value) -> int:
        """Go back to where the present routine was called."""
        ...

    def wait(self, waiting: Generator[None, None, Value], back: int, result: int) -> int:
        """Wait until a function is done, then go on likewise."""
        ...

    def look(self, back: int) -> int:
        """Look at the clock, then go on at the step `back`."""
        ...

    def start(self, code: "Code", slots: Slots) -> Value:
        """A new thread."""
        ...

    def stop(self, thread: Value) -> bool:
        """End a thread; whether this one goes on."""
        ...

    def join(self, thread: Value) -> Generator[None, None, None]:
        """Wait for a thread's end."""
        ...

    def critical(self, inside: bool) -> None:
        """Keep the others from running, or no longer."""
        ...

    def halt(self) -> int:
        """End the program."""
        ...


@dataclass
class Code:
    """A routine that can be run."""

    name: str
    kind: str
    parameters: list[str] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    """Of the program, for each step."""
    slots: int = 0
    """How many variables it has, those without names included."""


@dataclass(frozen=True)
class Script:
    """A compiled program."""

    main: Code
    variables: Slots
    """The global ones."""

    def begin(self) -> Slots:
        """Forget what an earlier run left; the main routine's variables."""
        self.variables[:] = [UNSET] * len(self.variables)
        return [UNSET] * self.main.slots


class Writer:
    """Writes the steps of one routine."""

    def __init__(self, code: Code, variables: int, line: int) -> None:
        """Begin.

        Args:
            code: What is written.
            variables: How many of the routine have names.
            line: Of the program, where the routine begins.
        """
        self._code, self._variables = code, variables
        self.line = line
        """Of the statement that is being written."""
        self._nameless = variables
        code.slots = variables

    def begin_statement(self, line: int) -> None:
        """The next steps are another statement's."""
        self.line = line or self.line
        self._nameless = self._variables

    @property
    def following(self) -> int:
        """The step behind the next one."""
        return len(self._code.steps) + 1

    def emit(self, step: Step) -> None:
        """Write a step."""
        self._code.steps.append(step)
        self._code.lines.append(self.line)

    def new_slot(self) -> int:
        """A variable without a name, free until the statement is done."""
        self._nameless += 1
        self._code.slots = max(self._code.slots, self._nameless)
        return self._nameless - 1

    def keep(self, at: int, value: Evaluate) -> None:
        """Compute a value and keep it in a slot."""
        following = self.following

        def step(slots: Slots, machine: Machine) -> int:
            slots[at] = value(slots)
            return following

        self.emit(step)

    def jump(self) -> Jump:
        """Go to where it will `land`."""
        return self._unfinished(lambda target: lambda slots, machine: target)

    def jump_unless(self, condition: Evaluate) -> Jump:
        """The same, unless a condition holds."""
        following = self.following

        def to(target: int) -> Step:
            def step(slots: Slots, machine: Machine) -> int:
                value = condition(slots)
                if value is True:
                    return following
                return following if value is not False and truth(value) else target

            return step

        return self._unfinished(to)

    def land(self, jump: Jump) -> None:
        """Here is where a jump goes."""
        at, to = jump
        self._code.steps[at] = to(len(self._code.steps))

    def error(self, message: str, line: int = 0) -> ScriptError:
        """What is wrong with the present statement."""
        return ScriptError(message, None, line or self.line)

    def _unfinished(self, to: Callable[[int], Step]) -> Jump:
        self.emit(to(0))
        return len(self._code.steps) - 1, to
