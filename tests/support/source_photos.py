"""Photos and other files that a source is read from, each unlike any other."""

import itertools
from pathlib import Path

import numpy as np
from PIL import Image

from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import Source

SERIAL = itertools.count()
RED, GREEN = (200, 60, 40), (30, 180, 60)
HEIC_ADVICE = (
    "Install their decoder, and the same command uses them: pip install 'gsfw[heic]'. Or convert "
    "them to JPEG. macOS: sips -s format jpeg *.HEIC --out FOLDER. Linux: heif-convert -q "
    "95 IN.HEIC OUT.jpg for each (in Debian's libheif-examples). Windows: open and save them in "
    "Photos. An iPhone takes JPEG with Settings > Camera > Formats > Most Compatible."
)
"""What people with an iPhone are told."""


def photo(path: Path, size: tuple[int, int] = (8, 6), content: str = "", **settings) -> Path:
    """An image unlike any other."""
    path.parent.mkdir(parents=True, exist_ok=True)
    number = next(SERIAL)
    shade = (37 * number % 256, 91 * number % 256, 11 * number % 256)
    Image.new("RGB", size, shade).save(path, content or None, **settings)
    return path


def red_and_green() -> np.ndarray:
    """An image that is red on the left and green on the right, whose colours codecs keep inside."""
    image = np.empty((48, 64, 3), np.uint8)
    image[:, :32], image[:, 32:] = RED, GREEN
    return image


def photos(folder: Path, *names: str) -> Path:
    for name in names:
        photo(folder / name)
    return folder


def written(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def names(source: Source) -> list[str]:
    return [image.name for image in source.images.images]


def only_left_out(source: Source) -> LeftOut:
    (item,) = source.images.left_out
    return item
