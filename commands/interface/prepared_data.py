"""Prepared data: settings to open a data set as training would, its check, its surface points."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.plugins.settings import Settings
    from gsfw.preparation.check.examination import Examination

DENSE_FILE = "dense.ply"
"""Surface points, in the folder of the data set."""


def data_settings(data: Path, *more: tuple[str, str]) -> Settings:
    """The settings of ``gsfw train data=...``, and further ones."""
    from gsfw.commands.interface.arguments import Arguments, layers
    from gsfw.plugins.registry import installed
    from gsfw.plugins.settings import resolve

    given = (("data", str(data)), ("method", "3dgs"), *more)
    return resolve(installed(), layers(Arguments((), given)))


def examine(data: Path) -> Examination:
    """Check the written data set."""
    from gsfw.plugins.opening import open_data
    from gsfw.preparation.check.examination import Examination

    settings = data_settings(data)
    with closing(open_data(settings)) as opened:
        return Examination.of(opened, settings.config)


def write_dense(console: Console, data: Path) -> None:
    """Write the surface points of the data set beside it, in its own world."""
    import torch

    from gsfw.commands.interface.progress import StageBars
    from gsfw.core.files.atomic import write_atomically
    from gsfw.core.progress import shown_by
    from gsfw.datamanagers.point_file import ply_of
    from gsfw.plugins.dense_points import dense_surface
    from gsfw.plugins.loading import choose_operators
    from gsfw.plugins.opening import open_data
    from gsfw.plugins.registry import installed

    operators = choose_operators(installed(), torch.device("cpu"))
    with shown_by(StageBars(console).stage), closing(open_data(data_settings(data))) as opened:
        found = dense_surface(opened, None, operators)
        world = opened.scene.world_from_scene
    if isinstance(found, str):
        console.say(f"note: no {DENSE_FILE}: {found}.")
        return
    write_atomically(data / DENSE_FILE, ply_of(world.apply(found.points), found.colors))
    console.say(f"{len(found):,} surface points: {data / DENSE_FILE}")
