"""Photos and other files that are given to ``gsfw prepare``."""

import itertools
from pathlib import Path

from PIL import Image

from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import Source

SERIAL = itertools.count()


def photo(path: Path, size: tuple[int, int] = (8, 6), content: str = "", **settings) -> Path:
    """An image unlike any other."""
    path.parent.mkdir(parents=True, exist_ok=True)
    number = next(SERIAL)
    shade = (37 * number % 256, 91 * number % 256, 11 * number % 256)
    Image.new("RGB", size, shade).save(path, content or None, **settings)
    return path


def photos(folder: Path, *names: str) -> Path:
    """Images of these names in a folder."""
    for name in names:
        photo(folder / name)
    return folder


def written(path: Path, content: bytes) -> Path:
    """A file with this content, in a folder that is made where there is none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def names(source: Source) -> list[str]:
    """Names of the images that are used."""
    return [image.name for image in source.images.images]


def only_left_out(source: Source) -> LeftOut:
    """The one file that is not used."""
    (item,) = source.images.left_out
    return item
