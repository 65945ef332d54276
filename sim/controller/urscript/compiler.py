"""A tree to flat code: for each routine a list of steps, each a Python closure made here, that says which one is next.

Expressions are closures of a routine's variables. A call that may take time (of a routine of the program, or of a
function that waits) is a step of its own, whose result an expression reads from a variable without a name: so a thread
can be left between any two steps and taken up again, and nothing recurses while a program runs.
"""

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Protocol

from sim.controller.urscript import syntax
from sim.controller.urscript.signature import REFUSED, REQUIRED, Function, Parameter
from sim.controller.urscript.syntax import DEEPEST, Expression, Routine
from sim.controller.urscript.values import (
    BINARY,
    UNARY,
    ScriptError,
    Value,
    element,
    is_number,
    make_list,
    make_pose,
    shown,
    truth,
    with_element,
)

MOVED, WAITING, LOOK = -1, -2, -3
"""In place of the next step: the thread is in another routine now; it waits for the next period; what
it did was costly, so that the clock is looked at before the next step."""
LONGEST_FORMULA = 20
"""Nodes of a routine that is computed in place."""
MOST_VARIABLES = 1000
"""Of a routine, and of all routines together the global ones."""
UNSET = object()
"""What a variable holds before it has a value."""

Slots = list[Any]
"""A routine's variables, parameters first."""
Evaluate = Callable[[Slots], Value]
Step = Callable[[Slots, "Machine"], int]
_Jump = tuple[int, Callable[[int], Step]]
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


def compile_program(program: Routine, functions: Mapping[str, Function]) -> Generator[None, None, Script]:
    """Compile a tree; waits after every statement.

    Args:
        program: The tree.
        functions: What it may call of the controller.

    Raises:
        ScriptError: It calls what does not exist, reads what is never assigned, or nests too deep.
    """
    if program.kind == "thread":
        raise ScriptError(f"a program begins with `def name():`, got thread {program.name}", None, program.line)
    if program.parameters:
        raise ScriptError(f"a program has no parameters, got {len(program.parameters)}", None, program.line)
    routines: dict[str, Routine] = {}
    shared: dict[str, int] = {}
    for level, statement in _statements(program.body, 1):
        if isinstance(statement, Routine):
            routines[statement.name] = statement
        name = _assigned(statement)
        if name and (level == 1 or (isinstance(statement, syntax.Declaration) and statement.scope == "global")):
            shared.setdefault(name, len(shared))
        yield
    if len(shared) > MOST_VARIABLES:
        raise ScriptError(f"a program has {MOST_VARIABLES} global variables at most", None, program.line)
    world = _World(functions, routines, shared, [UNSET] * len(shared))
    codes = world.codes
    codes[program.name] = main = Code(program.name, "main")
    for name, routine in routines.items():
        codes[name] = Code(name, routine.kind, [parameter for parameter, _ in routine.parameters])
    yield from _Compiler(world, main, program).run()
    for name, routine in routines.items():
        yield from _Compiler(world, codes[name], routine).run()
    return Script(main, world.variables)


@dataclass(frozen=True)
class _World:
    """What all routines share."""

    functions: Mapping[str, Function]
    routines: dict[str, Routine]
    shared: dict[str, int]
    variables: Slots
    codes: dict[str, Code] = field(default_factory=dict)
    formulas: dict[str, Evaluate | None] = field(default_factory=dict)
    """What routines compute that are formulas; None for those that are not."""

    def takes_a_step(self, call: syntax.Call) -> bool:
        """Whether a call may wait, or run long."""
        if call.run or call.name in self.routines:
            return call.run or self.formula(call.name) is None
        function = self.functions.get(call.name)
        return function is not None and function.is_step

    def formula(self, name: str) -> Evaluate | None:
        """What a routine computes of its arguments, where it is one expression that calls no other routine.

        It is computed in place then: of the routines that clients upload most are such, and steps cost five times
        as much.
        """
        if name not in self.formulas:
            is_one = self._is_formula(self.routines[name].body)
            compiler = _Compiler(self, self.codes[name], self.routines[name])
            self.formulas[name] = compiler.formula() if is_one else None
        return self.formulas[name]

    def _is_formula(self, body: syntax.Block) -> bool:
        if len(body) != 1 or not isinstance(body[0], syntax.Return | syntax.Evaluation) or body[0].value is None:
            return False
        if len(list(islice(_nodes(body[0].value), LONGEST_FORMULA + 1))) > LONGEST_FORMULA:
            return False
        names = [call.name for call in _calls(body[0].value)]
        known = [self.functions.get(name) for name in names if name not in self.routines]
        return len(known) == len(names) and all(function and not function.is_step for function in known)


