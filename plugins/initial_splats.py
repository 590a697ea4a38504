"""Initial splats: files of splats, found by their content; and those that ``init=FILE`` names."""

from __future__ import annotations

from pathlib import Path

import torch

from gsfw.core.config import INIT_WORDS
from gsfw.core.errors import DataError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.files.reading import check_downloaded
from gsfw.core.maths.frame import transform_splats
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.words import shell_argument
from gsfw.plugins.loading import ask_all, load
from gsfw.plugins.registry import Registry, what_is_missing


def importer_of(path: Path, registry: Registry) -> str | None:
    """Name of the importer that recognises a file, or a folder, of splats; ``None`` if none does.

    Importers look at the content, and at the suffix where a format has no mark of its own.

    Raises:
        DataError: it is a pipe or a device, whose beginning can be read only once.
    """
    if not path.exists():
        return None
    if not (path.is_file() or path.is_dir()):
        raise DataError(
            f"{path} is a pipe or a device, and gsfw reads files more than once.",
            "Write its content to a file, and give that file.",
        )

    def recognises(kind: type[Importer]) -> bool:
        try:
            return kind.recognises(path)
        except IsADirectoryError:  # It knows files only.
            return False

    recognised = ask_all("importer", registry, recognises)
    return next((name for name, is_its_own in recognised.items() if is_its_own), None)


def find_importer(path: Path, registry: Registry) -> Importer:
    """The importer that recognises a file, or a folder, of splats.

    Raises:
        DataError: it is missing, or of no format that can be read.
    """
    if not path.exists():
        raise DataError(f"{path}: there is no such file.", what_is_missing(path))
    check_downloaded(path)
    name = importer_of(path, registry)
    if name is None:
        what = "contains no splats" if path.is_dir() else "is not a splat file"
        raise DataError(
            f"{path} {what} that can be read here.",
            f"Formats that can be read: {', '.join(registry.slot('importer')) or 'none'}.",
        )
    importer: Importer = load("importer", registry.find("importer", name))()
    return importer


def refuse_splats(path: Path, registry: Registry) -> None:
    """Refuse splats in place of a data set or of photos; anything else passes.

    Raises:
        DataError: an importer recognises the file or folder.
    """
    name = importer_of(path, registry)
    if name is not None:
        raise DataError(
            f"{path} has the format {name}, which holds splats, and no photos with cameras.",
            f"To look at them: gsfw view {shell_argument(path)}. To train on from them: "
            f"init={shell_argument(path)}, and data= for the photos.",
        )


def check_initial(init: str, registry: Registry) -> None:
    """Check that ``init`` is one of its words, or a file of splats that can be read.

    Raises:
        DataError: it is neither.
    """
    if init in INIT_WORDS:
        return
    if not Path(init).exists():
        raise DataError(
            f"{init}: there is no such file.", f"init is a splat file, or {', '.join(INIT_WORDS)}."
        )
    find_importer(Path(init), registry)


def read_initial(init: str, registry: Registry, scene: Scene) -> Splats | None:
    """The splats of ``init=FILE`` in the scene frame, float32; ``None`` for other values."""
    if init in INIT_WORDS:
        return None
    return in_scene(find_importer(Path(init), registry).read(Path(init)), scene)


def in_scene(content: SplatFile, scene: Scene) -> Splats:
    """The splats of a file in the scene frame, float32."""
    splats = transform_splats(content.splats, scene.world_from_scene.inverse())
    return splats.map(torch.Tensor.float)
