"""Small images: one decoded image at a time, at the size that it is looked at."""

from __future__ import annotations

import torch

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.area import shrink_batch
from gsfw.core.loop.memory import release_freed_memory
from gsfw.datamanagers.capture import Capture


def load_small(data: DataManager, split: Split, index: int, width: int, height: int) -> Batch:
    """A view at most at its own size; large files are not decoded at theirs, and not kept.

    Args:
        data: where it comes from.
        split: of the view.
        index: of the view in its split.
        width: in pixels, at most the view's.
        height: likewise.

    Raises:
        DataError: it does not decode.
    """
    camera = data.views(split).cameras[index]
    if isinstance(data, Capture) and (width, height) != (camera.width, camera.height):
        # Else 12 MB stay for each large image, between the few kilobytes that are kept of it.
        release_freed_memory()
        return data.load_small(split, index, width, height)
    (batch,) = data.load(split, [index], torch.device("cpu"))
    return shrink_batch(batch, width, height)


def size_at_most(width: int, height: int, longest: int) -> tuple[int, int]:
    """Width and height, both divided so that neither exceeds ``longest``."""
    factor = max(1.0, max(width, height) / longest)
    return max(1, round(width / factor)), max(1, round(height / factor))
