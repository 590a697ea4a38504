"""Written files: which there are of an earlier run, so that none of them stays beside new ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath

from gsfw.core.errors import DataError, OutputError
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.colmap.reader import read_model
from gsfw.datamanagers.transforms_writer import FILE
from gsfw.preparation.writing.camera_plan import CameraPlan, lens_words

LIST = "work/written.txt"
"""Names of written files, relative to the data set."""
IMAGES, MASKS = "images", "masks"
COLMAP, TRANSFORMS = "colmap", "transforms"
"""Layouts of data sets."""
MODEL_FOLDER = "sparse/0"
PARTS = ("rigs.bin", "frames.bin", "images.bin", "points3D.bin", "cameras.bin")
"""Files of a model; the last is the one that readers look for. The first two came with COLMAP 4."""


def start_over(out: Path, names: Sequence[str]) -> None:
    """Remove the model and the files that an earlier run wrote, and note those of this one.

    Args:
        out: the data set.
        names: of files that will be written, relative to it.

    Raises:
        OutputError: they cannot be removed, or the list cannot be written.
    """
    file = out / LIST
    with readable_write_errors(out):
        remove_model(out)
        for path in filter(is_file, _listed(out)):
            path.unlink()
    write_atomically(file, "".join(f"{name}\n" for name in names).encode())


def remove_model(out: Path) -> None:
    """Remove the COLMAP model, its cameras first, and its folders where nothing else is in them."""
    folder = out / MODEL_FOLDER
    for part in reversed(PARTS):
        (folder / part).unlink(missing_ok=True)
    for empty in (folder, folder.parent):
        with suppress(OSError):
            empty.rmdir()


def is_all_there(out: Path) -> bool:
    """True if the cameras and all files that the last run wrote are still there."""
    listed = _listed(out)
    model = [out / MODEL_FOLDER / part for part in PARTS[2:]]
    cameras = [] if out / FILE in listed else model
    return bool(listed) and all(is_file(path) for path in (*listed, *cameras))


def _listed(out: Path) -> list[Path]:
    """The files of the list; none that is not inside the data set, whatever the list says."""
    file, root = out / LIST, out.resolve()
    if not file.is_file():
        return []
    names = file.read_text("utf-8", errors="replace").splitlines()
    paths = [out / name for name in names if "\0" not in name and PurePath(name).name]
    return [path for path in paths if (path.parent.resolve() / path.name).is_relative_to(root)]


def check_sources_stay(sources: Sequence[Path], targets: Sequence[Path]) -> None:
    """Check that no image that is read would be written over.

    Raises:
        OutputError: one would; it is named.
    """
    read = {source.parent.resolve() / source.name: source for source in sources}
    for target in targets:
        place = target.parent.resolve() / target.name
        if place in read:
            raise OutputError(
                f"{read[place]} is one of the images that are read, and would be written over.",
                "Choose another place with out=DIR.",
            )


def place_model(write: Callable[[Path], object], images: int, points: int, out: Path) -> int:
    """Write a model below ``out``, its cameras last: where they are, all of it is.

    Args:
        write: writes the files of a binary model into a folder.
        images: how many the model has.
        points: likewise.
        out: the data set.

    Returns:
        Bytes written.

    Raises:
        OutputError: it cannot be written.
    """
    folder, making = out / MODEL_FOLDER, out / "sparse/.part"
    with readable_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        making.mkdir(exist_ok=True)
        write(making)
        _check_written(making, images, points)
        written = [part for part in PARTS if (making / part).is_file()]
        size = sum((making / part).stat().st_size for part in written)
        for part in written:
            (making / part).replace(folder / part)
        making.rmdir()
    return size


def _check_written(folder: Path, images: int, points: int) -> None:
    """COLMAP does not say when a disk is full, so read what it wrote.

    Raises:
        OutputError: it is not all there.
    """
    try:
        found = read_model(folder)
        is_whole = (len(found.images), len(found.points)) == (images, points)
    except DataError:
        is_whole = False
    if not is_whole:
        raise OutputError(
            f"the model could not be written to {folder}: what is there ends too early.",
            "The disk is probably full: free some space, or choose another place with out=DIR.",
        )


@dataclass(frozen=True)
class WrittenDataSet:
    """The written data set."""

    layout: str
    """colmap or transforms."""
    images: int
    masks: int
    points: int
    sizes: tuple[tuple[int, int], ...]
    """Width and height of the written images, the most frequent first."""
    lens: str
    """Description of the output lenses."""
    bytes: int
    """Total size of all files that training reads."""
    notes: tuple[str, ...]
    """Notes for the user, such as content that the layout cannot hold."""

    @staticmethod
    def of(
        layout: str,
        plans: Sequence[CameraPlan],
        masks: int,
        points: int,
        size: int,
        notes: Iterable[str],
    ) -> WrittenDataSet:
        """Count it up.

        Args:
            layout: colmap or transforms.
            plans: of every image.
            masks: how many there are.
            points: likewise.
            size: bytes of all files that training reads.
            notes: sentences.
        """
        sizes = Counter((plan.target.width, plan.target.height) for plan in plans)
        return WrittenDataSet(
            layout=layout,
            images=len(plans),
            masks=masks,
            points=points,
            sizes=tuple(found for found, _ in sizes.most_common()),
            lens=lens_words(plans),
            bytes=size,
            notes=tuple(notes),
        )
