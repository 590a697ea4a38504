"""Database part: some images of COLMAP's database, as bytes on the way to another machine.

Rows are copied as they are, so that a pair has the same matches there as here: image numbers,
which the seed and the order of a pair follow, stay.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from gsfw.preparation.disk import check_room
from gsfw.preparation.native import native_failure

EVERY = "1"
"""Selects all rows."""
MATCHES = {"matches": EVERY, "two_view_geometries": EVERY}
"""Tables that matching fills."""


def part_of(database: Path, numbers: Collection[int]) -> bytes:
    """A database with some images, their cameras and features, and no matches.

    Args:
        database: COLMAP's, which no program has open.
        numbers: of the images.

    Raises:
        DataError: the database cannot be read.
        OutputError: the disk is nearly full.
    """
    listed = ", ".join(map(str, sorted(numbers)))
    own_frames = f"SELECT frame_id FROM source.frame_data WHERE data_id IN ({listed})"
    tables = {
        **dict.fromkeys(("cameras", "rigs", "rig_sensors"), EVERY),
        "frames": f"frame_id IN ({own_frames})",
        "frame_data": f"data_id IN ({listed})",
        **dict.fromkeys(("images", "keypoints", "descriptors"), f"image_id IN ({listed})"),
    }
    with _place(database) as folder, _readable("read features", database):
        return _new(folder / "part.db", database, tables)


def matches_of(database: Path) -> bytes:
    """A database with the matches of another one, and nothing else.

    Raises:
        DataError: the database cannot be read.
        OutputError: the disk is nearly full.
    """
    with _place(database) as folder, _readable("read matches", database):
        return _new(folder / "matches.db", database, MATCHES)


def add_matches(database: Path, found: bytes) -> None:
    """Copy matches into a database: all of them or, if the process ends in between, none.

    Args:
        database: COLMAP's, which no program has open.
        found: as of ``matches_of``.

    Raises:
        DataError: the database cannot be written.
        OutputError: the disk is nearly full.
    """
    with _place(database, 2 * len(found)) as folder, _readable("store matches", database):
        (folder / "matches.db").write_bytes(found)
        _copy(folder / "matches.db", database, MATCHES)


@contextmanager
def _place(database: Path, size: int = 0) -> Iterator[Path]:
    """A folder beside a database, for as long as it is used; ``size`` bytes will be written."""
    check_room(database, size)
    with TemporaryDirectory(dir=database.parent, prefix="part_") as folder:
        yield Path(folder)


@contextmanager
def _readable(task: str, database: Path) -> Iterator[None]:
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        raise native_failure(task, database, str(error)) from error


def _new(path: Path, source: Path, tables: Mapping[str, str]) -> bytes:
    """A new database with some rows of another one."""
    import pycolmap

    pycolmap.Database.open(path).close()
    _copy(source, path, tables)
    return path.read_bytes()


def _copy(source: Path, target: Path, tables: Mapping[str, str]) -> None:
    """Copy rows between databases, in place of those with the same keys.

    Args:
        source: a database of COLMAP.
        target: another one.
        tables: with a condition for the rows of each.
    """
    with closing(sqlite3.connect(target)) as opened:
        opened.execute("ATTACH ? AS source", (str(source),))
        with opened:
            for table, condition in tables.items():
                # By name: an older COLMAP has put them in another order.
                about = opened.execute(f"PRAGMA main.table_info({table})")
                columns = ", ".join(row[1] for row in about)
                opened.execute(
                    f"INSERT OR REPLACE INTO main.{table} ({columns}) "
                    f"SELECT {columns} FROM source.{table} WHERE {condition}"
                )
