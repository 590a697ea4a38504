"""The list of pairs that COLMAP reads: two names in a line, with a space in between."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

from gsfw.core.files.atomic import write_atomically
from gsfw.preparation.native import names_by_number

if TYPE_CHECKING:
    from pycolmap import Database

Pair = tuple[str, str]
"""Names of two images."""
MARK = "\x1f"
"""Begins a name that is written otherwise while pairs are matched; no file name begins so."""


def listable(name: str) -> str:
    """A name without spaces; one that has none, and does not look like a comment, as it is."""
    if name.startswith("#") or any(letter.isspace() for letter in name):
        return MARK + quote(name)
    return name


def write_match_list(path: Path, pairs: Iterable[Pair]) -> None:
    """Write pairs of names as ``listable`` has them."""
    lines = (f"{listable(first)} {listable(second)}\n" for first, second in pairs)
    write_atomically(path, "".join(lines).encode())


@contextmanager
def listable_names(path: Path) -> Iterator[None]:
    """A database whose names can be listed, for as long as pairs are matched."""
    import pycolmap

    with pycolmap.Database.open(path) as database:
        _rename(database, {name: listable(name) for name in names_by_number(database).values()})
    try:
        yield
    finally:
        with pycolmap.Database.open(path) as database:
            restore_names(database)


def restore_names(database: Database) -> None:
    """The true names, also where a process was ended before it could restore them."""
    marked = [name for name in names_by_number(database).values() if name.startswith(MARK)]
    _rename(database, {name: unquote(name[len(MARK) :]) for name in marked})


def _rename(database: Database, names: dict[str, str]) -> None:
    import pycolmap

    changed = {old: new for old, new in names.items() if old != new}
    if not changed:
        return
    with pycolmap.DatabaseTransaction(database):
        for image in database.read_all_images():
            if image.name in changed:
                image.name = changed[image.name]
                database.update_image(image)
