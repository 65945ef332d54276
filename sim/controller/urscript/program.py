"""A program as it runs: flat code, and threads that take turns, each up to its next wait or the end
of its time.

Each routine is a list of steps, each a Python closure that says which one is next: a thread can be
left between any two of them and taken up again, and nothing recurses. [UR-script, "Thread
scheduling"]: a thread that uses up its slice of the period goes on in the next one.
"""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any

from sim.controller.urscript.values import ScriptError, Value

PERIOD_STEPS = 3000
"""Of all threads in a period: about half of it, if nothing in them is costly."""
SLICE = 0.01
"""Processor time of all threads in a period, after which what is costly waits for the next one as
well [s]: fifty times what a client's program takes, so that it never depends on the machine when
one ends."""
BETWEEN_LOOKS = 10
"""Steps between two checks of that time, if none is costly."""
DEEPEST_CALL = 100
"""Functions that call each other."""
MAX_THREADS = 50
"""Of a program in a period, those that end in it included."""
MAX_SLOTS = 10_000
"""Variables of all routines that have begun and not ended."""
MOVED = -1
WAITING = -2
LOOK = -3
"""In place of the next step: the thread is in another routine now; it waits for the next period;
what it did was costly, so that the clock is checked before the next step."""
UNSET = object()
"""What a variable holds before it has a value."""

Slots = list[Any]
"""A routine's variables, parameters first."""
Step = Callable[[Slots, "Thread"], int]


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


@dataclass
class Script:
    """A compiled program."""

    main: Code
    variables: Slots
    """The global ones."""
    secondary: bool = False
    """Whether it is one that runs beside another, and takes no time."""
    source: str = ""

    def begin(self) -> Slots:
        """Forget what an earlier run left; the main routine's variables."""
        self.variables[:] = [UNSET] * len(self.variables)
        return [UNSET] * self.main.slots


