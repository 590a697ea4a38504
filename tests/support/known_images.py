"""Images of the built-in scene, which whole runs of one worker cast once.

Most of these runs train on the same few views, and casting these takes a fourth of their time.
"""

from typing import ClassVar

from gsfw.core.datamanager import Split
from gsfw.datamanagers.images import DecodedImage
from gsfw.datamanagers.synthetic.data import SyntheticData

LARGEST = 100 * 75
"""Pixels of an image that is kept."""
MOST = 5000
"""Images that are kept: 150 MB at most."""


class KnownImages:
    """Images by the settings of their scene, their size and their number."""

    are_used = False
    """Tests of parts, among them those of the scene, cast each image anew."""
    found: ClassVar[dict[tuple[str, int, int, int], DecodedImage]] = {}


_cast = SyntheticData._cast


def _known(data: SyntheticData, number: int) -> DecodedImage:
    """The image of a view, by its number, in place of ``SyntheticData._cast``."""
    views = [*data._world[Split.TRAIN], *data._world[Split.EVAL]]
    width, height = views[number].width, views[number].height
    if not KnownImages.are_used or width * height > LARGEST:
        return _cast(data, number)
    key = (repr(data._config), width, height, number)
    image = KnownImages.found.get(key) or _cast(data, number)
    if len(KnownImages.found) < MOST:
        KnownImages.found[key] = image
    return image


SyntheticData._cast = _known  # type: ignore[method-assign]
