"""Members of a public class: its attributes with the text below each, and its methods."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from itertools import pairwise
from types import ModuleType
from typing import Any

from gsfw import api
from reference.signatures import shown


@dataclass(frozen=True)
class Attribute:
    """A field, a constant of the class, a member of an enumeration, or a property."""

    name: str
    kind: str
    """Type as text; empty if none is declared."""
    default: str
    """Default of a field of a dataclass, or value of a member, as code; empty for none."""
    meaning: str
    """Docstring."""


@dataclass(frozen=True)
class Method:
    """A public method."""

    name: str
    decorators: tuple[str, ...]
    """Such as "abstractmethod"."""
    function: Any


def own_bases(found: type[Any]) -> list[type[Any]]:
    """The class and its bases within gsfw, in the order of lookup."""
    return [base for base in found.__mro__ if base.__module__.startswith("gsfw.")]


def attributes(found: type[Any]) -> Iterator[Attribute]:
    """Documented attributes, those of bases first, then properties."""
    bases = own_bases(found)[::-1]
    docs: dict[str, str] = {}
    kinds: dict[str, str] = {}
    for base in bases:
        docs |= attribute_docs(base)
        kinds |= {name: shown(kind) for name, kind in inspect.get_annotations(base).items()}
    defaults = _defaults(found)
    for name, meaning in docs.items():
        if not name.startswith("_"):
            yield Attribute(name, kinds.get(name, ""), defaults.get(name, ""), meaning)
    properties = {
        name: value
        for base in bases
        for name, value in vars(base).items()
        if isinstance(value, property) and not name.startswith("_") and name not in docs
    }
    for name, value in properties.items():
        kind = shown(inspect.signature(value.fget).return_annotation) if value.fget else ""
        yield Attribute(name, kind, "", inspect.cleandoc(value.__doc__ or ""))


def _defaults(found: type[Any]) -> dict[str, str]:
    if issubclass(found, Enum):
        return {item.name: repr(item.value) for item in found}
    if not is_dataclass(found):
        return {}
    return {item.name: repr(item.default) for item in fields(found) if item.default is not MISSING}


def methods(found: type[Any]) -> Iterator[Method]:
    """Public methods, with those of bases that have no page of their own."""
    seen: set[str] = set()
    for base in own_bases(found):
        if base is not found and base in _public_classes():
            continue
        for name, value in vars(base).items():
            function = value.__func__ if isinstance(value, classmethod | staticmethod) else value
            if name.startswith("_") or name in seen or not inspect.isfunction(function):
                continue
            seen.add(name)
            yield Method(name, tuple(_decorators(value)), function)


def _decorators(value: object) -> Iterator[str]:
    if isinstance(value, classmethod | staticmethod):
        yield type(value).__name__
    if getattr(value, "__isabstractmethod__", False):
        yield "abstractmethod"


@cache
def _public_classes() -> frozenset[type[Any]]:
    found = [getattr(api, name) for name in dir(api)]
    return frozenset(item for item in found if inspect.isclass(item))


def constant(name: str, module: ModuleType) -> tuple[str, str]:
    """The assignment of a name, where it is made, and the text below it."""
    for statement in _body(module):
        for alias in getattr(statement, "names", ()):
            if isinstance(statement, ast.ImportFrom) and name in (alias.asname, alias.name):
                return constant(alias.name, import_module(statement.module or ""))
    for statement in _body(module):
        if name in _targets(statement):
            return ast.unparse(statement), attribute_docs(module).get(name, "")
    raise ValueError(f"{module.__name__} assigns no {name}")


@cache
def attribute_docs(found: Any) -> dict[str, str]:  # noqa: ANN401 - a module or a class
    """The text below each assignment of a module or a class, by name."""
    body = _body(found)
    docs: dict[str, str] = {}
    for statement, following in pairwise(body):
        text = getattr(getattr(following, "value", None), "value", None)
        if isinstance(following, ast.Expr) and isinstance(text, str):
            docs |= dict.fromkeys(_targets(statement), " ".join(text.split()))
    return docs


@cache
def _body(found: Any) -> list[ast.stmt]:  # noqa: ANN401 - a module or a class
    tree: Any = ast.parse(textwrap.dedent(inspect.getsource(found)))
    return tree.body[0].body if isinstance(found, type) else tree.body


def _targets(statement: ast.stmt) -> list[str]:
    """The names that a statement assigns."""
    targets = getattr(statement, "targets", [getattr(statement, "target", None)])
    return [target.id for target in targets if isinstance(target, ast.Name)]
