"""Advice on a path that is no data set: images without cameras, a video, a parent folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from zipfile import is_zipfile

from gsfw.core.words import shell_argument
from gsfw.datamanagers.images import EXTENSIONS

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
"""Extensions of video files."""
HEIC_EXTENSIONS = (".heic", ".heif", ".hif")
"""Extensions of photos that only ``gsfw prepare`` reads."""
PHOTOS = (*EXTENSIONS, *HEIC_EXTENSIONS, ".avif")
"""Extensions of all photos."""


def describe_unrecognised(path: Path) -> str:
    """Describe the contents of a path that is no data set, with the remedy; else empty."""
    if path.suffix.lower() in VIDEOS:
        return _video(path)
    if path.suffix.lower() == ".r3d" and is_zipfile(path):
        return f"a recording of Record3D: unzip {shell_argument(path)} -d DIR, and give that folder"
    if not path.is_dir():
        return ""
    for folder in (path, path / "images", path / "input"):
        files = _files(folder)
        images = [item for item in files if item.suffix.lower() in PHOTOS]
        if images:
            where = "" if folder == path else f" in {folder.name}/"
            count = f"{len(images)} image{'s' * (len(images) != 1)}"
            return f"{count}{where}, but no cameras; {_reconstruct(folder)}"
        videos = [item for item in files if item.suffix.lower() in VIDEOS]
        if videos:
            return _video(videos[0])
    inner = [f"{item.name}/" for item in sorted(path.iterdir()) if _is_data_set(item)]
    return f"data sets in {', '.join(inner)}; give one of these folders" if inner else ""


def _is_data_set(path: Path) -> bool:
    signs = (
        *("sparse", "transforms.json", "transforms_train.json"),
        *("poses_bounds.npy", "dataset.json", "train_meta.json", "colmap_0"),
        *("keyframes", "reconstruction.json", "sfm_data.json"),
    )
    is_record3d = (path / "metadata.json").exists() and (path / "rgb").exists()
    return is_record3d or any((path / sign).exists() for sign in signs)


def _files(folder: Path) -> list[Path]:
    items: Iterable[Path] = folder.iterdir() if folder.is_dir() else ()
    return sorted(item for item in items if item.is_file())


def _video(path: Path) -> str:
    return f"the video {path.name}, but no cameras; {_reconstruct(path)}"


def _reconstruct(path: Path) -> str:
    return f"compute them with gsfw prepare {shell_argument(path)} out=DIR, and give that folder"
