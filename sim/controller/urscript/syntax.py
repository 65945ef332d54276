"""A program's text as a tree of nodes, made by the grammar beside this file, a few words at a time.

Parsing waits between words, since the controller goes on meanwhile.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from sim.controller.urscript.values import (
    LARGEST_INTEGER,
    LONGEST_STRING,
    Key,
    ScriptError,
    is_number,
    shown,
)

DEEPEST = 60
"""Brackets in brackets, operators on operators, and blocks in blocks."""
LONGEST_STATEMENT = 2500
"""Words up to the end of a line: nothing waits within a statement."""
OUTSIDE = "line"
"""Name of what stands outside of a program."""
LONGEST_NUMBER = 300
"""Digits."""
LONGEST_TOLD = 200
"""Characters of a line that the clients are told."""
POSE_LENGTH = 6
CONTINUED = frozenset({"EQUAL", "COMMA", "PLUS", "MINUS", "MULTIPLICATIVE", "COMPARISON"}) | {
    "AND", "OR", "XOR", "NOT", "BANG"
}  # fmt: skip
"""Words behind which a line goes on."""
OPENING, CLOSING = frozenset({"LSQB", "LPAR"}), frozenset({"RSQB", "RPAR"})


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, a string, True, False or None; as an index also a member's name."""

    depth: ClassVar[int] = 1
    value: Any


@dataclass(frozen=True, slots=True)
class Name:
    """A variable."""

    depth: ClassVar[int] = 1
    name: str
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Unary:
    """An operator before a value."""

    operator: str
    value: "Expression"
    depth: int


@dataclass(frozen=True, slots=True)
class Binary:
    """An operator between two values."""

    operator: str
    left: "Expression"
    right: "Expression"
    depth: int


@dataclass(frozen=True, slots=True)
class Logic:
    """Terms of which only so many are looked at as it takes: `and`, `or`."""

    operator: str
    terms: tuple["Expression", ...]
    depth: int


@dataclass(frozen=True, slots=True)
class Array:
    """A list; with six elements behind the name p, a pose."""

    elements: tuple["Expression", ...]
    depth: int
    pose: bool = False


@dataclass(frozen=True, slots=True)
class Index:
    """An element of a list, of a pose or (with two places) of a matrix, or a struct's member."""

    value: "Expression"
    places: tuple["Expression", ...]
    depth: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function's, or with `run` a new thread's."""

    name: str
    arguments: tuple["Expression", ...]
    named: tuple[tuple[str, "Expression"], ...]
    line: int
    column: int
    depth: int
    run: bool = False


@dataclass(frozen=True, slots=True)
class MethodCall:
    """Of what stands behind a value and a dot."""

    value: "Expression"
    name: str
    arguments: tuple["Expression", ...]
    line: int
    column: int
    depth: int


Expression = Constant | Name | Unary | Binary | Logic | Array | Index | Call | MethodCall


@dataclass(frozen=True, slots=True)
class Evaluation:
    """An expression as a statement."""

    value: Expression
    line: int


@dataclass(frozen=True, slots=True)
class Assignment:
    """To a variable, or to an element or a member of one."""

    name: str
    places: tuple[Expression, ...]
    value: Expression
    line: int


@dataclass(frozen=True, slots=True)
class Declaration:
    """Of a variable's scope, `global` or `local`; with a value, an assignment as well."""

    scope: str
    name: str
    value: Expression | None
    line: int


@dataclass(frozen=True, slots=True)
class Condition:
    """Blocks of which the first is run whose condition holds."""

    branches: tuple[tuple[Expression, "Block", int], ...]
    """Condition, block, line."""
    otherwise: "Block"

    @property
    def line(self) -> int:
        """Where it begins."""
        return self.branches[0][2]


@dataclass(frozen=True, slots=True)
class Loop:
    """A block that is run while a condition holds."""

    condition: Expression
    body: "Block"
    line: int


@dataclass(frozen=True, slots=True)
class Return:
    """The end of a function, with what it gives back."""

    value: Expression | None
    line: int


@dataclass(frozen=True, slots=True)
class Word:
    """A statement of one word."""

    word: str
    line: int


@dataclass(frozen=True, slots=True)
class ThreadEnd:
    """`kill` or `join`."""

    word: str
    thread: Expression
    line: int


@dataclass(frozen=True, slots=True)
class Routine:
    """A function, a thread or the whole program."""

    kind: str
    name: str
    parameters: tuple[tuple[str, Expression | None], ...]
    """Names, with defaults."""
    body: "Block"
    line: int


Statement = (
    Evaluation | Assignment | Declaration | Condition | Loop | Return | Word | ThreadEnd | Routine
)
Block = tuple[Statement, ...]


