"""Signatures as code: the call of a function, method or class, with names, types and defaults."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from enum import Enum
from inspect import Parameter, Signature
from typing import Any

WIDTH = 88
"""Longest line of a signature, in characters."""


class _Plain(str):
    """An annotation that is shown as it is written."""

    __slots__ = ()
    __repr__ = str.__str__


def signature(name: str, found: Any) -> str:  # noqa: ANN401 - anything that can be called
    """A call with names and types, on one line, or with a line for each argument."""
    found_signature = inspect.signature(found)
    arguments = [
        item.replace(annotation=_plain(item.annotation), default=_default(item.default))
        for item in found_signature.parameters.values()
        if item.name not in ("self", "cls")
    ]
    returned = _plain(found_signature.return_annotation)
    line = f"{name}{Signature(arguments, return_annotation=returned)}"
    if len(line) <= WIDTH:
        return line
    lines = "".join(f"    {text},\n" for text in _arguments(arguments))
    return f"{name}(\n{lines}{str(Signature(return_annotation=returned))[1:]}"


def shown(annotation: Any) -> str:  # noqa: ANN401 - any annotation
    """A type as text; empty for none."""
    if annotation is Signature.empty:
        return ""
    return annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)


def _plain(annotation: Any) -> Any:  # noqa: ANN401 - any annotation
    """Annotations are text where they are not evaluated: shown without quotes."""
    return _Plain(annotation) if isinstance(annotation, str) else annotation


def _default(value: Any) -> Any:  # noqa: ANN401 - any default
    """Members of enumerations are shown by their names."""
    return _Plain(value) if isinstance(value, Enum) else value


def _arguments(arguments: list[Parameter]) -> Iterator[str]:
    """Each argument as text, with the mark before those that are given by name only."""
    marked = False
    for item in arguments:
        if item.kind is Parameter.KEYWORD_ONLY and not marked:
            yield "*"
        marked = marked or item.kind in (Parameter.KEYWORD_ONLY, Parameter.VAR_POSITIONAL)
        yield str(item)
