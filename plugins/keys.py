"""Keys: the settings of a configuration by dotted key, with type, value and explanation."""

from __future__ import annotations

import ast
import difflib
import inspect
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any, get_type_hints

from gsfw.plugins.registry import did_you_mean
from gsfw.plugins.values import as_text

SLOT_KEYS = ("strategy", "rasterizer", "datamanager", "sampler")
"""Fields of a method's configuration that are chosen by registered name."""


@dataclass(frozen=True)
class Key:
    """One setting."""

    name: str
    """Dotted name, as on the command line."""
    kind: Any
    """Type annotation."""
    value: Any
    owner: type[Any]
    """The dataclass that declares the setting."""

    @property
    def help(self) -> str:
        """Explanation in a sentence; empty if there is none."""
        return field_help(self.owner).get(self.name.rpartition(".")[2], "")


def keys(config: object, prefix: str = "") -> Iterator[Key]:
    """All settings of a configuration, except the choices of slots that are still open."""
    kind: type[Any] = type(config)
    hints = _annotations(kind)  # type: ignore[arg-type]  # To mypy, types are not Hashable.
    nested: list[tuple[str, object]] = []
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if is_dataclass(value):
            nested.append((item.name, value))
        elif item.init and not (prefix == "" and item.name in SLOT_KEYS and value is None):
            yield Key(prefix + item.name, hints[item.name], value, kind)
    for name, value in nested:
        yield from keys(value, f"{prefix}{name}.")


@cache
def _annotations(kind: type) -> dict[str, Any]:
    """Types of a dataclass's fields; to evaluate them takes longer than all else of ``keys``."""
    return get_type_hints(kind)


def renamed_keys(config: object, prefix: str = "") -> dict[str, str]:
    """Old dotted names of settings, groups and values of a configuration, and their current ones.

    Configuration classes declare them in ``renamed``, besides those of their bases; an empty name
    marks a removed setting.
    """
    declared: dict[str, str] = {}
    for kind in reversed(type(config).__mro__):
        declared |= vars(kind).get("renamed", {})
    found = {prefix + old: prefix + new if new else "" for old, new in declared.items()}
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if is_dataclass(value):
            found |= renamed_keys(value, f"{prefix}{item.name}.")
    return found


def current_key(key: str, renamed: Mapping[str, str]) -> str:
    """The current name of a setting; empty if it is removed."""
    seen: set[str] = set()
    while key and key not in seen:
        seen.add(key)
        for old, new in renamed.items():
            if key == old or key.startswith(f"{old}."):
                key = new + key[len(old) :] if new else ""
                break
    return key


def current_value(key: str, value: object, renamed: Mapping[str, str]) -> object:
    """The current name of a setting's value, as ``renamed`` declares "key=old" -> "key=new"."""
    new = renamed.get(f"{key}={as_text(value)}")
    return value if new is None else new.partition("=")[2]


def field_help(kind: type[Any]) -> dict[str, str]:
    """The docstring under each field of a dataclass, its own and inherited ones."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if is_dataclass(base):
            found |= _own_field_help(base)
    return found


def class_help(kind: type) -> str:
    """The docstring of a dataclass, also in a program without docstrings (``python -OO``).

    There ``__doc__`` is the signature, which dataclasses put in the place of a missing docstring.
    """
    declaration = _declaration(kind)
    if declaration is not None:
        return ast.get_docstring(declaration) or ""
    return "" if sys.flags.optimize > 1 else inspect.cleandoc(kind.__doc__ or "")


@cache
def _declaration(kind: type) -> ast.ClassDef | None:
    """The syntax tree of a class; none without a source, as of a class made in a session."""
    try:
        source = textwrap.dedent(inspect.getsource(kind))
        (tree,) = ast.parse(source).body
    except (OSError, TypeError, SyntaxError):
        return None
    return tree if isinstance(tree, ast.ClassDef) else None


@cache
def _own_field_help(kind: type) -> dict[str, str]:
    tree = _declaration(kind)
    if tree is None:
        return {}
    found: dict[str, str] = {}
    for statement, following in zip(tree.body, tree.body[1:], strict=False):
        if not isinstance(statement, ast.AnnAssign) or not isinstance(statement.target, ast.Name):
            continue
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            text = following.value.value
            if isinstance(text, str):
                found[statement.target.id] = " ".join(text.split())
    return found


def suggest_key(given: str, known: Iterable[str]) -> str:
    """Suggest the nearest key in a sentence with a leading space; empty if there is none.

    A key without its group ("means_lr") suggests the full one ("optim.means_lr"), and a word of
    another tool ("iterations") ours ("steps").
    """
    names = list(known)
    near = [name for name in names if name.rpartition(".")[2] == given.rpartition(".")[2]]
    same = difflib.get_close_matches(given, near, 1, cutoff=0.0)
    return f" Did you mean {same[0]!r}?" if same else did_you_mean(given, names)
