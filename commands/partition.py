"""`gsfw partition`: cuts a data set into blocks that are trained one after another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import FLAGS, Options, parse, positional, read_options
from gsfw.commands.interface.progress import loading_torch
from gsfw.core.errors import ConfigError, OutputError
from gsfw.core.ranges import number
from gsfw.core.words import shell_argument, size

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.datamanagers.capture import Capture
    from gsfw.partition.document import Block
    from gsfw.partition.plan import Plan, Wishes
    from gsfw.plugins.settings import Settings

OWN = ("out", "blocks", "memory", "margin", "share", *FLAGS)
"""Keys of this verb; all others are those of ``gsfw train``, for the reading of the data."""
PICTURE = "partition.png"


@dataclass(kw_only=True)
class PartitionOptions(Options):
    """Cut a data set that is too large for one training into blocks, without copying images.

    Besides the keys below it takes those of gsfw train that concern data: datamanager.masks,
    downscale, holdout_every, ... Next: gsfw blocks DIR.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw partition path/to/city out=city memory=16GB",
        "gsfw partition path/to/city out=city blocks=3x2",
    )

    what: str = positional("DATA")
    """The data set."""
    out: str = ""
    """A new folder for partition.json, a picture of it, and later the trained blocks."""
    blocks: str = "auto"
    """auto (as many as memory asks for), a number, or AxB along the two axes of the ground."""
    memory: str = "8GB"
    """Memory limit for the training of one block."""
    margin: float = number(0.15, at_least=0, at_most=2)
    """Width of the border around a cell that is also trained, relative to its shorter side."""
    share: float = number(0.15, above=0, at_most=1)
    """A view trains a block if this part of the points that it sees lies in the block's cell, or if
    its camera stands there and sees any of them."""


def run(tokens: list[str]) -> int:
    """Cut a data set, and print the blocks."""
    options, given = read(tokens)
    wishes = _wishes(options)
    with loading_torch(" and reading settings"):
        settings = _settings(options, given)

    from gsfw.commands.interface.console import Console

    console = Console(options.json)
    data = _open(settings)
    try:
        from gsfw.partition.plan import make_plan

        plan = make_plan(data, wishes, settings.config.cache_mb)
        path = _write(Path(options.out), settings, data, plan)
    finally:
        data.close()
    _tell(console, plan, wishes, path)
    return 0


def read(tokens: list[str]) -> tuple[PartitionOptions, dict[str, str]]:
    """The options of this verb, and the settings of the data."""
    arguments = parse(tokens)
    own = [f"{key}={text}" for key, text in arguments.pairs if key in OWN]
    options = read_options("partition", PartitionOptions, [*own, *arguments.words])
    return options, {key: text for key, text in arguments.pairs if key not in OWN}


def _wishes(options: PartitionOptions) -> Wishes:
    """The wishes of the user.

    Raises:
        ConfigError: no folder is given, or a size is none.
        OutputError: the folder exists.
    """
    from gsfw.partition.costs import megabytes
    from gsfw.partition.plan import Wishes

    if not options.out:
        raise ConfigError("gsfw partition: out is missing.", "Write out=DIR, a new folder.")
    folder = Path(options.out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(
            f"out={options.out}: it exists and is not empty.", "Choose a new folder with out=DIR."
        )
    return Wishes(options.blocks, megabytes(options.memory), options.margin, options.share)


def _settings(options: PartitionOptions, given: dict[str, str]) -> Settings:
    from gsfw.plugins.registry import installed
    from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

    values = {"method": "3dgs", **given, "data": options.what}
    settings = resolve(installed(), [Layer(COMMAND_LINE, values)])
    settings.config.check()
    return settings


def _open(settings: Settings) -> Capture:
    """Open the data set.

    Raises:
        ConfigError: its format has no frames to choose among.
        DataError: it cannot be used.
    """
    from gsfw.datamanagers.capture import Capture
    from gsfw.partition.block_data import check_source
    from gsfw.plugins.opening import open_data

    check_source(settings.config.datamanager, settings.choices["datamanager"].name)
    data = open_data(settings)
    assert isinstance(data, Capture)
    return data


def _write(folder: Path, settings: Settings, data: Capture, plan: Plan) -> Path:
    """Write partition.json and its picture; the path of the first."""
    from gsfw.charts.ground_plan import GroundPlan, PlanCell, write_ground_plan
    from gsfw.core.files.atomic import readable_write_errors
    from gsfw.partition.block_data import changed_settings, check_source
    from gsfw.partition.document import Partition, write_partition

    name = settings.choices["datamanager"].name
    partition = Partition(
        data=Path(settings.config.data),
        datamanager=name,
        settings=changed_settings(check_source(settings.config.datamanager, name)),
        ground=plan.ground,
        held_out=plan.held_out,
        held_out_by=plan.held_out_by,
        blocks=plan.blocks,
    )
    with readable_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    path = write_partition(folder, partition)
    cells = [
        PlanCell(item.name, item.cell.low, item.cell.high, item.margin) for item in plan.blocks
    ]
    title = f"{data.recording.name}: {len(cells)} blocks"
    write_ground_plan(folder / PICTURE, GroundPlan(title, cells, plan.points, plan.cameras))
    return path


def _tell(console: Console, plan: Plan, wishes: Wishes, path: Path) -> None:
    """Print the blocks, and what does not fit."""
    rows = [
        [
            *(block.name, str(len(block.train)), str(len(block.evaluation))),
            *(f"{block.points:,}", f"{block.gaussians:,}", size(1e6 * block.memory_mb)),
        ]
        for block in plan.blocks
    ]
    heads = ["block", "views", "held out", "points", "Gaussians (about)", "memory (about)"]
    console.table(heads, rows)
    how = "the tracks of the reconstruction" if plan.by_tracks else "projected points"
    console.say(f"visibility of points follows from {how}")
    whole = plan.whole
    if whole.memory_mb > wishes.memory_mb:
        console.say(
            f"In one piece the scene would need about {size(1e6 * whole.memory_mb)} for "
            f"{whole.gaussians:,} Gaussians, more than memory={size(1e6 * wishes.memory_mb)}."
        )
    else:
        console.say(
            f"In one piece the scene would need about {size(1e6 * whole.memory_mb)}, which fits "
            f"into memory={size(1e6 * wishes.memory_mb)}: gsfw train would do."
        )
    large = [block for block in plan.blocks if block.memory_mb > wishes.memory_mb]
    for block in large:
        console.warn(
            f"block {block.name} needs about {size(1e6 * block.memory_mb)}, more than "
            f"memory={size(1e6 * wishes.memory_mb)}. Give more blocks, or downscale=2."
        )
    console.say(f"written: {path}, {PICTURE}\nNext: gsfw blocks {shell_argument(path.parent)}")
    console.result(
        {
            "partition": str(path),
            "whole": {"gaussians": whole.gaussians, "memory_mb": whole.memory_mb},
            "by_tracks": plan.by_tracks,
            "too_large": [block.name for block in large],
            "blocks": [_block_document(block) for block in plan.blocks],
        }
    )


def _block_document(block: Block) -> dict[str, Any]:
    """Plain data of a block for programs."""
    return {
        "name": block.name,
        "views": len(block.train),
        "held_out": len(block.evaluation),
        "points": block.points,
        "gaussians": block.gaussians,
        "memory_mb": block.memory_mb,
    }
