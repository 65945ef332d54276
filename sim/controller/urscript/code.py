"""Writes flat code, a step at a time."""

from collections.abc import Callable

from sim.controller.urscript.program import Code, Slots, Step, Thread
from sim.controller.urscript.values import ScriptError, Value, truth

Evaluate = Callable[[Slots], Value]
Jump = tuple[int, Callable[[int], Step]]
"""Where a jump stands whose target is not known yet, and what makes it a step."""


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

        def step(slots: Slots, thread: Thread) -> int:
            slots[at] = value(slots)
            return following

        self.emit(step)

    def jump(self) -> Jump:
        """Go to where it will `land`."""
        return self._unfinished(lambda target: lambda slots, thread: target)

    def jump_unless(self, condition: Evaluate) -> Jump:
        """The same, unless a condition holds."""
        following = self.following

        def to(target: int) -> Step:
            def step(slots: Slots, thread: Thread) -> int:
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
