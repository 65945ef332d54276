"""What all routines of a program share while it is compiled, and walks through its tree."""

from collections import ChainMap
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field

from sim.controller.urscript import syntax
from sim.controller.urscript.code import Evaluate
from sim.controller.urscript.program import Code, Slots
from sim.controller.urscript.signature import Function
from sim.controller.urscript.syntax import DEEPEST, Expression, Routine
from sim.controller.urscript.values import ScriptError


@dataclass
class Scope:
    """A routine as its program has it."""

    routine: Routine
    code: Code
    visible: "ChainMap[str, Scope]"
    """Routines that it can call: its own, and those of the routines around it."""
    own: dict[str, str] = field(default_factory=dict)
    """Variables that it assigns to or declares, and how: `local`, `global` or neither."""
    formula: Evaluate | None = None
    """What it computes, if that is one short expression."""
    is_formula: bool | None = None
    """None where that is not known yet."""


@dataclass(frozen=True)
class World:
    """What all routines share."""

    functions: Mapping[str, Function]
    shared: dict[str, int]
    variables: Slots
    secondary: bool
    """Whether the program may take no time."""


def nodes(expression: Expression) -> Iterator[Expression]:
    """An expression and all that is in it."""
    yield expression
    match expression:
        case syntax.Call():
            inner = (*expression.arguments, *(value for _, value in expression.named))
        case syntax.MethodCall():
            inner = (expression.value, *expression.arguments)
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
        yield from nodes(part)


def calls(expression: Expression) -> Iterator[syntax.Call | syntax.MethodCall]:
    """All calls in an expression."""
    return (node for node in nodes(expression) if isinstance(node, syntax.Call | syntax.MethodCall))


def scopes(program: Routine) -> Generator[None, None, list[Scope]]:
    """Those of a program and of all routines in it, its own first; waits after every statement.

    Raises:
        ScriptError: Blocks nest too deep.
    """
    main = Scope(program, Code(program.name, "main"), ChainMap())
    found = [main]
    for scope, statement in _statements(main, program.body, 0, found):
        if isinstance(statement, syntax.Assignment):
            scope.own.setdefault(statement.name, "")
        elif isinstance(statement, syntax.Declaration):
            scope.own[statement.name] = statement.scope
        yield
    return found


def _statements(
    scope: Scope, block: syntax.Block, depth: int, found: list[Scope]
) -> Iterator[tuple[Scope, syntax.Statement]]:
    """All statements, with the scope of the routine that they stand in."""
    for statement in block:
        yield scope, statement
        if depth > DEEPEST:
            raise ScriptError(f"blocks nest deeper than {DEEPEST}", None, statement.line)
        match statement:
            case Routine():
                code = Code(statement.name, statement.kind, [p for p, _ in statement.parameters])
                inner = Scope(statement, code, scope.visible.new_child())
                scope.visible.maps[0][statement.name] = inner
                found.append(inner)
                yield from _statements(inner, statement.body, depth + 1, found)
            case syntax.Condition():
                for _, part, _ in statement.branches:
                    yield from _statements(scope, part, depth + 1, found)
                yield from _statements(scope, statement.otherwise, depth + 1, found)
            case syntax.Loop():
                yield from _statements(scope, statement.body, depth + 1, found)
