"""SpzImporter: reads SPZ of all versions."""

from __future__ import annotations

from pathlib import Path

from gsfw.core.exchange import Importer, SplatFile
from gsfw.formats.spz.layout import HALVES
from gsfw.formats.spz.quantisation import unpacked
from gsfw.formats.spz.streams import begins_like_spz, read_streams
from gsfw.formats.stored_rows import activated


class SpzImporter(Importer):
    """Reads versions 1 to 4, SH degree 0 to 4; the frame becomes x right, y down, z forward.

    No upward direction is stated: every converter turns every world by the same rotation, whatever
    is up in it, so that the names of the axes say nothing about the scene.
    """

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True if the file begins like SPZ, decompressed if need be."""
        return begins_like_spz(path)

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged or no SPZ.
            UnavailableError: it is version 4, and Zstandard is not installed.
        """
        header, streams, signs = read_streams(path)
        splats, dropped = activated(path, unpacked(streams, header).mirrored(signs))
        properties = {"version": str(header.version)}
        if header.version != HALVES:
            properties["fractional bits"] = str(header.bits)
        return SplatFile(
            splats,
            antialiased=header.antialiased,
            properties=properties,
            num_dropped=dropped,
        )
