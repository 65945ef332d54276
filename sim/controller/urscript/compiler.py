"""A program's tree to flat code: what each statement does. `expressions` has what it computes,
`code` writes.
"""

from collections.abc import Generator, Mapping

from sim.controller.urscript import syntax
from sim.controller.urscript.code import Evaluate, Jump, Writer
from sim.controller.urscript.expressions import Expressions, constant
from sim.controller.urscript.program import UNSET, WAITING, Code, Script, Slots, Thread
from sim.controller.urscript.signature import Function
from sim.controller.urscript.syntax import Expression, Routine, parse
from sim.controller.urscript.values import ScriptError, with_element
from sim.controller.urscript.world import World, assigned, statements

MAX_VARIABLES = 1000
"""Of a routine, and of all routines together the global ones."""


def load(source: str, functions: Mapping[str, Function]) -> Generator[None, None, Script]:
    """Make a program of a text; waits often, since that may take many periods.

    Raises:
        ScriptError: It is no program, or calls what is not there.
    """
    tree = yield from parse(source)
    return (yield from compile_program(tree, functions))


def compile_program(
    program: Routine, functions: Mapping[str, Function]
) -> Generator[None, None, Script]:
    """Compile a tree; waits after every statement.

    Args:
        program: The tree.
        functions: What it may call of the controller.

    Raises:
        ScriptError: It calls what does not exist, reads what is never assigned, or nests too deep.
    """
    if program.kind == "thread":
        raise ScriptError(
            f"a program begins with `def name():`, got thread {program.name}", None, program.line
        )
    if program.parameters:
        raise ScriptError(
            f"a program has no parameters, got {len(program.parameters)}", None, program.line
        )
    routines: dict[str, Routine] = {}
    shared: dict[str, int] = {}
    for level, statement in statements(program.body, 1):
        if isinstance(statement, Routine):
            routines[statement.name] = statement
        name = assigned(statement)
        if name and (
            level == 1
            or (isinstance(statement, syntax.Declaration) and statement.scope == "global")
        ):
            shared.setdefault(name, len(shared))
        yield
    if len(shared) > MAX_VARIABLES:
        raise ScriptError(
            f"a program has {MAX_VARIABLES} global variables at most", None, program.line
        )
    world = World(functions, routines, shared, [UNSET] * len(shared))
    codes = world.codes
    codes[program.name] = main = Code(program.name, "main")
    for name, routine in routines.items():
        codes[name] = Code(name, routine.kind, [parameter for parameter, _ in routine.parameters])
    yield from _Statements(world, main, program).write()
    for name, routine in routines.items():
        yield from _Statements(world, codes[name], routine).write()
    return Script(main, world.variables)


