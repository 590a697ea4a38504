"""Pictures: the images of a page, and their files in the run's own folder.

The files outlive the data set: a run that was copied to another machine still has its pictures.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from PIL import Image

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.core.loop.run_folder import RunFolder

SCHEMA = 1
"""Version of the layout of ``report/pictures.json``."""

FOLDER, INDEX = "report", "pictures.json"

LARGEST = 500_000
"""Bytes of a stored picture above which it is not one of ours; an orbit has at most so many."""


@dataclass(frozen=True)
class ViewPicture:
    """One view, as WebP files."""

    name: str
    label: str
    """The reason for its choice: "worst", "median", "best"; empty if all views are shown."""
    psnr: float
    """PSNR of the drawn image at its full size, in dB; NaN if it is not known."""
    target: bytes
    rendered: bytes
    error: bytes
    own: Mapping[str, bytes] = field(default_factory=dict)
    """The method's own images (``Method.view_images``), by name."""


@dataclass(frozen=True)
class Pictures:
    """The images of a run."""

    step: int
    """Number of steps of the drawn model."""
    split: str
    """Split of the views: "eval", or "train" if none is held out."""
    error: str
    """Meaning of the error images, with its scale, as a phrase."""
    views: tuple[ViewPicture, ...]
    """From the worst to the best."""
    still: bytes = b""
    """One view as rendered, larger; empty if there is none."""
    still_name: str = ""
    orbit: bytes = b""
    """A film around the scene; empty if there is none."""
    is_moving: bool = False
    """True if time passes in the film."""
    is_still_median: bool = False
    """True if errors of all views were known when ``still`` was chosen among them."""


def stored_pictures(folder: RunFolder) -> Pictures | None:
    """The pictures of an earlier report of the run; ``None`` if there are none.

    Raises:
        DataError: they are damaged.
    """
    home = folder.path / FOLDER
    if not (home / INDEX).is_file():
        return None
    advice = f"Remove {home}, and draw them again with gsfw report."
    document = read_document(home / INDEX, SCHEMA, advice)
    try:
        views = tuple(_read_view(home, item) for item in document["views"])
        return Pictures(
            step=int(document["step"]),
            split=str(document["split"]),
            error=str(document["error"]),
            views=views,
            still=_read(home / "still.webp") if document["still"] else b"",
            still_name=str(document["still_name"]),
            is_still_median=bool(document.get("is_still_median")),
            orbit=_read(home / "orbit.webp") if document["orbit"] else b"",
            is_moving=bool(document["is_moving"]),
        )
    except (KeyError, TypeError, ValueError, OverflowError, OSError) as error:
        problem = " ".join(str(error).split())
        raise DataError(f"{home} cannot be read: {problem}.", advice) from error


def store_pictures(folder: RunFolder, pictures: Pictures) -> None:
    """Write the pictures into the run's folder, the list of them last.

    Raises:
        OutputError: they cannot be written.
    """
    home = folder.path / FOLDER
    with readable_write_errors(home):
        (home / INDEX).unlink(missing_ok=True)  # It would name the new images as the old ones.
    for place, view in enumerate(pictures.views):
        for kind in ("target", "rendered", "error"):
            write_atomically(home / f"{place:02d}_{kind}.webp", getattr(view, kind))
        for number, content in enumerate(view.own.values()):
            write_atomically(_own_file(home, place, number), content)
    for name in ("still", "orbit"):
        if content := getattr(pictures, name):
            write_atomically(home / f"{name}.webp", content)
    empty = replace(pictures, views=())
    document = {**asdict(empty), "still": bool(pictures.still), "orbit": bool(pictures.orbit)}
    views = [
        {"name": v.name, "label": v.label, "psnr": v.psnr, "own": [*v.own]} for v in pictures.views
    ]
    document |= {"schema": SCHEMA, "views": [{**v, "file": i} for i, v in enumerate(views)]}
    write_atomically(home / INDEX, (json_text(document, indent=1) + "\n").encode())


def _read_view(home: Path, item: Mapping[str, Any]) -> ViewPicture:
    place = int(item["file"])
    psnr = math.nan if item["psnr"] is None else float(item["psnr"])
    target, rendered, error = (
        _read(home / f"{place:02d}_{kind}.webp") for kind in ("target", "rendered", "error")
    )
    own = {
        str(name): _read(_own_file(home, place, number))
        for number, name in enumerate(item.get("own", ()))  # Earlier files have none.
    }
    return ViewPicture(str(item["name"]), str(item["label"]), psnr, target, rendered, error, own)


def _own_file(home: Path, place: int, number: int) -> Path:
    """File of an image of the method, whose name may be no name of a file."""
    return home / f"{place:02d}_own_{number}.webp"


def _read(path: Path) -> bytes:
    """A WebP file.

    Raises:
        ValueError: it is another file.
    """
    content = path.read_bytes()
    if content[:4] != b"RIFF" or content[8:12] != b"WEBP" or len(content) > LARGEST:
        raise ValueError(f"{path.name} is no WebP image of at most {LARGEST} bytes")
    try:
        with Image.open(io.BytesIO(content)):  # Refuses a file that is cut short.
            return content
    except Image.DecompressionBombError as error:
        raise ValueError(f"{path.name}: {error}") from error
