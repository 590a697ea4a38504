"""KsplatImporter: reads KSPLAT of all levels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.files.reading import first_bytes, readable
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.formats.activation import dc_of, log_scales_of, logits_of
from gsfw.formats.ksplat.layout import (
    CENTER_BYTES,
    LEVELS,
    MAIN,
    MAIN_BYTES,
    SECTION_BYTES,
    SH_RANGE,
    VERSION,
    Section,
    record_type,
)
from gsfw.formats.stored_rows import StoredRows, activated

MOST_DEGREE = 3


@dataclass(frozen=True)
class _Header:
    """The main header."""

    sections: int
    count: int
    level: int
    sh_range: tuple[float, float]


class KsplatImporter(Importer):
    """Reads levels 0 to 2, SH degree 0 to 3."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True if a header of this version announces what the size of the file allows.

        The format has no magic number.
        """
        header = _main_header(first_bytes(path, MAIN.size))
        if header is None:
            return False
        size = path.stat().st_size
        if not 0 < header.sections <= (size - MAIN_BYTES) // SECTION_BYTES:
            return False
        least = record_type(header.level, 0).itemsize
        return 0 < header.count <= (size - MAIN_BYTES) // least

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged or not of this format.
        """
        with readable(path):
            raw = path.read_bytes()
        header = _main_header(raw[: MAIN.size])
        if header is None or len(raw) < MAIN_BYTES:
            raise DataError(
                f"{path} is not a KSPLAT file of version 0.1: its header of 4096 bytes does not "
                "begin like one.",
                COPY_AGAIN,
            )
        # Numbers of damaged files that are no numbers give rows that are dropped.
        with np.errstate(over="ignore", invalid="ignore"):
            parts = [
                _stored_rows(path, raw[place:end], section, header)
                for section, place, end in _sections(path, raw, header)
            ]
        if not parts:
            raise DataError(f"{path} contains no splats: its sections are empty.", COPY_AGAIN)
        splats, dropped = activated(path, StoredRows.cat(parts))
        properties = {"level": str(header.level), "sections": str(header.sections)}
        return SplatFile(splats, properties=properties, num_dropped=dropped)


def _main_header(start: bytes) -> _Header | None:
    """The header, if it is one."""
    if len(start) < MAIN.size:
        return None
    major, minor, sections, _, _, count, level, *_, low, high = MAIN.unpack(start)
    if (major, minor) != VERSION or start[2:4] != b"\0\0" or level not in LEVELS:
        return None
    low, high = low or -SH_RANGE, high or SH_RANGE
    return _Header(sections, count, level, (low, high))


def _sections(path: Path, raw: bytes, header: _Header) -> Iterator[tuple[Section, int, int]]:
    """The sections that hold splats, with the places of their first byte and of the next one."""
    place = MAIN_BYTES + SECTION_BYTES * header.sections
    if place > len(raw):
        raise DataError(
            f"{path} is cut short: its header announces {header.sections} sections.", COPY_AGAIN
        )
    for index in range(header.sections):
        start = MAIN_BYTES + SECTION_BYTES * index
        section = Section.read(raw[start : start + SECTION_BYTES])
        if section.degree > MOST_DEGREE or section.count > section.room:
            what = (
                f"SH degree {section.degree}"
                if section.degree > MOST_DEGREE
                else f"{section.count} splats, and room for {section.room}"
            )
            raise DataError(
                f"{path} is a damaged KSPLAT file: section {index + 1} states {what}.", COPY_AGAIN
            )
        width = record_type(header.level, section.degree).itemsize
        end = place + section.bucket_bytes + section.room * width
        if end > len(raw):
            raise DataError(
                f"{path} is cut short: section {index + 1} announces {section.room} splats, up to "
                f"byte {end}, and the file has {len(raw)}.",
                COPY_AGAIN,
            )
        if section.count:
            yield section, place, end
        place = end


def _stored_rows(path: Path, raw: bytes, section: Section, header: _Header) -> StoredRows:
    """The splats of a section."""
    records = np.frombuffer(
        raw,
        dtype=record_type(header.level, section.degree),
        count=section.count,
        offset=section.bucket_bytes,
    )
    means = records["position"].astype(np.float64)
    if header.level:
        centers = _centers(path, raw, section)
        means = (means - section.steps) * (section.block / 2 / section.steps) + centers
    rgba = records["rgba"] / np.float32(255)
    return StoredRows(
        means=means,
        logits=logits_of(rgba[:, 3]),
        log_scales=log_scales_of(records["scale"]),
        quats=records["quat"].astype(np.float32),
        dc=dc_of(rgba[:, :3]),
        rest=_bands(records, section.degree, header),
    )


def _centers(path: Path, raw: bytes, section: Section) -> Float64[np.ndarray, "n 3"]:
    """The centre of the bucket of each splat."""
    partial = np.frombuffer(raw, dtype="<u4", count=section.partial).astype(np.int64)
    lengths = [section.bucket_size] * section.full if section.full <= section.count else []
    covered = section.bucket_size * section.full + int(partial.sum())
    fits = len(lengths) == section.full and section.full + section.partial <= section.buckets
    fits = fits and section.count <= covered <= section.room
    if section.center_bytes != CENTER_BYTES or not fits:
        raise DataError(
            f"{path} is a damaged KSPLAT file: the buckets of a section hold {covered} splats, "
            f"expected {section.count}.",
            COPY_AGAIN,
        )
    centers = np.frombuffer(
        raw, dtype="<f4", count=3 * (section.full + section.partial), offset=4 * section.partial
    )
    counts = np.concatenate([np.array(lengths, dtype=np.int64), partial])
    return centers.reshape(-1, 3).astype(np.float64).repeat(counts, axis=0)[: section.count]


def _bands(
    records: np.ndarray, degree: int, header: _Header
) -> Float32[np.ndarray, "n k_minus_1 3"]:
    """The SH coefficients above the constant one."""
    count, width = len(records), num_coefficients(degree) - 1
    rest = np.zeros((count, width, 3), dtype=np.float32)
    if not degree:
        return rest
    values = records["sh"].astype(np.float32)
    if header.level == LEVELS[-1]:
        low, high = header.sh_range
        values = values / np.float32(255) * np.float32(high - low) + np.float32(low)
    for band in range(1, degree + 1):
        columns = slice(band * band - 1, (band + 1) ** 2 - 1)
        stored = values[:, 3 * columns.start : 3 * columns.stop]
        rest[:, columns] = stored.reshape(count, 3, -1).transpose(0, 2, 1)
    return rest
