"""What Griffe would read otherwise than the source means it: citations, units and array shapes."""

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import griffe

REFERENCES = Path(__file__).parents[2] / "REFERENCES.md"
KEYS = re.findall(r"^\| ([A-Z][\w -]*) \|", REFERENCES.read_text(encoding="utf-8"), re.MULTILINE)
CITATION = re.compile(rf"\[((?:{'|'.join(KEYS)})(?:,\s[^\]]*)?)\]")
PAIR = re.compile(r"\[(?=[^\[\]]*\]\s\[)")
"""The first bracket of `[n] [m]`, a shape and its unit, which would be a link in Markdown."""


def link_citations(text: str) -> str:
    """Make every `[Zhang, Eq. 27]` a link to REFERENCES.md."""
    return CITATION.sub(r"[\\[\1\\]][references]", PAIR.sub(r"\\[", text))


def subexpressions(expression: object) -> Iterator[griffe.Expr]:
    """An expression and all that it is made of."""
    if isinstance(expression, list):
        for part in expression:
            yield from subexpressions(part)
    elif isinstance(expression, griffe.Expr):
        yield expression
        for field in fields(expression):
            if field.name != "parent":
                yield from subexpressions(getattr(expression, field.name))


def quote_shapes(annotation: object) -> None:
    """Give the shapes in jaxtyping's annotations their quotes back: `Float[np.ndarray, "n"]`.

    Griffe takes a string in an annotation for a forward reference.
    """
    for part in subexpressions(annotation):
        if isinstance(part, griffe.ExprSubscript) and part.canonical_path.startswith("jaxtyping."):
            array, shape = part.slice.elements
            part.slice.elements = [array, '"' + str(shape).strip("'\"") + '"']


def unpacked(
    statement: ast.Assign, following: ast.stmt, module: griffe.Module
) -> Iterator[griffe.Attribute]:
    """The attributes that `A, B = 1, 2` defines, with the docstring below it."""
    value = statement.value
    documented = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
    for index, target in enumerate(statement.targets[0].elts):
        part = value.elts[index] if isinstance(value, ast.Tuple) else None
        yield griffe.Attribute(
            target.id,
            value=griffe.safe_get_expression(part, parent=module),
            lineno=statement.lineno,
            endlineno=statement.end_lineno,
            docstring=griffe.Docstring(following.value.value) if documented else None,
        )


class AsMeant(griffe.Extension):
    """Mends each object before mkdocstrings shows it."""

    def on_module_members(self, *, node: object, mod: griffe.Module, **_: object) -> None:
        """Add the names of `A, B = 1, 2`, which Griffe passes over."""
        body = node.body if isinstance(node, ast.Module) else []
        for statement, following in pairwise([*body, ast.Pass()]):
            if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Tuple):
                for attribute in unpacked(statement, following, mod):
                    mod.set_member(attribute.name, attribute)

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Link the citations of any object's docstring."""
        if obj.docstring is not None:
            obj.docstring.value = link_citations(obj.docstring.value)

    def on_function(self, *, func: griffe.Function, **_: object) -> None:
        """Quote the shapes of what a function takes and gives."""
        for parameter in func.parameters:
            quote_shapes(parameter.annotation)
        quote_shapes(func.returns)

    def on_attribute(self, *, attr: griffe.Attribute, **_: object) -> None:
        """Quote the shape of a field."""
        quote_shapes(attr.annotation)
        quote_shapes(attr.value)
