"""JsonStore: records by their keys in one JSON file, which is complete after each change."""

from __future__ import annotations

import math
import types
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.core.words import uncapitalized

SCHEMA = 1
"""Number of the layout; raised when an older gsfw could not read a newer file."""

NAMES = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    dict: "an object",
    list: "a list",
    type(None): "null",
}
"""Types of JSON values in the words of messages."""

Key = tuple[Any, ...]


@dataclass(frozen=True)
class Keyed(ABC):
    """Plain data with a key."""

    @property
    @abstractmethod
    def key(self) -> Key:
        """Identifies the record in its file."""


T = TypeVar("T", bound=Keyed)


class JsonStore(Generic[T]):
    """One record for each key; the file has a list for each type of records."""

    def __init__(
        self,
        path: Path,
        lists: Mapping[str, type[T]],
        head: Mapping[str, Any],
        advice: str,
        in_order: bool = False,
    ) -> None:
        """Read the file where it exists.

        Args:
            path: of the file.
            lists: type of the records in each list of the document.
            head: the document's further entries.
            advice: what to do with a damaged file, as a sentence.
            in_order: write records in the order of their keys; else in the order of addition.

        Raises:
            DataError: the file is damaged, or a newer gsfw has written it.
        """
        self.path, self._lists, self._in_order = path, lists, in_order
        self.head = dict(head)
        self.stored: Mapping[str, Any] = {}
        """The document as it was read; empty where there was no file."""
        self.records: dict[Key, T] = {}
        if path.exists():
            self.stored = read_document(path, SCHEMA, advice)
            if not lists.keys() & self.stored.keys():
                raise _foreign(path, " and ".join(lists), advice)
            for name, kind in lists.items():
                for record in _read(path, self.stored.get(name, []), name, kind, advice):
                    self.records[record.key] = record

    def keep(self, record: T) -> None:
        """Add a record in place of an earlier one with its key.

        Raises:
            OutputError: the file cannot be written.
        """
        self.records[record.key] = record
        self.write()

    def forget(self, key: Key) -> None:
        """Remove the record of a key, if there is one.

        Raises:
            OutputError: the file cannot be written.
        """
        if self.records.pop(key, None) is not None:
            self.write()

    def write(self, more: Mapping[str, Any] = types.MappingProxyType({})) -> None:
        """Write the file, whole or not at all.

        Args:
            more: entries of the document for this time only.

        Raises:
            OutputError: the file cannot be written.
        """
        keys = sorted(self.records) if self._in_order else list(self.records)
        records = [self.records[key] for key in keys]
        document = {"schema": SCHEMA, **self.head, **more}
        for name, kind in self._lists.items():
            document[name] = [asdict(record) for record in records if isinstance(record, kind)]
        write_atomically(self.path, (json_text(document, indent=1) + "\n").encode())


def _foreign(path: Path, name: str, advice: str) -> DataError:
    return DataError(f"{path}: its {name} are not as gsfw writes them.", advice)


def _read(path: Path, found: Any, name: str, kind: type[T], advice: str) -> Iterator[T]:  # noqa: ANN401 - JSON
    """The records of a list; fields that this version does not know are left out."""
    known, hints = {item.name for item in fields(kind)}, get_type_hints(kind)
    try:
        for number, item in enumerate(found):
            values = {key: value for key, value in item.items() if key in known}
            for field, value in values.items():
                for place, wrong, expected in _mistakes(field, value, hints[field]):
                    raise DataError(
                        f"{path}: {name}[{number}]: {place} is {wrong!r}; expected {expected}.",
                        f"Put it right, or {uncapitalized(advice)}",
                    )
            yield kind(**values)
    except (AttributeError, TypeError):
        raise _foreign(path, name, advice) from None


def _mistakes(place: str, value: object, hint: Any) -> Iterator[tuple[str, object, str]]:  # noqa: ANN401 - annotations
    """Place, value and expected type of values that do not fit their annotation."""
    if hint is Any:
        return
    options = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    kinds = [dict if get_origin(o) is Mapping else get_origin(o) or o for o in options]
    if float in kinds:
        kinds = [kind for kind in kinds if kind is not int]
    found = float if float in kinds and type(value) is int else type(value)
    infinite = isinstance(value, float) and not math.isfinite(value)
    if found not in kinds or infinite:
        yield place, value, " or ".join(NAMES[kind] for kind in kinds)
    elif isinstance(value, dict):
        items = get_args(options[kinds.index(dict)])
        for key, item in value.items():
            yield from _mistakes(f"{place}.{key}", item, items[1] if items else Any)
