"""Values: converts text from the command line or a file to a setting's type, and to plain data."""

from __future__ import annotations

import math
import types
from collections.abc import Callable
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin

from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    UnsupportedTypeAnnotationError,
)

WORDS_FOR_TRUE = ("true", "1", "yes", "on")
WORDS_FOR_FALSE = ("false", "0", "no", "off")
WORDS_FOR_NONE = ("none", "null")


def _boolean(text: str) -> bool:
    word = text.lower()
    if word not in WORDS_FOR_TRUE + WORDS_FOR_FALSE:
        raise ValueError(text)
    return word in WORDS_FOR_TRUE


def _whole_number(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        number = float(text)  # So that steps=3e4 is valid.
        if not number.is_integer():
            raise
        return int(number)


def _number(text: str) -> float:
    number = float(text)
    if math.isnan(number):
        raise ValueError(text)
    return number


def _none(text: str) -> None:
    if text.lower() not in WORDS_FOR_NONE:
        raise ValueError(text)


SCALARS: dict[Any, tuple[str, Callable[[str], Any]]] = {
    bool: ("true or false", _boolean),
    int: ("a whole number", _whole_number),
    float: ("a number", _number),
    str: ("text", str),
    Path: ("a path", Path),
    type(None): ("none", _none),
}
"""Name in messages, and parser, of each primitive type; tyro builds all other types from these."""

_RULES = ConstructorRegistry()


@_RULES.primitive_rule
def _scalar_rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    if info.type not in SCALARS:
        return None
    name, read = SCALARS[info.type]

    def instance(arguments: list[str]) -> object:
        return read(arguments[0])

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=name,
        instance_from_str=instance,
        is_instance=lambda value: isinstance(value, info.type),
        str_from_instance=lambda value: [str(value)],
    )


def describe(kind: Any) -> str:  # noqa: ANN401 - any annotation
    """Describe the values of this type, as a phrase: "a whole number"."""
    parts = get_args(kind)
    origin = get_origin(kind)
    if kind in SCALARS:
        return SCALARS[kind][0]
    if origin in (Union, types.UnionType):
        return " or ".join(describe(part) for part in parts)
    if origin is tuple and parts[-1] is not Ellipsis:
        return ",".join(describe(part).removeprefix("a ") for part in parts)
    if origin in (tuple, list):
        return f"a list ({describe(parts[0])}, ...)"
    choices = _constructor(kind).choices
    return f"one of {', '.join(choices)}" if choices else str(_constructor(kind).metavar)


@cache
def _constructor(kind: Any) -> PrimitiveConstructorSpec[Any]:  # noqa: ANN401 - any annotation
    with _RULES:
        found = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kind, set()))
    if isinstance(found, UnsupportedTypeAnnotationError):
        raise TypeError(f"settings of type {kind} cannot be read from text")
    return found


def parse(kind: Any, given: object) -> Any:  # noqa: ANN401 - any annotation, and its value
    """Parse a value of type ``kind`` from text, or from the plain data of a file or preset.

    Raises:
        ValueError: ``given`` is no such value.
        TypeError: no setting can have this type.
    """
    if kind is str and given is None:  # "data:" in a file, with nothing after it.
        return ""
    constructor = _constructor(kind)
    if constructor.nargs == 1:
        if isinstance(given, list | tuple):
            raise ValueError(f"{given} is a list")
        arguments = [as_text(given)]
    else:
        arguments = _items(given)
    try:
        with _RULES:
            return constructor.instance_from_str(arguments)
    except (ValueError, KeyError, OverflowError) as error:
        raise ValueError(f"{as_text(given)!r} is not {describe(kind)}") from error


def _items(given: object) -> list[str]:
    """The items of a list: plain data, or "a,b", or "[a, b]"."""
    if isinstance(given, list | tuple):
        return [as_text(item) for item in given]
    text = as_text(given).strip()
    if text[:1] + text[-1:] in ("[]", "()"):
        text = text[1:-1]
    return [item.strip() for item in text.split(",")] if text.strip() else []


def as_text(given: object) -> str:
    """A value as text of the command line."""
    if isinstance(given, bool):
        return "true" if given else "false"
    if given is None:
        return "none"
    if isinstance(given, Enum):
        return given.name
    if isinstance(given, list | tuple):
        return ",".join(as_text(item) for item in given)
    return str(given)


def plain(value: object) -> Any:  # noqa: ANN401 - whatever the setting holds
    """A setting's value as plain data, which ``parse`` turns into the same value."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return as_text(value)
