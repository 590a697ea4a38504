"""SpzExporter: writes SPZ of version 2, 3 or 4."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Literal

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource, SplatFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.splats import Splats
from gsfw.formats.spz.layout import AS_PLY, ENTRY, MOST_BITS, MOST_DEGREE, PLAIN_HEADER, SpzHeader
from gsfw.formats.spz.quantisation import SH_BITS, packed_bands, packed_base
from gsfw.formats.spz.zstandard import check_available, compressed
from gsfw.formats.stored_rows import RDF_TO_RUB, Signs, check_any, stored_parts

AXES = {"rub": RDF_TO_RUB, "rdf": (1.0, 1.0, 1.0)}
"""Signs of the axes of PLY files in those that a file may have."""
BITS = 12
"""Bits after the point: of the official encoder, always."""
LARGEST = (1 << MOST_BITS) - 1
"""Largest 24-bit integer with a sign."""
STEPS_OF_A_SPLAT = 8
"""Steps of a position in the median scale, if they fit: a 16th of it is then the largest error."""
COARSEST = 2
"""Most median scales of one step: beyond it splats are moved by more than their size."""


@dataclass(frozen=True)
class SpzExporter(Exporter):
    """Writes quantised splats, about a tenth of the size of a PLY."""

    suffix = ".spz"

    version: Literal[2, 3, 4] = 3
    """Version of the format: 2, 3 (more exact rotations) or 4 (Zstandard in place of gzip, SH
    degree 4). Few viewers read 4 yet."""
    sh_bits: Literal[4, 5, 6, 7, 8] = SH_BITS
    """Bits of the SH bands, in which this format loses most; every reader takes all of them. 4, as
    Niantic's encoder: smallest. 6: half more bytes, 7 to 8 dB nearer to the splats."""

    axes: Literal["rub", "rdf"] = "rub"
    """Axes of the file. rub: right, up, back, as the format specifies. rdf: those of PLY files, as
    SuperSplat and converters of PLY expect; a record in the file says so."""

    def __post_init__(self) -> None:
        """Check the options.

        Raises:
            ConfigError: they are not written.
        """
        if self.sh_bits not in range(4, 9):
            raise ConfigError(f"format.sh_bits={self.sh_bits}: expected 4 to 8.")
        if self.version not in (2, 3, 4):
            raise ConfigError(
                f"format.version={self.version}: SPZ is written in version 2, 3 or 4.",
                "Leave it out for 3, which most viewers read.",
            )
        if self.axes not in AXES:
            raise ConfigError(f"format.axes={self.axes}: expected {' or '.join(AXES)}.")

    @property
    def most_sh_degree(self) -> int:
        """Highest SH degree that a file holds in this version."""
        return MOST_DEGREE[self.version]

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; SH bands above the degree of the version are left out.

        Raises:
            OutputError: it cannot be written.
            UnavailableError: version 4, and Zstandard is not installed.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        content = source.splat_file()
        check_any(content.splats)
        if self.version >= PLAIN_HEADER:
            check_available("format.version=4")
        splats = content.splats.up_to(MOST_DEGREE[self.version])
        records = AS_PLY if self.axes == "rdf" else b""
        header = _header(self.version, content, splats, len(records))
        streams = _streams(splats, header, self.sh_bits, AXES[self.axes])
        with atomic_file(path) as file:
            if self.version >= PLAIN_HEADER:
                _write_by_stream(file, streams, header, records)
            else:
                encoder = zlib.compressobj(wbits=31)
                file.write(encoder.compress(header.to_bytes()))
                for stream in streams:
                    for part in stream:
                        file.write(encoder.compress(part))
                file.write(encoder.compress(records) + encoder.flush())


def _header(version: int, content: SplatFile, splats: Splats, records: int) -> SpzHeader:
    """The header of a file with so many bytes of extension records."""
    degree, bits = splats.sh_degree, _fractional_bits(splats)
    plain = SpzHeader(version, len(splats), degree, bits, content.antialiased, records > 0)
    return replace(plain, table=plain.table + records)


def _fractional_bits(splats: Splats) -> int:
    """Bits of the positions after the point: 12, more for small splats, fewer for large worlds.

    Raises:
        ValueError: the world is too large for 24 bits, or for 24 bits of splats as small.
    """
    farthest = float(splats.means.abs().max())
    size = float(splats.scales.median()) if splats.scales is not None else math.nan
    if not math.isfinite(farthest) or not math.isfinite(size):
        return BITS  # The rows are refused with their own reason.
    wanted = max(BITS, math.ceil(math.log2(STEPS_OF_A_SPLAT / size))) if size > 0 else BITS
    fitting = math.floor(math.log2(LARGEST / max(farthest, 1e-9)))
    bits = max(0, min(wanted, fitting, MOST_BITS))
    if farthest > LARGEST or (bits == fitting and 2.0**-bits > COARSEST * size > 0):
        row = int(splats.means.abs().amax(dim=1).argmax())
        raise ValueError(
            f"means: row {row} is {farthest:g} from the origin, where 24-bit positions are "
            f"{2.0**-fitting:.2g} apart, and the median splat is {size:.2g} in size; move the data "
            "set nearer to its origin, cut off what is far (gsfw edit FILE "
            "crop.sphere=0,0,0,RADIUS), or write format=ply"
        )
    return bits


def _streams(
    splats: Splats, header: SpzHeader, sh_bits: int, signs: Signs
) -> Iterator[Iterable[bytes]]:
    """The streams, each part by part.

    All but the SH bands are packed at once, 20 bytes a splat; the bands, the bulk of a file, while
    they are written.
    """
    base = (part.mirrored(signs) for part in stored_parts(splats.up_to(0)))
    yield from zip(*(packed_base(part, header) for part in base), strict=True)
    if header.degree:
        parts = (part.mirrored(signs) for part in stored_parts(splats))
        yield (packed_bands(part.rest, sh_bits) for part in parts)


def _write_by_stream(
    file: BinaryIO, streams: Iterable[Iterable[bytes]], header: SpzHeader, records: bytes
) -> None:
    """Version 4: the table of sizes is filled in when the streams are written."""
    sizes = header.stream_sizes
    file.write(header.to_bytes() + records)
    file.write(bytes(ENTRY.size * len(sizes)))
    entries = []
    for stream, size in zip(streams, sizes, strict=True):
        written = sum(file.write(part) for part in compressed(stream, size))
        entries.append(ENTRY.pack(written, size))
    file.seek(header.table)
    file.write(b"".join(entries))
