"""Input files: the files that the inputs of a preparation mean, and what each is called."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from gsfw.core.errors import DataError
from gsfw.core.files.prepared_folder import is_begun
from gsfw.core.files.reading import followed
from gsfw.core.words import suggestion
from gsfw.datamanagers.camera_sequence import in_order
from gsfw.datamanagers.detection import PHOTOS, VIDEOS
from gsfw.datamanagers.frames import name_key
from gsfw.datamanagers.masks import FOLDER as MASKS
from gsfw.datamanagers.video import is_video

IMAGE_FOLDERS = ("input", "images")
"""Folders of images in data sets. If both exist, ``images`` was made from ``input``."""

NOISE = ("__macosx", "@eadir", "thumbs.db", "desktop.ini")
"""Lower-case names that operating systems and network drives leave behind."""

THUMBNAIL = ".thm"
"""Extension of the small JPEG that cameras write beside a video."""

LONGEST = 200
"""Bytes of a name; disks take 255, and some of what is written has a little more to its name."""

UNSEEN = ("Cc", "Zl", "Zp")
"""Categories of Unicode that are not written in a line: controls, and ends of lines."""


@dataclass(frozen=True)
class InputFile:
    """A file that an input means."""

    path: Path
    name: str
    """Relative to its input, with forward slashes; before it, of several, the input's name."""
    asked: bool = False
    """True if the user named the file itself, and not a folder."""


