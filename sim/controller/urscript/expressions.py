"""Expressions as closures of a routine's variables; what may take long in them goes before, as
steps.

A call that may wait, or run long (of a routine of the program, or of a function of the controller),
is a step of its own, whose result an expression reads from a variable without a name.
"""

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

from sim.controller.urscript import syntax
from sim.controller.urscript.code import Evaluate, Writer
from sim.controller.urscript.library import METHODS, Method
from sim.controller.urscript.operators import BINARY, UNARY
from sim.controller.urscript.program import UNSET, Slots, Thread
from sim.controller.urscript.signature import REFUSED, REQUIRED, Function, Parameter
from sim.controller.urscript.syntax import Expression, variable_of
from sim.controller.urscript.values import (
    Remote,
    ScriptError,
    Value,
    element,
    is_number,
    make_list,
    make_pose,
    make_struct,
    not_found,
    shown,
    truth,
    with_element,
)
from sim.controller.urscript.world import Scope, World, calls, nodes

LONGEST_FORMULA = 20
"""Nodes of a routine that is computed in place."""


class Expressions:
    """Those of one routine."""

    def __init__(
        self, world: World, writer: Writer, variables: Mapping[str, int], scope: Scope
    ) -> None:
        """Begin.

        Args:
            world: What all routines share.
            writer: Of the routine's steps.
            variables: The slots of its own variables, by name.
            scope: What the routine can call.
        """
        self._world = world
        self._writer = writer
        self._locals = variables
        self._scope = scope

    def value(self, expression: Expression) -> Evaluate:
        """A closure for an expression; steps for the calls in it go before."""
        match expression:
            case syntax.Constant():
                return constant(expression.value)
            case syntax.Name():
                return self.variable(expression.name, expression.column)
            case syntax.Unary():
                operate, value = UNARY[expression.operator], self.value(expression.value)
                return lambda slots: operate(value(slots))
            case syntax.Binary():
                return self._binary(expression)
            case syntax.Logic():
                return self._logic(expression)
            case syntax.Array():
                return self._array(expression)
            case syntax.Index():
                value, *places = self.values((expression.value, *expression.places))
                return lambda slots: element(value(slots), [place(slots) for place in places])
            case syntax.Call():
                return self._call(expression)
            case syntax.MethodCall():
                return self._method(expression)

    def variable(self, name: str, column: int = 0) -> Evaluate:
        """What reads a variable.

        Raises:
            ScriptError: Nothing in the program ever gives it a value.
        """
        at = self._locals.get(name)
        if at is not None:

            def local(slots: Slots) -> Value:
                value = slots[at]
                if value is UNSET:
                    raise ScriptError(f"{name} is read before it has a value")
                return value

            return local
        if name not in self._world.shared:
            line = self._writer.line
            raise not_found(f"{shown(name)} is not defined", name, line, column)
        variables, place = self._world.variables, self._world.shared[name]

        def shared(slots: Slots) -> Value:
            value = variables[place]
            if value is UNSET:
                raise ScriptError(f"{name} is read before it has a value")
            return value

        return shared

    def place(self, name: str) -> tuple[Slots | None, int]:
        """Where a variable stands: among the global ones, or (None) among the routine's own."""
        at = self._locals.get(name)
        return (self._world.variables, self._world.shared[name]) if at is None else (None, at)

    def values(
        self, expressions: Sequence[Expression], places: "Sequence[Expressions]" = ()
    ) -> list[Evaluate]:
        """Several, evaluated from left to right, calls included; each sees what its place does,
        this routine if none are given.
        """
        places = places or [self] * len(expressions)
        steps = map(Expressions._takes_steps, places, expressions)
        last = max((k for k, takes in enumerate(steps) if takes), default=0)
        values: list[Evaluate] = []
        for k, expression in enumerate(expressions):
            value = places[k].value(expression)
            keep = k < last and not isinstance(expression, syntax.Constant)
            values.append(self._kept(value) if keep else value)
        return values

    def _takes_steps(self, expression: Expression) -> bool:
        return any(map(self._takes_a_step, calls(expression)))

    def _kept(self, value: Evaluate) -> Evaluate:
        """The same value, computed now and kept."""
        at = self._writer.new_slot()
        self._writer.keep(at, value)
        return lambda slots: slots[at]

    def _binary(self, expression: syntax.Binary) -> Evaluate:
        left, right = self.values((expression.left, expression.right))
        operate = BINARY[expression.operator]
        if isinstance(expression.right, syntax.Constant):
            constant = expression.right.value
            # what a program that waits for commands does most
            if expression.operator == "==" and is_number(constant):

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
        terms = [self.value(term) for term in expression.terms]

        def decide(slots: Slots) -> bool:
            for term in terms:
                if truth(term(slots)) is decisive:
                    return decisive
            return not decisive

        return decide

    def _logic_in_steps(self, terms: tuple[Expression, ...], decisive: bool) -> Evaluate:
        at, ends = self._writer.new_slot(), []
        for term in terms:
            value = self.value(term)
            self._writer.keep(at, _as_truth(value))
            ends.append(self._writer.jump_unless(lambda slots: slots[at] is not decisive))
        for end in ends:
            self._writer.land(end)
        return lambda slots: slots[at]

    def _array(self, expression: syntax.Array) -> Evaluate:
        make = make_pose if expression.pose else make_list
        elements = self.values(expression.elements)
        if all(isinstance(part, syntax.Constant) for part in expression.elements):
            try:
                return constant(make([part([]) for part in elements]))
            except ScriptError as error:
                raise self._writer.error(str(error)) from None
        return lambda slots: make([part(slots) for part in elements])

    def _call(self, call: syntax.Call) -> Evaluate:
        scope = self._scope.visible.get(call.name)
        if scope is not None:
            return self._call_routine(call, scope)
        if call.name == "struct" and not call.run:
            return self._struct(call)
        function = self._world.functions.get(call.name)
        if function is None or call.run:
            what = "thread" if call.run else "function"
            message = f"there is no {what} {shown(call.name)}"
            raise not_found(message, call.name, call.line, call.column)
        return self._call_function(call, function)

    def _struct(self, call: syntax.Call) -> Evaluate:
        names = [name for name, _ in call.named]
        if call.arguments or not names or len(set(names)) < len(names):
            raise self._writer.error("struct takes values with names: struct(a=1, b=2)", call.line)
        members = self.values(tuple(value for _, value in call.named))
        return lambda slots: make_struct(
            zip(names, [member(slots) for member in members], strict=True)
        )

    def _method(self, call: syntax.MethodCall) -> Evaluate:
        method, name = METHODS.get(call.name), call.name
        if method is not None and len(call.arguments) != method.arguments:
            raise self._writer.error(f"{name} takes {method.arguments} arguments", call.line)
        if method is not None and method.changes:
            return self._change(call, method)
        value, *arguments = self.values((call.value, *call.arguments))
        if method is None:
            return self._remote(name, value, arguments)
        return lambda slots: method.apply(
            name, value(slots), [argument(slots) for argument in arguments]
        )

    def _remote(self, name: str, value: Evaluate, arguments: Sequence[Evaluate]) -> Evaluate:
        """A call of a server's function: which value is a handle, only the running program
        knows.
        """
        at, following = self._writer.new_slot(), self._writer.following

        def step(slots: Slots, thread: Thread) -> int:
            server, given = value(slots), [argument(slots) for argument in arguments]
            if not isinstance(server, Remote):
                raise ScriptError(f"{shown(server)} has no method {shown(name)}", server)
            return thread.wait(server.call(name, given), following, at)

        self._writer.emit(step)
        return lambda slots: slots[at]

    def _change(self, call: syntax.MethodCall, method: Method) -> Evaluate:
        """Of the variable that a method stands behind, or of a part of it."""
        target = variable_of(call.value)
        if target is None:
            raise self._writer.error(f"{call.name} changes a variable, and needs one", call.line)
        variable, where = target
        values = self.values((*where, *call.arguments))
        places, arguments = values[: len(where)], values[len(where) :]
        old = self.variable(variable.name, variable.column)
        variables, own = self.place(variable.name)
        name = call.name
        at, following = self._writer.new_slot(), self._writer.following

        def step(slots: Slots, thread: Thread) -> int:
            whole, path = old(slots), [place(slots) for place in places]
            given = [argument(slots) for argument in arguments]
            new, slots[at] = method.apply(name, element(whole, path), given)
            cells = slots if variables is None else variables
            cells[own] = with_element(whole, path, new) if path else new
            return following

        self._writer.emit(step)
        return lambda slots: slots[at]

    def _call_routine(self, call: syntax.Call, scope: Scope) -> Evaluate:
        code, routine = scope.code, scope.routine
        if (routine.kind == "thread") is not call.run:
            raise self._writer.error(
                f"threads are run, functions called: {routine.kind} {shown(call.name)}", call.line
            )
        if call.run and self._world.secondary:
            raise self._writer.error("a secondary program runs no threads", call.line)
        defaults = {name: value for name, value in routine.parameters if value is not None}
        names = [name for name, _ in routine.parameters]
        placed = self._placed(call, names, defaults)
        # a default knows the global variables alone
        there = Expressions(self._world, self._writer, {}, scope)
        places = [
            there if value is defaults.get(name) else self
            for name, value in zip(names, placed, strict=True)
        ]
        arguments = self.values(placed, places)
        formula = None if call.run else self._formula(scope)
        if formula is not None:
            return lambda slots: formula([argument(slots) for argument in arguments])
        at, following = self._writer.new_slot(), self._writer.following

        def fresh(slots: Slots) -> Slots:
            own = [argument(slots) for argument in arguments]
            return own + [UNSET] * (code.slots - len(own))

        if call.run:

            def start(slots: Slots, thread: Thread) -> int:
                slots[at] = thread.start(code, fresh(slots))
                return following

            self._writer.emit(start)
        else:
            self._writer.emit(lambda slots, thread: thread.enter(code, fresh(slots), following, at))
        return lambda slots: slots[at]

    def _call_function(self, call: syntax.Call, function: Function) -> Evaluate:
        parameters = function.parameters
        defaults = {
            p.name: syntax.Constant(p.default) for p in parameters if p.default is not REQUIRED
        }
        placed = self._placed(call, [parameter.name for parameter in parameters], defaults)
        values = self.values(placed)
        arguments = [
            value
            if expression is defaults.get(parameter.name)
            else self._checked(function, parameter, expression, value)
            for parameter, expression, value in zip(parameters, placed, values, strict=True)
        ]
        if function.waits and self._world.secondary:
            raise self._writer.error(
                f"{call.name} takes time: a secondary program cannot call it", call.line
            )
        compute = function.call
        if not function.is_step:
            return lambda slots: compute(*[argument(slots) for argument in arguments])
        at, following = self._writer.new_slot(), self._writer.following

        def wait(slots: Slots, thread: Thread) -> int:
            return thread.wait(compute(*[argument(slots) for argument in arguments]), following, at)

        def take_long(slots: Slots, thread: Thread) -> int:
            slots[at] = compute(*[argument(slots) for argument in arguments])
            return thread.peek(following)

        self._writer.emit(wait if function.waits else take_long)
        return lambda slots: slots[at]

    def _checked(
        self, function: Function, parameter: Parameter, expression: Expression, value: Evaluate
    ) -> Evaluate:
        """The argument as the function gets it."""
        take = parameter.kind.take
        if isinstance(expression, syntax.Constant):
            taken = take(expression.value)
            if taken is REFUSED:
                raise self._writer.error(str(function.refusal(parameter, expression.value)))
            return constant(taken)

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
        if (
            len(call.arguments) > len(names)
            or len(named) < len(call.named)
            or given.keys() & named.keys()
        ):
            raise self._writer.error(
                f"{shown(call.name)} takes {len(names)} arguments: {', '.join(names)}", call.line
            )
        given |= named
        for name in given.keys() - set(names):
            raise self._writer.error(
                f"{shown(call.name)} has no parameter {shown(name)}", call.line
            )
        for name in names:
            if name not in given and name not in defaults:
                raise self._writer.error(f"{shown(call.name)} lacks its argument {name}", call.line)
        return tuple(given[name] if name in given else defaults[name] for name in names)

    def _takes_a_step(self, call: syntax.Call | syntax.MethodCall) -> bool:
        """Whether a call may wait, run long, or change a variable."""
        if isinstance(call, syntax.MethodCall):
            method = METHODS.get(call.name)
            return method is None or method.changes
        scope = self._scope.visible.get(call.name)
        if call.run or scope is not None:
            return call.run or scope is None or self._formula(scope) is None
        function = self._world.functions.get(call.name)
        return function is not None and function.is_step

    def _formula(self, scope: Scope) -> Evaluate | None:
        """What a routine computes of its arguments, where it is one short expression that calls no
        other routine.

        It is computed in place then: of the routines that clients upload most are such, and steps
        cost five times as much.
        """
        if scope.is_formula is None:
            scope.is_formula = self._is_formula(scope)
            scope.formula = _formula(self._world, scope) if scope.is_formula else None
        return scope.formula

    def _is_formula(self, scope: Scope) -> bool:
        body = scope.routine.body
        if (
            len(body) != 1
            or not isinstance(body[0], syntax.Return | syntax.Evaluation)
            or body[0].value is None
        ):
            return False
        if len(list(islice(nodes(body[0].value), LONGEST_FORMULA + 1))) > LONGEST_FORMULA:
            return False
        for call in calls(body[0].value):
            function = self._world.functions.get(call.name)
            plain = isinstance(call, syntax.Call) and call.name not in scope.visible
            if not plain or function is None or function.is_step:
                return False
        return True


def _formula(world: World, scope: Scope) -> Evaluate:
    code, statement = scope.code, scope.routine.body[0]
    assert isinstance(statement, syntax.Return | syntax.Evaluation), "only formulas come here"
    assert statement.value is not None, "and they compute something"
    variables = {parameter: i for i, parameter in enumerate(code.parameters)}
    writer = Writer(code, len(variables), statement.line)
    value = Expressions(world, writer, variables, scope).value(statement.value)
    if isinstance(statement, syntax.Return):
        return value

    def nothing(slots: Slots) -> None:
        value(slots)

    return nothing


def constant(value: Value) -> Evaluate:
    """Always the same."""
    return lambda slots: value


def _as_truth(value: Evaluate) -> Evaluate:
    return lambda slots: truth(value(slots))
