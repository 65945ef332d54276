"""A program's tree to flat code: what each statement does. `expressions` has what it computes,
`code` writes.
"""

from collections.abc import Generator, Mapping

from sim.controller.urscript import syntax
from sim.controller.urscript.code import Evaluate, Jump, Writer
from sim.controller.urscript.expressions import Expressions, constant
from sim.controller.urscript.program import UNSET, WAITING, Script, Slots, Thread
from sim.controller.urscript.signature import Function
from sim.controller.urscript.syntax import Expression, Routine, parse
from sim.controller.urscript.values import COMPOUND, ScriptError, assigned, with_element
from sim.controller.urscript.world import Scope, World, scopes

MAX_VARIABLES = 1000
"""Of a routine, and of all routines together the global ones."""


def load(source: str, functions: Mapping[str, Function]) -> Generator[None, None, Script]:
    """Make a program of a text; waits often, since that may take many periods.

    Raises:
        ScriptError: It is no program, or calls what is not there.
    """
    tree = yield from parse(source)
    script = yield from compile_program(tree, functions)
    script.source = source
    return script


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
    found = yield from scopes(program)
    main = found[0]
    # [UR-script, "Scoping rules"]: all of the first level is global, whatever it is called there
    names = dict.fromkeys(main.own)
    for scope in found[1:]:
        if scope.routine.kind == "sec":
            raise ScriptError("a secondary program stands by itself", None, scope.routine.line)
        names |= dict.fromkeys(name for name, how in scope.own.items() if how == "global")
    if len(names) > MAX_VARIABLES:
        raise ScriptError(
            f"a program has {MAX_VARIABLES} global variables at most", None, program.line
        )
    shared = {name: k for k, name in enumerate(names)}
    secondary = program.kind == "sec"
    world = World(functions, shared, [UNSET] * len(shared), secondary)
    for scope in found:
        yield from _Statements(world, scope, is_main=scope is main).write()
    return Script(main.code, world.variables, secondary)


class _Statements:
    """Of one routine."""

    def __init__(self, world: World, scope: Scope, *, is_main: bool) -> None:
        self._world, self._routine = world, scope.routine
        self._locals: dict[str, int] = {name: i for i, name in enumerate(scope.code.parameters)}
        for name, how in () if is_main else scope.own.items():
            if how == "local" or (how == "" and name not in world.shared):
                self._locals.setdefault(name, len(self._locals))
        self._writer = Writer(scope.code, len(self._locals), scope.routine.line)
        self._expressions = Expressions(world, self._writer, self._locals, scope)
        self._loops: list[tuple[int, list[Jump]]] = []
        """Of the open loops: where they begin, and the jumps to their ends."""

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
        if isinstance(expression, syntax.Name) and expression.name == "pass":
            return
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
        (variables, at), following = self._expressions.place(name), self._writer.following

        def step(slots: Slots, thread: Thread) -> int:
            new = value(slots)
            cells = slots if variables is None else variables
            cells[at] = assigned(cells[at], new) if new.__class__ in COMPOUND else new
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
        if word == "join" and self._world.secondary:
            raise self._writer.error("join takes time: a secondary program cannot wait")
        if word == "join":
            nowhere = self._writer.new_slot()
            self._writer.emit(lambda slots, me: me.wait(me.join(thread(slots)), following, nowhere))
            return

        def step(slots: Slots, me: Thread) -> int:
            return following if me.stop(thread(slots)) else WAITING

        self._writer.emit(step)