class Program:
    """A running program; the first thread is the main one, and its end is the program's."""

    def __init__(self, script: Script) -> None:
        """Begin."""
        self.name, self.source = script.main.name, script.source
        self.current = Thread(self, script.main, script.begin())
        """The thread whose turn it is."""
        self.alone: Thread | None = None
        """The thread in a critical section that does not wait: no other one has a turn."""
        self.suspended = False
        """Whether nobody has a turn until this is False again."""
        self._main, self._variables = self.current, script.variables
        self._threads = [self.current]
        self._slots = script.main.slots
        """Variables of all routines that have begun."""

    @property
    def running(self) -> bool:
        """Whether the main thread has not ended."""
        return self._main.alive

    def step(self) -> None:
        """One period: a turn for every thread, while there is time; those that start in it have
        theirs as well.

        Raises:
            ScriptError: What the program does is not possible.
        """
        end, left = time.thread_time() + SLICE, PERIOD_STEPS
        for k, thread in enumerate(self._threads):
            if not thread.alive or self.alone not in (None, thread):
                continue
            self.current = thread
            left -= thread.turn(left // (len(self._threads) - k), end)
            if not self.running or self.suspended:
                return
            if time.thread_time() > end:
                # the others begin the next period
                self._threads = self._threads[k + 1 :] + self._threads[: k + 1]
                break
        self._threads = [thread for thread in self._threads if thread.alive]

    def end(self) -> None:
        """Stop all threads."""
        for thread in self._threads:
            thread.end()
        # the script may be kept, what it knew may be large
        self._variables[:] = [UNSET] * len(self._variables)

    def start(self, code: Code, slots: Slots) -> "Thread":
        """A new thread.

        Raises:
            ScriptError: There are too many.
        """
        if len(self._threads) >= MAX_THREADS:
            raise ScriptError(f"a program has {MAX_THREADS} threads at most")
        self.grow(len(slots))
        thread = Thread(self, code, slots)
        self._threads.append(thread)
        return thread

    def grow(self, slots: int) -> None:
        """Count variables that come, or go.

        Raises:
            ScriptError: There are too many.
        """
        self._slots += slots
        if self._slots > MAX_SLOTS:
            raise ScriptError(f"a program has {MAX_SLOTS} variables at once at most")


class Thread:
    """One thread of a program: what the compiler's steps run on."""

    def __init__(self, program: Program, code: Code, slots: Slots) -> None:
        self._program = program
        self._code = code
        self._slots = slots
        self._at = 0
        """The step that comes next."""
        self._callers: list[tuple[Code, Slots, int, int]] = []
        """Routines that wait for this one: their step that comes next, and the slot for what they
        get."""
        self._waiting: Generator[None, None, Value] | None = None
        """A function of the controller that takes time."""
        self._back, self._result = 0, 0
        """The step behind it, and the slot for what it gives back."""
        self._critical = False
        """Whether it is in a critical section."""
        self._children: list[Thread] = []
        """That it has started, and that end with it where it is killed."""
        self.alive = True

    def __str__(self) -> str:
        return f"thread {self._code.name}"

    def turn(self, steps: int, end: float) -> int:
        """Go on to the next wait; so many steps at most, and until `end` of the processor's time
        [s]. How many it took.

        Raises:
            ScriptError: What the thread does is not possible; with its line.
        """
        taken = 0
        try:
            while taken < steps and self._waited():
                taken += self._go(min(BETWEEN_LOOKS, steps - taken))
                if time.thread_time() > end:
                    break
        except ScriptError as error:
            error.line = error.line or self._line
            raise
        # the border: whatever a program brings about ends it, and no more
        except Exception as error:
            raise ScriptError(str(error) or repr(error), error, self._line) from error
        return taken

    def end(self) -> None:
        """Stop it where it is."""
        if not self.alive:
            return
        self.alive = False
        self.critical(False)
        self._program.grow(-len(self._slots) - sum(len(slots) for _, slots, _, _ in self._callers))
        if self._waiting is not None:
            self._waiting.close()
            self._waiting = None

    # ---- what steps do ----

    def enter(self, code: Code, slots: Slots, back: int, result: int) -> int:
        """Go into a routine; its value goes to the slot `result` of this one, which goes on at
        the step `back`.
        """
        if len(self._callers) >= DEEPEST_CALL:
            raise ScriptError(f"functions call each other more than {DEEPEST_CALL} deep")
        self._program.grow(len(slots))
        self._callers.append((self._code, self._slots, back, result))
        self._code = code
        self._slots = slots
        self._at = 0
        return MOVED

    def leave(self, value: Value) -> int:
        """Go back to where the present routine was called; the thread's end, if it was not."""
        if not self._callers:
            self.end()
            return WAITING
        self._program.grow(-len(self._slots))
        self._code, self._slots, self._at, result = self._callers.pop()
        self._slots[result] = value
        return MOVED

    def wait(self, waiting: Generator[None, None, Value], back: int, result: int) -> int:
        """Wait until a function is done, then go on at the step `back`, likewise. Others have
        their turns meanwhile, also in a critical section [UR-script, "Threads"].
        """
        self._waiting = waiting
        self._back = back
        self._result = result
        self._hold(False)
        return WAITING

    def peek(self, back: int) -> int:
        """Look at the clock, then go on at the step `back`."""
        self._at = back
        return LOOK

    def start(self, code: Code, slots: Slots) -> "Thread":
        """A new thread of the program."""
        thread = self._program.start(code, slots)
        self._children = [*(child for child in self._children if child.alive), thread]
        return thread

    def stop(self, thread: Value) -> bool:
        """End a thread and those that it has started, where it is one: clients in use kill what
        they have not run. Whether this one goes on.
        """
        if isinstance(thread, Thread):
            thread.end()
            for child in thread._children:
                self.stop(child)
            thread._children = []
        return self.alive

    def join(self, thread: Value) -> Generator[None, None, None]:
        """Wait for a thread's end, where it is one: clients in use join what they have not run."""
        while isinstance(thread, Thread) and thread.alive:
            yield

    def critical(self, inside: bool) -> None:
        """Keep the others from running, but while this one waits, or no longer."""
        self._critical = inside
        self._hold(inside)

    def _hold(self, alone: bool) -> None:
        if alone or self._program.alone is self:
            self._program.alone = self if alone else None

    def halt(self) -> int:
        """End the program."""
        self._program.end()
        return WAITING

    # ---- going on ----

    @property
    def _line(self) -> int:
        return self._code.lines[self._at]

    def _waited(self) -> bool:
        """Whether it can go on: it neither has ended nor waits for the next period. Where it has
        brought a stop about, nothing that takes time begins.
        """
        if self._waiting is not None and self._program.suspended:
            return False
        if self._waiting is not None:
            try:
                next(self._waiting)
                return False
            except StopIteration as done:
                self._waiting, self._at = None, self._back
                self._slots[self._result] = done.value
                self._hold(self._critical)
        return self.alive

    def _go(self, max_steps: int) -> int:
        """So many steps at most, up to a wait. How many were taken."""
        steps = self._code.steps
        slots = self._slots
        at = self._at
        try:
            for taken in range(1, max_steps + 1):
                following = steps[at](slots, self)
                if following >= 0:
                    at = following
                elif following == MOVED:
                    steps = self._code.steps
                    slots = self._slots
                    at = self._at
                else:
                    at = self._at if following == LOOK else at
                    return taken
            return max_steps
        finally:
            self._at = at  # of the step that failed, where one did
