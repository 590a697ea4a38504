"""Reads streamed SOG of PlayCanvas: the finest level of each region, and the environment.

As splat-transform 3.7.0 (PlayCanvas, MIT) has it, an index may lack its version; and a file is a
folder of images with its ``meta.json``, or a ``.sog``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.reading import bytes_of, first_bytes, is_there
from gsfw.formats.sog.container import Container, opened
from gsfw.formats.sog.description import PLAIN_NAME, Description, generator_of, read_description
from gsfw.formats.sog.importer import Amount, SogImporter, read_rows
from gsfw.formats.stored_rows import StoredRows, activated
from gsfw.lod.streamed_sog import INDEX

START = 1 << 16
"""First bytes of an index, among which its mark is."""
MARK = b'"lodLevels"'
"""The name that no other JSON of splats has."""
VERSION = 1
LEVEL = re.compile(r"[0-9]{1,9}")
"""The name of a level."""


class StreamedSogImporter(Importer):
    """Reads folders with ``lod-meta.json``, given by either."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for a JSON with the number of levels near its beginning."""
        start = first_bytes(_index_path(path), START).lstrip()
        return start[:1] == b"{" and MARK in start

    def read(self, path: Path) -> SplatFile:
        """Read the finest level that each region has, file by file, and the environment.

        Raises:
            DataError: the index or a file that it needs is damaged, missing, or of another version.
        """
        path = _index_path(path)
        index = _Index.read(path)
        amount, antialiased = Amount(0, 0, 0), True
        parts: list[StoredRows] = []
        for file, ranges in index.finest.items():
            with opened(file) as container:
                about = read_description(container)
                amount += Amount.of(container, about)
                amount.check(path)
                parts.append(_taken(path, container, about, ranges))
            antialiased &= about.antialiased
        splats, dropped = activated(path, StoredRows.cat(parts))
        properties = {"generator": index.generator} if index.generator else {}
        return SplatFile(
            splats, antialiased=antialiased, properties=properties, num_dropped=dropped
        )

    def size(self, path: Path) -> int:
        """Bytes of the index and of the files of all levels.

        Raises:
            DataError: as of ``read``.
        """
        path = _index_path(path)
        files = _Index.read(path).files
        return bytes_of(path) + sum(SogImporter().size(file) for file in set(files))


def _index_path(path: Path) -> Path:
    return path / INDEX if path.is_dir() else path


Ranges = list[range]
"""Rows of a file."""


@dataclass
class _Index:
    """The checked content of an index."""

    files: list[Path]
    """All files of all levels; the environment, if there is one, comes last."""
    generator: str
    finest: dict[Path, Ranges | None] = field(default_factory=dict)
    """The files that are read, and which of their rows; ``None`` for all."""

    @staticmethod
    def read(path: Path) -> _Index:
        """Read an index.

        Raises:
            DataError: it is damaged, of another version, or names files elsewhere.
        """
        fields = JsonFields.read(path)
        if fields.count("version", default=VERSION) != VERSION:
            raise DataError(
                f"{path} is a streamed SOG of another version than {VERSION}, which gsfw reads.",
                "Convert it with the tool that wrote it, for example to PLY.",
            )
        names = fields.texts("filenames")
        index = _Index(
            [_file(path, name) for name in names], generator_of(fields.values.get("asset"))
        )
        index._add_regions(fields.fields("tree"))
        if fields.values.get("environment"):
            index.files.append(_file(path, fields.text("environment")))
            index.finest[index.files[-1]] = None
        index._check(path)
        return index

    def _check(self, path: Path) -> None:
        """Check that there is something to read.

        Raises:
            DataError: no region has a level, or a file is missing.
        """
        if not self.finest:
            raise DataError(f"{path} is damaged: none of its regions has a level.", COPY_AGAIN)
        for file in self.finest:
            if not is_there(file):
                name = file.relative_to(path.parent).as_posix()
                raise DataError(f"{path}: there is no {name}, which belongs to it.", COPY_AGAIN)

    def _add_regions(self, tree: JsonFields) -> None:
        """Note the finest level of every region."""
        nodes = [tree]
        while nodes:
            node = nodes.pop()
            nodes += reversed(node.objects("children", []))
            levels = node.fields("lods", {})
            known = filter(LEVEL.fullmatch, levels.values)
            finest = min(known, key=int, default=None)
            if finest is None:
                continue
            part = levels.fields(finest)
            number, offset = part.count("file"), part.count("offset")
            if number >= len(self.files):
                raise part.refuse("file", f"one of the {len(self.files)} files")
            ranges = self.finest.setdefault(self.files[number], [])
            assert ranges is not None
            ranges.append(range(offset, offset + part.count("count")))


def _file(index: Path, name: str) -> Path:
    """The description or archive that an index names, below its folder.

    Raises:
        DataError: the name leads elsewhere.
    """
    if not all(PLAIN_NAME.fullmatch(part) for part in name.split("/")):
        raise DataError(
            f"{index}: expected plain names of files below its folder, found {name[:60]!r}.",
            COPY_AGAIN,
        )
    return index.parent / name


def _taken(
    path: Path, container: Container, about: Description, ranges: Ranges | None
) -> StoredRows:
    """Rows of a file, each of them once."""
    rows = read_rows(container, about)
    if ranges is None:
        return rows
    chosen: Bool[np.ndarray, " n"] = np.zeros(len(rows), dtype=bool)
    for part in ranges:
        if part.stop > len(rows):
            raise DataError(
                f"{path}: a region ends at row {part.stop} of {container.path}, which has "
                f"{len(rows)}.",
                COPY_AGAIN,
            )
        chosen[part.start : part.stop] = True
    return rows.take(chosen)