def _nodes(expression: Expression) -> Iterator[Expression]:
    """An expression and all that is in it."""
    yield expression
    match expression:
        case syntax.Call():
            inner = (*expression.arguments, *(value for _, value in expression.named))
        case syntax.Unary():
            inner = (expression.value,)
        case syntax.Binary():
            inner = (expression.left, expression.right)
        case syntax.Logic():
            inner = expression.terms
        case syntax.Array():
            inner = expression.elements
        case syntax.Index():
            inner = (expression.value, *expression.places)
        case _:
            inner = ()
    for part in inner:
        yield from _nodes(part)


def _calls(expression: Expression) -> Iterator[syntax.Call]:
    return (node for node in _nodes(expression) if isinstance(node, syntax.Call))


def _statements(block: syntax.Block, level: int, depth: int = 0) -> Iterator[tuple[int, syntax.Statement]]:
    """All statements, with the level of the routine that they stand in: 1 is the program's own."""
    for statement in block:
        yield level, statement
        if depth > DEEPEST:
            raise ScriptError(f"blocks nest deeper than {DEEPEST}", None, statement.line)
        match statement:
            case Routine():
                yield from _statements(statement.body, level + 1, depth + 1)
            case syntax.Condition():
                for _, inner, _ in statement.branches:
                    yield from _statements(inner, level, depth + 1)
                yield from _statements(statement.otherwise, level, depth + 1)
            case syntax.Loop():
                yield from _statements(statement.body, level, depth + 1)


def _assigned(statement: syntax.Statement) -> str:
    """The variable that a statement may give a value or a scope."""
    return statement.name if isinstance(statement, syntax.Assignment | syntax.Declaration) else ""


