"""Initial splats: those of a splat file, which ``init=FILE`` names."""

from __future__ import annotations

from pathlib import Path

import torch

from gsfw.core.config import INIT_WORDS
from gsfw.core.errors import DataError
from gsfw.core.exchange import Importer
from gsfw.core.maths.frame import transform_splats
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.plugins.loading import ask_all, load
from gsfw.plugins.registry import Registry
from gsfw.plugins.unread_splats import refuse_unread_splats


def find_importer(path: Path, registry: Registry) -> Importer:
    """The importer that recognises a splat file.

    Raises:
        DataError: the file is missing, of a known format that cannot be read, or of none.
    """
    if not path.is_file():
        raise DataError(
            f"{path}: there is no such file.", f"init is a splat file, or {', '.join(INIT_WORDS)}."
        )
    refuse_unread_splats(path)
    recognised = ask_all("importer", registry, lambda kind: kind.recognises(path))
    for name, is_its_own in recognised.items():
        if is_its_own:
            importer: Importer = load("importer", registry.find("importer", name))()
            return importer
    raise DataError(
        f"{path} is not a splat file that can be read here.",
        f"Formats that can be read: {', '.join(recognised) or 'none'}.",
    )


def read_initial(init: str, registry: Registry, scene: Scene) -> Splats | None:
    """The splats of ``init=FILE`` in the scene frame, float32; ``None`` for other values."""
    if init in INIT_WORDS:
        return None
    content = find_importer(Path(init), registry).read(Path(init))
    splats = transform_splats(content.splats, scene.world_from_scene.inverse())
    return splats.map(torch.Tensor.float)