@dataclass
class InputFiles:
    """All files of all inputs, sorted by name in the order of the numbers in it."""

    files: list[InputFile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """Files and folders that were skipped unread."""

    @staticmethod
    def find(paths: Sequence[Path], apart: Sequence[Path] = ()) -> InputFiles:
        """Go through all inputs.

        Args:
            paths: folders, images and videos.
            apart: results and masks; not looked at, should they lie in one of the folders.

        Raises:
            DataError: one of the paths is not there, or cannot be read.
        """
        found = InputFiles()
        folders, asked = _sort_inputs(paths)
        seen = {followed(path) for path in apart}
        batches = {root: found._files_in(root, seen) for root in folders}
        known = {followed(file.path) for batch in batches.values() for file in batch}
        for path in asked:
            if followed(path) not in known:
                file = InputFile(path, writable(path.name), asked=True)
                batches.setdefault(path.parent, []).append(file)
        prefixes = _prefixes([root for root, batch in batches.items() if _needs_name(batch)])
        for root, batch in batches.items():
            prefix = prefixes.get(root, "")
            found.files += [replace(file, name=prefix + file.name) for file in batch]
        found.files.sort(key=lambda file: name_order(file.name))
        return found

    def _files_in(self, root: Path, seen: set[Path]) -> list[InputFile]:
        start = self._start(root, seen)
        if followed(start) in seen:
            return []
        return [
            InputFile(path, writable(path.relative_to(start).as_posix()))
            for path in self._below(start, seen)
        ]

    def _start(self, root: Path, seen: set[Path]) -> Path:
        """The folder itself, or the one in it that holds a data set's images."""
        items = _listed(root)
        if is_begun(root) and root / "images" in items:
            # The contact sheet lies beside them.
            self.notes.append(f"{root}: only images/ is used, as it is a result of gsfw prepare")
            return root / "images"
        if any(_is_footage(item) and followed(item) not in seen for item in items):
            return root
        folders = [item for item in items if followed(item) not in seen and _holds_footage(item)]
        for name in IMAGE_FOLDERS:
            start = root / name
            if start in folders:
                others = [item.name for item in folders if item != start]
                if others:
                    self.notes.append(
                        f"{root}: only {name}/ is used; name the folders beside it as inputs of "
                        f"their own if they hold other photos ({', '.join(others)})"
                    )
                return start
        return root

    def _below(self, folder: Path, seen: set[Path]) -> Iterator[Path]:
        """Files in a folder and all folders in it; each folder once, whatever links there are."""
        seen.add(followed(folder))
        for item in _listed(folder):
            if _is_noise(item.name):
                continue
            if followed(item) in seen:
                continue
            if not item.is_dir():
                # A link to nowhere is told of later; pipes and devices would block whoever reads.
                if item.is_file() or not item.exists():
                    yield item
            elif is_begun(item):
                self.notes.append(f"{item} is not used: it is a result of gsfw prepare")
            elif item.name.lower() == MASKS:
                self.notes.append(
                    f"{item} is not searched for photos, because its name is masks; only masks of "
                    "panoramas are used"
                )
            else:
                yield from self._below(item, seen)


def name_order(name: str) -> tuple[object, ...]:
    """Sorts img_2 before img_10, and so the folders."""
    return tuple(in_order(Path(part)) for part in name.split("/"))


def shot(name: str) -> tuple[str, str]:
    """Equal for names that differ by extension only, as the files of one shot do."""
    path = PurePosixPath(name)
    return path.parent.as_posix(), path.stem.casefold()


def _sort_inputs(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Folders and files, each once."""
    folders: dict[Path, Path] = {}
    files: dict[Path, Path] = {}
    for path in paths:
        if not path.exists():
            raise DataError(f"{path}: there is no such file or folder.", _nearest(path))
        (folders if path.is_dir() else files).setdefault(followed(path), path)
    return list(folders.values()), list(files.values())


def _nearest(path: Path) -> str:
    parent = path.parent
    names = [item.name for item in parent.iterdir()] if parent.is_dir() else []
    return suggestion(path.name, names).strip() or "Give a folder of photos, or a video."


def _prefixes(roots: Sequence[Path]) -> dict[Path, str]:
    """Prefixes that keep images of several inputs apart: "name/", or "name_2/" the second time."""
    prefixes: dict[Path, str] = {}
    if len(roots) < 2:
        return prefixes
    for root in roots:
        whole = root.resolve()
        name = (whole.parent if whole.name.lower() in IMAGE_FOLDERS else whole).name or "input"
        name = writable(name)
        choice, number = f"{name}/", 1
        while name_key(choice) in {name_key(prefix) for prefix in prefixes.values()}:
            number += 1
            choice = f"{name}_{number}/"
        prefixes[root] = choice
    return prefixes


def _needs_name(files: Sequence[InputFile]) -> bool:
    """True if images may be among them: the frames of a video get a folder of their own."""
    return not all(file.asked and is_video(file.path) for file in files)


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise DataError(
            f"{folder}: the folder cannot be read ({error.strerror}).",
            "Make it readable, or take it out of the input.",
        ) from error


def _is_footage(path: Path) -> bool:
    """True if its name says that it is an image or a video."""
    return path.suffix.lower() in (*PHOTOS, *VIDEOS) and not _is_noise(path.name)


def _holds_footage(path: Path) -> bool:
    """True if it is a folder with images or videos that are neither masks nor results."""
    if not path.is_dir() or _is_noise(path.name) or path.name.lower() == MASKS:
        return False
    if is_begun(path):
        return False
    return any(_is_footage(item) for item in path.rglob("*"))


def _is_noise(name: str) -> bool:
    lower = name.lower()
    return lower.startswith(".") or lower in NOISE or lower.endswith(THUMBNAIL)


def writable(name: str) -> str:
    """Remove control characters such as line ends, bytes that are no text, and excess length.

    Some file systems allow them in names; tables and lists of names do not.
    """
    text = name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    text = "".join("_" if unicodedata.category(one) in UNSEEN else one for one in text)
    return "/".join(map(_shortened, text.split("/")))


def _shortened(part: str) -> str:
    """A name without the end of its stem, where it is too long."""
    if len(part.encode()) <= LONGEST:
        return part
    suffix = PurePosixPath(part).suffix if part[-6:].count(".") else ""
    stem = part.encode()[: LONGEST - len(suffix.encode())]
    return stem.decode("utf-8", "ignore") + suffix