class _Compiler:
    """Of one routine."""

    def __init__(self, world: _World, code: Code, routine: Routine) -> None:
        self._world, self._code, self._routine = world, code, routine
        self._line = routine.line
        self._loops: list[tuple[int, list[_Jump]]] = []
        """Of the open loops: where they begin, and the jumps to their ends."""
        self._locals: dict[str, int] = {name: i for i, name in enumerate(code.parameters)}
        self._nameless = 0
        if code.kind != "main":
            self._bind()

    def _bind(self) -> None:
        """Find the variables of this routine alone: [UR-script, "Scoping rules"]."""
        own = [statement for level, statement in _statements(self._routine.body, 1) if level == 1]
        shared = {s.name for s in own if isinstance(s, syntax.Declaration) and s.scope == "global"}
        alone = {s.name for s in own if isinstance(s, syntax.Declaration) and s.scope == "local"}
        for name in filter(None, map(_assigned, own)):
            if name in alone or (name not in self._world.shared and name not in shared):
                self._locals.setdefault(name, len(self._locals))

    def run(self) -> Generator[None, None, None]:
        """Write the code."""
        self._code.slots = len(self._locals)
        if len(self._locals) > MOST_VARIABLES:
            raise self._error(f"a routine has {MOST_VARIABLES} variables at most")
        yield from self._block(self._routine.body)
        self._emit(lambda slots, machine: machine.leave(None))

    def formula(self) -> Evaluate:
        """The routine as one closure, where it is one expression."""
        statement = self._routine.body[0]
        assert isinstance(statement, syntax.Return | syntax.Evaluation), "only formulas come here"
        assert statement.value is not None, "and they compute something"
        self._line = statement.line
        value = self._value(statement.value)
        if isinstance(statement, syntax.Return):
            return value

        def nothing(slots: Slots) -> None:
            value(slots)

        return nothing

    # ---- statements ----

    def _block(self, block: syntax.Block) -> Generator[None, None, None]:
        for statement in block:
            self._line = statement.line or self._line
            self._nameless = len(self._locals)
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
                    self._store(statement.name, self._value(statement.value))
            case syntax.Condition():
                yield from self._condition(statement)
            case syntax.Loop():
                yield from self._loop(statement)
            case syntax.Return():
                value = _constant(None) if statement.value is None else self._value(statement.value)
                self._emit(lambda slots, machine: machine.leave(value(slots)))
            case syntax.Word():
                self._word(statement.word)
            case syntax.ThreadEnd():
                self._thread_end(statement.word, self._value(statement.thread))

    def _evaluation(self, expression: Expression) -> None:
        value, following = self._value(expression), self._following

        def step(slots: Slots, machine: Machine) -> int:
            value(slots)
            return following

        self._emit(step)

    def _assignment(self, statement: syntax.Assignment) -> None:
        if not statement.places:
            self._store(statement.name, self._value(statement.value))
            return
        *places, new = self._values((*statement.places, statement.value))
        old = self._variable(statement.name)
        self._store(
            statement.name,
            lambda slots: with_element(old(slots), [place(slots) for place in places], new(slots)),
        )

    def _store(self, name: str, value: Evaluate) -> None:
        at = self._locals.get(name)
        following = self._following
        if at is not None:
            self._emit(_keep(at, value, following))
            return
        variables, place = self._world.variables, self._world.shared[name]

        def step(slots: Slots, machine: Machine) -> int:
            variables[place] = value(slots)
            return following

        self._emit(step)

    def _condition(self, statement: syntax.Condition) -> Generator[None, None, None]:
        ends = []
        for test, block, line in statement.branches:
            self._line = line
            jump = self._jump_unless(self._value(test))
            yield from self._block(block)
            ends.append(self._jump())
            self._land(jump)
        yield from self._block(statement.otherwise)
        for end in ends:
            self._land(end)

    def _loop(self, statement: syntax.Loop) -> Generator[None, None, None]:
        begin = self._following - 1
        out = self._jump_unless(self._value(statement.condition))
        self._loops.append((begin, []))
        yield from self._block(statement.body)
        self._line = statement.line
        self._emit(lambda slots, machine: begin)
        _, breaks = self._loops.pop()
        for jump in [out, *breaks]:
            self._land(jump)

    def _word(self, word: str) -> None:
        following = self._following
        if word in ("break", "continue"):
            if not self._loops:
                raise self._error(f"{word} stands outside of a loop")
            begin, breaks = self._loops[-1]
            if word == "break":
                breaks.append(self._jump())
            else:
                self._emit(lambda slots, machine: begin)
        elif word == "halt":
            self._emit(lambda slots, machine: machine.halt())
        elif word in ("enter_critical", "exit_critical"):
            inside = word == "enter_critical"

            def step(slots: Slots, machine: Machine) -> int:
                machine.critical(inside)
                return following

            self._emit(step)

    def _thread_end(self, word: str, thread: Evaluate) -> None:
        following = self._following
        if word == "join":
            nowhere = self._new_slot()
            self._emit(lambda slots, machine: machine.wait(machine.join(thread(slots)), following, nowhere))
            return

        def step(slots: Slots, machine: Machine) -> int:
            return following if machine.stop(thread(slots)) else WAITING

        self._emit(step)

    # ---- expressions ----

    def _value(self, expression: Expression) -> Evaluate:
        """A closure for an expression; steps for the calls in it go before."""
        match expression:
            case syntax.Constant():
                return _constant(expression.value)
            case syntax.Name():
                return self._variable(expression.name)
            case syntax.Unary():
                operate, value = UNARY[expression.operator], self._value(expression.value)
                return lambda slots: operate(value(slots))
            case syntax.Binary():
                return self._binary(expression)
            case syntax.Logic():
                return self._logic(expression)
            case syntax.Array():
                return self._array(expression)
            case syntax.Index():
                value, *places = self._values((expression.value, *expression.places))
                return lambda slots: element(value(slots), [place(slots) for place in places])
            case syntax.Call():
                return self._call(expression)

    def _variable(self, name: str) -> Evaluate:
        at = self._locals.get(name)
        if at is not None:

            def local(slots: Slots) -> Value:
                value = slots[at]
                if value is UNSET:
                    raise ScriptError(f"{name} is read before it has a value")
                return value

            return local
        if name not in self._world.shared:
            raise self._error(f"{shown(name)} is not defined")
        variables, place = self._world.variables, self._world.shared[name]

        def shared(slots: Slots) -> Value:
            value = variables[place]
            if value is UNSET:
                raise ScriptError(f"{name} is read before it has a value")
            return value

        return shared

    def _values(self, expressions: tuple[Expression, ...]) -> list[Evaluate]:
        """Several, evaluated from left to right, calls included."""
        last = max((k for k, expression in enumerate(expressions) if self._takes_steps(expression)), default=0)
        values: list[Evaluate] = []
        for k, expression in enumerate(expressions):
            value = self._value(expression)
            keep = k < last and not isinstance(expression, syntax.Constant)
            values.append(self._kept(value) if keep else value)
        return values

    def _takes_steps(self, expression: Expression) -> bool:
        return any(map(self._world.takes_a_step, _calls(expression)))

    def _kept(self, value: Evaluate) -> Evaluate:
        """The same value, computed now and kept."""
        at = self._new_slot()
        self._emit(_keep(at, value, self._following))
        return lambda slots: slots[at]

    def _binary(self, expression: syntax.Binary) -> Evaluate:
        left, right = self._values((expression.left, expression.right))
        operate = BINARY[expression.operator]
        if isinstance(expression.right, syntax.Constant):
            constant = expression.right.value
            if expression.operator == "==" and is_number(constant):  # what a program that waits for commands does most

                def compare(slots: Slots) -> bool:
                    value = left(slots)
                    return value == constant and value.__class__ is not bool

                return compare
            return lambda slots: operate(left(slots), constant)
        return lambda slots: operate(left(slots), right(slots))

    def _logic(self, expression: syntax.Logic) -> Evaluate:
        decisive = expression.operator == "or"
        if any(map(self._takes_steps, expression.terms)):
            return self._logic_in_steps(expression.terms, decisive)
        terms = [self._value(term) for term in expression.terms]

        def decide(slots: Slots) -> bool:
            for term in terms:
                if truth(term(slots)) is decisive:
                    return decisive
            return not decisive

        return decide

    def _logic_in_steps(self, terms: tuple[Expression, ...], decisive: bool) -> Evaluate:
        at, ends = self._new_slot(), []
        for term in terms:
            value = self._value(term)
            self._emit(_keep(at, _as_truth(value), self._following))
            ends.append(self._jump_unless(lambda slots: slots[at] is not decisive))
        for end in ends:
            self._land(end)
        return lambda slots: slots[at]

    def _array(self, expression: syntax.Array) -> Evaluate:
        make = make_pose if expression.pose else make_list
        elements = self._values(expression.elements)
        if all(isinstance(part, syntax.Constant) for part in expression.elements):
            try:
                return _constant(make([part([]) for part in elements]))
            except ScriptError as error:
                raise self._error(str(error)) from None
        return lambda slots: make([part(slots) for part in elements])

    def _call(self, call: syntax.Call) -> Evaluate:
        routine = self._world.routines.get(call.name)
        if routine is not None:
            return self._call_routine(call, routine)
        function = self._world.functions.get(call.name)
        if function is None or call.run:
            what = "thread" if call.run else "function"
            raise self._error(f"there is no {what} {shown(call.name)}", call.line)
        return self._call_function(call, function)

    def _call_routine(self, call: syntax.Call, routine: Routine) -> Evaluate:
        if (routine.kind == "thread") is not call.run:
            raise self._error(f"threads are run, functions called: {routine.kind} {shown(call.name)}", call.line)
        world, code = self._world, self._world.codes[call.name]
        defaults = {name: value for name, value in routine.parameters if value is not None}
        placed = self._placed(call, [name for name, _ in routine.parameters], defaults)
        if not all(map(_is_constant, defaults.values())):
            raise self._error(f"the defaults of {shown(call.name)} are not constants", routine.line)
        arguments = self._values(placed)
        formula = None if call.run else world.formula(call.name)
        if formula is not None:
            return lambda slots: formula([argument(slots) for argument in arguments])
        at, following = self._new_slot(), self._following

        def fresh(slots: Slots) -> Slots:
            own = [argument(slots) for argument in arguments]
            return own + [UNSET] * (code.slots - len(own))

        if call.run:

            def start(slots: Slots, machine: Machine) -> int:
                slots[at] = machine.start(code, fresh(slots))
                return following

            self._emit(start)
        else:
            self._emit(lambda slots, machine: machine.enter(code, fresh(slots), following, at))
        return lambda slots: slots[at]

    def _call_function(self, call: syntax.Call, function: Function) -> Evaluate:
        parameters = function.parameters
        defaults = {p.name: syntax.Constant(p.default) for p in parameters if p.default is not REQUIRED}
        placed = self._placed(call, [parameter.name for parameter in parameters], defaults)
        values = self._values(placed)
        arguments = [
            value
            if expression is defaults.get(parameter.name)
            else self._checked(function, parameter, expression, value)
            for parameter, expression, value in zip(parameters, placed, values, strict=True)
        ]
        compute = function.call
        if not function.is_step:
            return lambda slots: compute(*[argument(slots) for argument in arguments])
        at, following = self._new_slot(), self._following

        def wait(slots: Slots, machine: Machine) -> int:
            return machine.wait(compute(*[argument(slots) for argument in arguments]), following, at)

        def take_long(slots: Slots, machine: Machine) -> int:
            slots[at] = compute(*[argument(slots) for argument in arguments])
            return machine.look(following)

        self._emit(wait if function.waits else take_long)
        return lambda slots: slots[at]

    def _checked(self, function: Function, parameter: Parameter, expression: Expression, value: Evaluate) -> Evaluate:
        """The argument as the function gets it."""
        take = parameter.kind.take
        if isinstance(expression, syntax.Constant):
            taken = take(expression.value)
            if taken is REFUSED:
                raise self._error(str(function.refusal(parameter, expression.value)))
            return _constant(taken)

        def argument(slots: Slots) -> Any:
            given = value(slots)
            taken = take(given)
            if taken is REFUSED:
                raise function.refusal(parameter, given)
            return taken

        return argument

    def _placed(
        self, call: syntax.Call, names: list[str], defaults: Mapping[str, Expression]
    ) -> tuple[Expression, ...]:
        """The arguments in the order of the parameters."""
        given = dict(zip(names, call.arguments, strict=False))
        named = dict(call.named)
        if len(call.arguments) > len(names) or len(named) < len(call.named) or given.keys() & named.keys():
            raise self._error(f"{shown(call.name)} takes {len(names)} arguments: {', '.join(names)}", call.line)
        given |= named
        for name in given.keys() - set(names):
            raise self._error(f"{shown(call.name)} has no parameter {shown(name)}", call.line)
        for name in names:
            if name not in given and name not in defaults:
                raise self._error(f"{shown(call.name)} lacks its argument {name}", call.line)
        return tuple(given[name] if name in given else defaults[name] for name in names)

    # ---- steps ----

    @property
    def _following(self) -> int:
        """The step behind the next one."""
        return len(self._code.steps) + 1

    def _emit(self, step: Step) -> None:
        self._code.steps.append(step)
        self._code.lines.append(self._line)

    def _new_slot(self) -> int:
        """A variable without a name, free until the statement is done."""
        self._nameless += 1
        self._code.slots = max(self._code.slots, self._nameless)
        return self._nameless - 1

    def _jump(self) -> _Jump:
        """Go to where it will `_land`."""
        return self._unfinished(lambda target: lambda slots, machine: target)

    def _land(self, jump: _Jump) -> None:
        """Here is where a jump goes."""
        at, to = jump
        self._code.steps[at] = to(len(self._code.steps))

    def _unfinished(self, to: Callable[[int], Step]) -> _Jump:
        self._emit(to(0))
        return len(self._code.steps) - 1, to

    def _jump_unless(self, condition: Evaluate) -> _Jump:
        """The same, unless a condition holds."""
        following = self._following

        def to(target: int) -> Step:
            def step(slots: Slots, machine: Machine) -> int:
                value = condition(slots)
                if value is True:
                    return following
                return following if value is not False and truth(value) else target

            return step

        return self._unfinished(to)

    def _error(self, message: str, line: int = 0) -> ScriptError:
        return ScriptError(message, None, line or self._line)


def _is_constant(expression: Expression) -> bool:
    if isinstance(expression, syntax.Array):
        return all(map(_is_constant, expression.elements))
    return isinstance(expression, syntax.Constant)


def _constant(value: Value) -> Evaluate:
    return lambda slots: value


def _as_truth(value: Evaluate) -> Evaluate:
    return lambda slots: truth(value(slots))


def _keep(at: int, value: Evaluate, following: int) -> Step:
    def step(slots: Slots, machine: Machine) -> int:
        slots[at] = value(slots)
        return following

    return step
