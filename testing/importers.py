"""Promises of importers: any file ends in splats or in a DataError."""

from __future__ import annotations

import shutil
from pathlib import Path

import torch

from gsfw.core.errors import DataError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.testing.promise import Promise, require
from gsfw.testing.sources import readable_file
from gsfw.testing.subject import Subject

FLIPS = 40
"""Bytes that are changed, one at a time, evenly over a file, or over all files of a folder."""
ADVICE = "Check lengths and numbers in the file, and raise DataError with the cause and the place."


def _importer(subject: Subject) -> Importer:
    importer: Importer = subject.target()
    return importer


def _reads_splats(subject: Subject) -> None:
    path = readable_file(subject)
    require(
        subject.target.recognises(path) is True,
        f"recognises({path.name}) is not true.",
        "Compare the first bytes of the file with those of the format.",
    )
    _check_content(_importer(subject).read(path), path.name)


def _check_content(content: SplatFile, name: str) -> None:
    """Check the form of what an importer has read."""
    splats = content.splats
    tensors = {key: value for key, value in splats.tensors().items() if not value.isfinite().all()}
    require(not tensors, f"{name}: {', '.join(tensors)} is not finite.", ADVICE)
    require(
        splats.quats is not None and splats.scales is not None,
        f"{name}: the splats have covariances.",
        "Give quaternions and scales.",
    )
    in_range = bool(((splats.opacities >= 0) & (splats.opacities <= 1)).all())
    require(in_range, f"{name}: an opacity is outside [0, 1].", "Return activated opacities.")
    require(
        splats.means.dtype == torch.float64,
        f"{name}: the splats are {splats.means.dtype}.",
        "Return float64: the transform to the scene frame then loses no precision.",
    )


def _damaged_files_are_refused(subject: Subject) -> None:
    copy = _copied(subject, "damaged")
    for file in _files_of(copy):
        whole = file.read_bytes()
        for length in (0, 1, len(whole) // 2 | 1, len(whole) - 1):
            file.write_bytes(whole[:length])
            told = _read(subject, copy)
            # A format without a length cannot tell that its last rows are gone, and not every file
            # of a folder is read.
            is_less = isinstance(told, SplatFile) and (length > 1 or copy.is_dir())
            require(
                isinstance(told, DataError) or is_less,
                f"{length} of {len(whole)} bytes of {file.name} give {_words(told)}.",
                ADVICE,
            )
        file.write_bytes(whole)


def _changed_bytes_end_in_words(subject: Subject) -> None:
    copy = _copied(subject, "changed")
    files = _files_of(copy)
    for file in files:
        whole = file.read_bytes()
        for place in range(0, len(whole), max(len(whole) * len(files) // FLIPS, 1)):
            content = bytearray(whole)
            content[place] ^= 0xFF
            file.write_bytes(content)
            told = _read(subject, copy)
            require(
                isinstance(told, SplatFile | DataError),
                f"with another byte {place} of {file.name}, reading gives {_words(told)}.",
                ADVICE,
            )
        file.write_bytes(whole)


def _copied(subject: Subject, name: str) -> Path:
    """A copy of the readable file or folder, to be damaged."""
    source = readable_file(subject)
    copy = subject.workspace / f"{name}{source.suffix}"
    if source.is_dir():
        shutil.copytree(source, copy)
    else:
        shutil.copyfile(source, copy)
    return copy


def _files_of(path: Path) -> list[Path]:
    """A file itself, or all files of a folder."""
    return sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]


def _read(subject: Subject, path: Path) -> object:
    """The result or the error of reading a file."""
    try:
        return _importer(subject).read(path)
    except Exception as error:
        return error


def _words(ending: object) -> str:
    if isinstance(ending, Exception):
        return f"{type(ending).__name__}: {ending}"
    return f"{type(ending).__name__}"


def _recognises_never_raises(subject: Subject) -> None:
    folder = subject.workspace
    empty, noise = folder / "empty", folder / "noise"
    empty.write_bytes(b"")
    noise.write_bytes(bytes(range(256)))
    for path in (empty, noise, folder, folder / "missing"):
        try:
            found: object = subject.target.recognises(path)
        except Exception as error:
            found = error
        require(
            found is False,
            f"recognises({path.name}) gives {found!r} for a file of another format.",
            "Read the first bytes, and return false for anything else, also if the file is a "
            "folder, is empty or cannot be opened.",
        )


PROMISES = (
    Promise("reads-splats", "A valid file gives finite, activated splats.", _reads_splats),
    Promise(
        "damaged-files-are-refused",
        "A truncated file is refused with a DataError, or read up to its end.",
        _damaged_files_are_refused,
    ),
    Promise(
        "changed-bytes-end-in-words",
        "A file with a wrong byte gives splats or a DataError, and no other error.",
        _changed_bytes_end_in_words,
    ),
    Promise(
        "recognises-never-raises",
        "recognises is false for other files, and never raises.",
        _recognises_never_raises,
    ),
)
