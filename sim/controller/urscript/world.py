"""What all routines of a program share while it is compiled, and walks through its tree."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from sim.controller.urscript import syntax
from sim.controller.urscript.code import Evaluate
from sim.controller.urscript.program import Code, Slots
from sim.controller.urscript.signature import Function
from sim.controller.urscript.syntax import DEEPEST, Expression, Routine
from sim.controller.urscript.values import ScriptError


@dataclass(frozen=True)
class World:
    """What all routines share."""

    functions: Mapping[str, Function]
    routines: dict[str, Routine]
    shared: dict[str, int]
    variables: Slots
    codes: dict[str, Code] = field(default_factory=dict)
    formulas: dict[str, Evaluate | None] = field(default_factory=dict)
    """What routines compute that are formulas; None for those that are not."""


def nodes(expression: Expression) -> Iterator[Expression]:
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
        yield from nodes(part)


def calls(expression: Expression) -> Iterator[syntax.Call]:
    """All calls in an expression."""
    return (node for node in nodes(expression) if isinstance(node, syntax.Call))


def statements(
    block: syntax.Block, level: int, depth: int = 0
) -> Iterator[tuple[int, syntax.Statement]]:
    """All statements, with the level of the routine that they stand in: 1 is the program's own."""
    for statement in block:
        yield level, statement
        if depth > DEEPEST:
            raise ScriptError(f"blocks nest deeper than {DEEPEST}", None, statement.line)
        match statement:
            case Routine():
                yield from statements(statement.body, level + 1, depth + 1)
            case syntax.Condition():
                for _, inner, _ in statement.branches:
                    yield from statements(inner, level, depth + 1)
                yield from statements(statement.otherwise, level, depth + 1)
            case syntax.Loop():
                yield from statements(statement.body, level, depth + 1)


def assigned(statement: syntax.Statement) -> str:
    """The variable that a statement may give a value or a scope."""
    return statement.name if isinstance(statement, syntax.Assignment | syntax.Declaration) else ""