def parse(source: str) -> Generator[None, None, Routine]:
    """The tree of a program, from `def` to `end`, or of statements outside of one; waits after
    every word.

    Raises:
        ScriptError: It is no program, with the place where that shows.
    """
    parser = _parser().parse_interactive(source)
    line = 0
    try:
        for token in parser.iter_parse():
            line = _line(token)
            yield
        return parser.feed_eof()
    except UnexpectedCharacters as error:
        at = shown(source[error.pos_in_stream])
        raise _syntax_error(source, f"syntax error at {at}", error.line, error.column) from None
    except UnexpectedToken as error:
        token = error.token
        if token.type == "$END":
            raise _syntax_error(source, "the program has no `end`", line, 1) from None
        at = "the end of the line" if token.type == "_NL" else shown(token)
        raise _syntax_error(
            source, f"syntax error at {at}", _line(token), token.column or 0
        ) from None
    except UnexpectedInput as error:
        raise _syntax_error(source, "syntax error", max(error.line, 0), error.column) from None
    except ScriptError as error:
        error.line = error.line or line
        raise


def _syntax_error(source: str, message: str, line: int, column: int) -> ScriptError:
    """In the controller's words as well: with the line in question."""
    text = source.split("\n")[line - 1][:LONGEST_TOLD] if line > 0 else ""
    told = f"syntax_error_on_line:{line}:{shown(text, LONGEST_TOLD, quoted=False)}:"
    return ScriptError(message, None, line, column, told)


class _Lines:
    """Leaves out the ends of lines that go on, and refuses what nests too deep."""

    always_accept = ("_NL",)

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        brackets = 0
        words = 0
        last = ""
        for token in stream:
            words += 1
            if words > LONGEST_STATEMENT:
                raise ScriptError(
                    f"a statement has {LONGEST_STATEMENT} words at most", None, _line(token)
                )
            if token.type in OPENING:
                brackets += 1
                if brackets > DEEPEST:
                    raise ScriptError(f"this nests deeper than {DEEPEST}", None, _line(token))
            elif token.type in CLOSING:
                brackets = max(brackets - 1, 0)
            if token.type == "_NL":
                if brackets or last in CONTINUED:
                    continue
                words = 0
            last = token.type
            yield token


@v_args(inline=True)
class _Tree(Transformer):
    """Makes the nodes; one method for each rule of the grammar."""

    def number(self, token: Token) -> Constant:
        if not token.isdigit():
            return Constant(float(token))
        if len(token) > LONGEST_NUMBER:
            raise ScriptError(f"{shown(token)} is too long a number", None, _line(token))
        value = int(token)
        # that a larger one is a float is assumed: programs in use divide by 2147483648
        return Constant(value if value <= LARGEST_INTEGER else float(value))

    def string(self, token: Token) -> Constant:
        if len(token) > LONGEST_STRING:
            raise ScriptError(
                f"a string has {LONGEST_STRING} characters at most", None, _line(token)
            )
        return Constant(str(token[1:-1]))

    def true(self, token: Token) -> Constant:
        return Constant(True)

    def false(self, token: Token) -> Constant:
        return Constant(False)

    def none(self, token: Token) -> Constant:
        return Constant(None)

    def name(self, token: Token) -> Name:
        return Name(str(token), _line(token), token.column or 0)

    def bracket(self, inner: Expression) -> Expression:
        return inner

    def list(self, *elements: Expression | None) -> tuple[Expression, ...]:
        return _present(elements)

    arguments = list

    def array(self, elements: tuple[Expression, ...]) -> Array:
        return Array(elements, _depth(*elements))

    def index(self, value: Expression, places: tuple[Expression, ...]) -> Expression:
        if isinstance(value, Name) and value.name == "p" and len(places) == POSE_LENGTH:
            return Array(places, _depth(*places), pose=True)
        return Index(value, places, _depth(value, *places))

    def named(self, name: Token, value: Expression) -> tuple[Token, Expression]:
        return name, value

    def call(self, name: Token, arguments: tuple) -> Call:
        return _call(name, arguments)

    def run(self, word: Token, name: Token, arguments: tuple) -> Call:
        return _call(name, arguments, run=True)

    def member(self, value: Expression, name: Token) -> Index:
        return Index(value, (Constant(Key(name)),), _depth(value))

    def method(self, value: Expression, name: Token, arguments: tuple) -> MethodCall:
        if any(isinstance(argument, tuple) for argument in arguments):
            raise ScriptError(
                f"{shown(name)}: arguments of a method have no names", None, _line(name)
            )
        depth = _depth(value, *arguments)
        return MethodCall(value, str(name), arguments, _line(name), name.column or 0, depth)

    def unary(self, operator: Token, value: Expression) -> Expression:
        if operator == "-" and isinstance(value, Constant) and is_number(value.value):
            return Constant(-value.value)
        return Unary(str(operator), value, _depth(value))

    def binary(self, left: Expression, operator: Token, right: Expression) -> Binary:
        return Binary(str(operator), left, right, _depth(left, right))

    def logic(self, left: Expression, operator: Token, right: Expression) -> Expression:
        if operator == "xor":
            return self.binary(left, operator, right)
        before = left.terms if isinstance(left, Logic) and left.operator == operator else (left,)
        terms = (*before, right)
        return Logic(str(operator), terms, _depth(*terms))

    def block(self, *statements: Statement) -> Block:
        return statements

    def call_statement(self, value: Expression) -> Evaluation:
        return Evaluation(value, _line_of(value))

    def assignment(self, target: Expression, value: Expression) -> Assignment:
        place = variable_of(target)
        if place is None:
            raise ScriptError(
                "only variables and their elements can be assigned to", None, _line_of(target)
            )
        return Assignment(place[0].name, place[1], value, place[0].line)

    def declaration(self, scope: Token, name: Token, value: Expression | None) -> Declaration:
        return Declaration(str(scope), str(name), value, _line(scope))

    def condition(self, *parts: Any) -> Condition:
        *branches, _, otherwise, _ = parts  # each of three: word, condition, block
        triples = zip(branches[0::3], branches[1::3], branches[2::3], strict=True)
        return Condition(
            tuple((test, block, _line(word)) for word, test, block in triples), otherwise or ()
        )

    def loop(self, word: Token, condition: Expression, body: Block, end: Token) -> Loop:
        return Loop(condition, body, _line(word))

    def parameter(self, name: Token, default: Expression | None) -> tuple[str, Expression | None]:
        return str(name), default

    parameters = list

    def routine(
        self, kind: Token, name: Token, parameters: tuple, body: Block, end: Token
    ) -> Routine:
        return Routine(str(kind), str(name), parameters, body, _line(kind))

    def program(self, block: Block) -> Routine:
        if len(block) == 1 and isinstance(block[0], Routine):
            return block[0]
        return Routine("def", OUTSIDE, (), block, 1)

    def giving_back(self, word: Token, value: Expression | None) -> Return:
        return Return(value, _line(word))

    def word(self, word: Token) -> Word:
        return Word(str(word), _line(word))

    def thread_end(self, word: Token, thread: Expression) -> ThreadEnd:
        return ThreadEnd(str(word), thread, _line(word))


