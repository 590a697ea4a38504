"""Write a model in every format of splats, read it back, and compare: bytes, seconds, PSNR.

    python benchmarks/formats.py FILE_OR_RUN [--also spz,version=4 ...] [--repeats 3]

Prints a Markdown table. Seconds are the fastest of some repeats; the file is in the cache of the
system. PSNR is that of `gsfw convert`: all pixels of 12 images from around the splats, against the
model as it was given. Formats that gsfw does not read back have neither seconds nor PSNR there.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.core.exchange import Exporter, Holds, SplatFile
from gsfw.core.files.reading import bytes_of
from gsfw.core.splats import Sh
from gsfw.formats.visible_splats import without_invisible
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.initial_splats import find_importer, importer_of
from gsfw.plugins.loading import load_all
from gsfw.plugins.orbit_psnr import orbit_psnr
from gsfw.plugins.registry import installed
from gsfw.plugins.run_source import RunSource
from gsfw.studies.origin import origin

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Row:
    """One format."""

    label: str
    bytes_per_splat: float
    writing: float
    """Seconds."""
    reading: float | None
    """Seconds; ``None`` if gsfw does not read the format."""
    psnr: float | None
    """In dB; ``None`` for the same."""
    degree: int | None

    def cells(self) -> list[str]:
        """The row of the table."""
        read = [
            "-" if self.reading is None else f"{self.reading:.2f}",
            "-" if self.degree is None else str(self.degree),
            "-" if self.psnr is None else "same" if self.psnr >= 100 else f"{self.psnr:.1f}",
        ]
        return [self.label, f"{self.bytes_per_splat:.1f}", f"{self.writing:.2f}", *read]


def content_of(given: str) -> SplatFile:
    """The splats of a file or of a run, without invisible ones."""
    found = find_run(given, print, splats=True)
    if found.splat_file is not None:
        content = find_importer(found.splat_file, installed()).read(found.splat_file)
    else:
        content = RunSource(restore_run(found, installed())).splat_file()
    return without_invisible(content)[0]


def exporters(also: list[str]) -> Iterator[tuple[str, Exporter]]:
    """Every format of splats with its defaults, and those with options, such as "spz,version=4"."""
    for name, kind in load_all("exporter", installed()).items():
        if kind.holds is Holds.SPLATS:
            yield name, kind()
    for text in also:
        name, *options = text.split(",")
        given = dict(option.split("=", 1) for option in options)
        yield " ".join([name, *options]), make_exporter(name, installed(), given)


def fastest(repeats: int, action: Callable[[], Answer]) -> tuple[float, Answer]:
    """Seconds of the fastest repeat, and the result."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        answer = action()
        best = min(best, time.perf_counter() - start)
    return best, answer


def measured(label: str, exporter: Exporter, content: SplatFile, repeats: int) -> Row:
    """Write, read and compare."""
    count = len(content.splats)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"splats{exporter.suffix}"
        writing, _ = fastest(repeats, lambda: exporter.write(path, content))
        size = bytes_of(path) / count
        if not exporter.is_readable or importer_of(path, installed()) is None:
            return Row(label, size, writing, None, None, None)
        importer = find_importer(path, installed())
        reading, after = fastest(repeats, lambda: importer.read(path))
        assert isinstance(after.splats.colors, Sh)
        degree = after.splats.colors.degree
        return Row(label, size, writing, reading, orbit_psnr(content, after), degree)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", help="a splat file, a model file or a run")
    parser.add_argument("--also", nargs="*", default=[], metavar="FORMAT,KEY=VALUE")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    content = content_of(options.what)
    assert isinstance(content.splats.colors, Sh)
    rows = [
        measured(label, exporter, content, options.repeats)
        for label, exporter in exporters(options.also)
    ]
    print(
        f"{Path(options.what).name}: {len(content.splats):,} splats, SH degree "
        f"{content.splats.colors.degree}; {origin()['cpu']}\n"
    )
    columns = ["format", "bytes per splat", "write (s)", "read (s)", "SH degree", "PSNR (dB)"]
    print("| " + " | ".join(columns) + " |")
    print("|---" + "|---:" * (len(columns) - 1) + "|")
    for row in sorted(rows, key=lambda row: -row.bytes_per_splat):
        print("| " + " | ".join(row.cells()) + " |")


if __name__ == "__main__":
    main()
