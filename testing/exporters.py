"""Promises of exporters: round trips, the world's frame, atomic writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import torch

from gsfw.core.exchange import Exporter, ExportSource, Holds, SplatFile
from gsfw.core.files.reading import bytes_of
from gsfw.plugins.loading import load
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.sources import SIZE, image_of, source_for, splat_file
from gsfw.testing.subject import Subject

SHADE = 0.02
"""Largest difference of images before and after: a few of 255 levels, which 8-bit formats have."""
PLACE = 1e-3 * SIZE
"""Largest distance of a position before and after, in units of the world."""
OLD = b"the old file"
FULL_DISK = 64
"""Bytes after which a write fails."""


def _exporter(subject: Subject) -> Exporter:
    exporter: Exporter = subject.target()
    return exporter


def _write(exporter: Exporter, path: Path, source: ExportSource) -> None:
    """Write a file.

    Raises:
        NotApplicable: the format cannot hold what the kit makes, such as splats without features.
    """
    try:
        exporter.write(path, source)
    except ValueError as error:
        raise NotApplicable(f"it refuses the splats of the checks: {error}") from error


def _writes_what_it_holds(subject: Subject) -> None:
    exporter, path = _exporter(subject), subject.workspace / f"file{subject.target.suffix}"
    require(
        (exporter.suffix.startswith(".") and len(exporter.suffix) > 1)
        or (exporter.is_folder and exporter.suffix == ""),
        f"suffix is {exporter.suffix!r}.",
        'Set the suffix of file names with its dot: suffix = ".splat"; a folder may have none.',
    )
    _write(exporter, path, source_for(subject, exporter.holds))
    is_there = path.is_dir() if exporter.is_folder else path.is_file()
    kind = "folder" if exporter.is_folder else "file"
    written = is_there and bytes_of(path) > 0
    require(written, f"write has made no {kind}.", "Write to the given path.")


def _round_trips(subject: Subject) -> None:
    for count, degree in ((12, 0), (1, 0), (12, 1)):
        before = splat_file(count, degree)
        after = _read_again(subject, before)
        apart = abs(len(after.splats) - len(before.splats))
        require(
            apart == 0,
            f"a file of {len(before.splats)} splats is read as {len(after.splats)}.",
            "Write every splat: gsfw has already removed the others.",
        )
        if degree:
            continue  # A format may hold no view dependence: it is enough that it is written.
        shade = (image_of(before.splats) - image_of(after.splats)).abs().max().item()
        require(
            shade <= SHADE,
            f"after reading the file, the image differs by {shade:.2g} (of 1).",
            "Write activated values as the format defines them: opacities or logits, scales or "
            "logarithms, wxyz or xyzw, colours or SH coefficients.",
        )


def _writes_the_world(subject: Subject) -> None:
    before = splat_file()
    after = _read_again(subject, before)
    found = after.splats.means.double()
    off = torch.cdist(before.splats.means, found).amin(1).max().item()
    require(
        off <= PLACE,
        f"the error of a position is {off:.3g} world units.",
        "Write the positions of the source unchanged: they are in the world of the data.",
    )


def _read_again(subject: Subject, content: SplatFile) -> SplatFile:
    """Write splats, and read them with an installed importer that recognises the file.

    Raises:
        NotApplicable: the exporter writes no splats or not these, or no importer reads its format.
    """
    exporter = _exporter(subject)
    if exporter.holds is not Holds.SPLATS:
        raise NotApplicable(f"no importer reads {exporter.holds.value}")
    if not exporter.is_readable:
        raise NotApplicable("its files do not hold whole splats")
    path = subject.workspace / f"again{exporter.suffix}"
    _write(exporter, path, content)
    for spec in subject.registry.slot("importer").values():
        importer = load("importer", spec)()
        if importer.recognises(path):
            read: SplatFile = importer.read(path)
            return read
    raise NotApplicable("no installed importer reads its format")


def _a_full_disk_leaves_the_old_file(subject: Subject) -> None:
    exporter = _exporter(subject)
    source = source_for(subject, exporter.holds)
    _stays_old(subject, lambda path: _write_on_a_full_disk(exporter, path, source), "a full disk")


def _refuses_what_is_not_finite(subject: Subject) -> None:
    exporter = _exporter(subject)
    if exporter.holds is not Holds.SPLATS:
        raise NotApplicable("gsfw checks its source")
    content = splat_file()
    opacities = content.splats.opacities.clone()
    opacities[3] = torch.nan
    broken = replace(content, splats=replace(content.splats, opacities=opacities))

    def write(path: Path) -> None:
        try:
            exporter.write(path, broken)
        except ValueError:
            raise
        require(
            False,
            "a splat whose opacity is NaN was written.",
            "Raise a ValueError that names the field and the row before you write.",
        )

    _stays_old(subject, write, "a splat that is not finite", ValueError)


def _stays_old(
    subject: Subject,
    write: Callable[[Path], None],
    cause: str,
    expected: type[Exception] = Exception,
) -> None:
    """Check that a write that fails leaves the old file, and nothing besides.

    Raises:
        NotApplicable: the format is a folder, which nothing replaces at once.
    """
    if subject.target.is_folder:
        raise NotApplicable(
            "a folder of files cannot be replaced at once; its index is written last"
        )
    folder = subject.workspace / "atomic"
    folder.mkdir(exist_ok=True)
    path = folder / f"old{subject.target.suffix}"
    path.write_bytes(OLD)
    try:
        write(path)
    except AssertionError:
        raise
    except expected:
        pass
    else:
        require(False, f"{cause} raised no error.", "Do not catch the error of the system.")
    kept = path.is_file() and path.read_bytes() == OLD
    left = sorted(item.name for item in folder.iterdir() if item != path)
    require(
        kept and not left,
        f"after {cause}, the old file is {'there' if kept else 'lost'}, and "
        f"{', '.join(left) or 'nothing'} is left beside it.",
        "Compute all bytes first, and write them with write_atomically(path, content) of gsfw.api.",
    )


def _write_on_a_full_disk(exporter: Exporter, path: Path, source: ExportSource) -> None:
    with _no_large_files():
        exporter.write(path, source)


@contextmanager
def _no_large_files() -> Iterator[None]:
    """Let no file of this process grow beyond a few bytes, as on a full disk.

    Raises:
        NotApplicable: this system has no such limit.
    """
    try:
        import resource
    except ImportError:
        raise NotApplicable("this system cannot limit the size of files") from None
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_DISK, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


PROMISES = (
    Promise(
        "writes-what-it-holds",
        "It writes a file from a source that has only the content named in holds.",
        _writes_what_it_holds,
    ),
    Promise("round-trips", "A written file, read again, renders the same image.", _round_trips),
    Promise(
        "writes-the-world", "Positions are in the world coordinates of the data.", _writes_the_world
    ),
    Promise(
        "full-disk-leaves-the-old-file",
        "A failed write keeps the old file, and leaves no other file.",
        _a_full_disk_leaves_the_old_file,
    ),
    Promise(
        "refuses-what-is-not-finite",
        "Splats with NaN are refused with a ValueError before the old file is touched.",
        _refuses_what_is_not_finite,
    ),
)