def variable_of(target: Expression) -> tuple[Name, tuple[Expression, ...]] | None:
    """The variable that an expression is a part of, and where in it; None if of none."""
    places: tuple[Expression, ...] = ()
    while isinstance(target, Index):
        places = (*target.places, *places)
        target = target.value
    return (target, places) if isinstance(target, Name) else None


def _present(parts: tuple) -> tuple:
    """Without what the parser puts in for something that is absent."""
    return tuple(part for part in parts if part is not None)


def _depth(*inner: Expression) -> int:
    """Of what holds these.

    Raises:
        ScriptError: It is too deep: what walks the tree later recurses.
    """
    depth = 1 + max((expression.depth for expression in inner), default=0)
    if depth > DEEPEST:
        raise ScriptError(f"this nests deeper than {DEEPEST}", None, max(map(_line_of, inner)))
    return depth


def _call(name: Token, arguments: tuple, *, run: bool = False) -> Call:
    named = [isinstance(argument, tuple) for argument in arguments]
    first = named.index(True) if True in named else len(named)
    if not all(named[first:]):
        raise ScriptError(
            f"{shown(name)}: arguments without a name come before those with one", None, _line(name)
        )
    pairs = tuple((str(key), value) for key, value in arguments[first:])
    plain = arguments[:first]
    depth = _depth(*plain, *(value for _, value in pairs))
    return Call(str(name), plain, pairs, _line(name), name.column or 0, depth, run)


def _line(token: Token) -> int:
    return int(token.line or 0)


def _line_of(expression: Expression) -> int:
    """Where it begins; 0 where that is not known."""
    while not isinstance(expression, Name | Call | MethodCall):
        match expression:
            case Binary():
                expression = expression.left
            case Unary() | Index():
                expression = expression.value
            case _:
                return 0
    return expression.line


def make_ready() -> None:
    """Make the parser's tables, which takes a tenth of a second."""
    _parser()


@cache
def _parser() -> Lark:
    grammar = (files("sim.controller.urscript") / "grammar.lark").read_text(encoding="utf-8")
    return Lark(
        grammar,
        parser="lalr",
        lexer="basic",
        start="program",
        postlex=_Lines(),
        transformer=_Tree(),
        maybe_placeholders=True,
    )