class _Statements:
    """Of one routine."""

    def __init__(self, world: World, code: Code, routine: Routine) -> None:
        self._world, self._routine = world, routine
        self._locals: dict[str, int] = {name: i for i, name in enumerate(code.parameters)}
        if code.kind != "main":
            self._bind()
        self._writer = Writer(code, len(self._locals), routine.line)
        self._expressions = Expressions(world, self._writer, self._locals)
        self._loops: list[tuple[int, list[Jump]]] = []
        """Of the open loops: where they begin, and the jumps to their ends."""

    def _bind(self) -> None:
        """Find the variables of this routine alone: [UR-script, "Scoping rules"]."""
        own = [statement for level, statement in statements(self._routine.body, 1) if level == 1]
        shared = {s.name for s in own if isinstance(s, syntax.Declaration) and s.scope == "global"}
        alone = {s.name for s in own if isinstance(s, syntax.Declaration) and s.scope == "local"}
        for name in filter(None, map(assigned, own)):
            if name in alone or (name not in self._world.shared and name not in shared):
                self._locals.setdefault(name, len(self._locals))

    def write(self) -> Generator[None, None, None]:
        """Write the code."""
        if len(self._locals) > MAX_VARIABLES:
            raise self._writer.error(f"a routine has {MAX_VARIABLES} variables at most")
        yield from self._block(self._routine.body)
        self._writer.emit(lambda slots, thread: thread.leave(None))

    def _block(self, block: syntax.Block) -> Generator[None, None, None]:
        for statement in block:
            self._writer.begin_statement(statement.line)
            yield from self._statement(statement)
            yield

    def _statement(self, statement: syntax.Statement) -> Generator[None, None, None]:
        match statement:
            case syntax.Evaluation():
                self._evaluation(statement.value)
            case syntax.Assignment():
                self._assignment(statement)
            case syntax.Declaration():
                if statement.value is not None:
                    self._store(statement.name, self._expressions.value(statement.value))
            case syntax.Condition():
                yield from self._condition(statement)
            case syntax.Loop():
                yield from self._loop(statement)
            case syntax.Return():
                value = (
                    constant(None)
                    if statement.value is None
                    else self._expressions.value(statement.value)
                )
                self._writer.emit(lambda slots, thread: thread.leave(value(slots)))
            case syntax.Word():
                self._word(statement.word)
            case syntax.ThreadEnd():
                self._thread_end(statement.word, self._expressions.value(statement.thread))

    def _evaluation(self, expression: Expression) -> None:
        value, following = self._expressions.value(expression), self._writer.following

        def step(slots: Slots, thread: Thread) -> int:
            value(slots)
            return following

        self._writer.emit(step)

    def _assignment(self, statement: syntax.Assignment) -> None:
        if not statement.places:
            self._store(statement.name, self._expressions.value(statement.value))
            return
        *places, new = self._expressions.values((*statement.places, statement.value))
        old = self._expressions.variable(statement.name)
        self._store(
            statement.name,
            lambda slots: with_element(old(slots), [place(slots) for place in places], new(slots)),
        )

    def _store(self, name: str, value: Evaluate) -> None:
        at = self._locals.get(name)
        if at is not None:
            self._writer.keep(at, value)
            return
        following = self._writer.following
        variables, place = self._world.variables, self._world.shared[name]

        def step(slots: Slots, thread: Thread) -> int:
            variables[place] = value(slots)
            return following

        self._writer.emit(step)

    def _condition(self, statement: syntax.Condition) -> Generator[None, None, None]:
        ends = []
        for test, block, line in statement.branches:
            self._writer.line = line
            jump = self._writer.jump_unless(self._expressions.value(test))
            yield from self._block(block)
            ends.append(self._writer.jump())
            self._writer.land(jump)
        yield from self._block(statement.otherwise)
        for end in ends:
            self._writer.land(end)

    def _loop(self, statement: syntax.Loop) -> Generator[None, None, None]:
        begin = self._writer.following - 1
        out = self._writer.jump_unless(self._expressions.value(statement.condition))
        self._loops.append((begin, []))
        yield from self._block(statement.body)
        self._writer.line = statement.line
        self._writer.emit(lambda slots, thread: begin)
        _, breaks = self._loops.pop()
        for jump in [out, *breaks]:
            self._writer.land(jump)

    def _word(self, word: str) -> None:
        following = self._writer.following
        if word in ("break", "continue"):
            if not self._loops:
                raise self._writer.error(f"{word} stands outside of a loop")
            begin, breaks = self._loops[-1]
            if word == "break":
                breaks.append(self._writer.jump())
            else:
                self._writer.emit(lambda slots, thread: begin)
        elif word == "halt":
            self._writer.emit(lambda slots, thread: thread.halt())
        elif word in ("enter_critical", "exit_critical"):
            inside = word == "enter_critical"

            def step(slots: Slots, thread: Thread) -> int:
                thread.critical(inside)
                return following

            self._writer.emit(step)

    def _thread_end(self, word: str, thread: Evaluate) -> None:
        following = self._writer.following
        if word == "join":
            nowhere = self._writer.new_slot()
            self._writer.emit(lambda slots, me: me.wait(me.join(thread(slots)), following, nowhere))
            return

        def step(slots: Slots, me: Thread) -> int:
            return following if me.stop(thread(slots)) else WAITING

        self._writer.emit(step)
