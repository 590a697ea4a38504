"""Training: the coarse model, a start for each block, the blocks, each a run in its own process.

Turki et al., Mega-NeRF (CVPR 2022), train the parts of a scene in the same way: without any word
between them, so that they run one after another, at the same time, or on several machines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from gsfw.core.errors import ConfigError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.progress import stage
from gsfw.datamanagers.capture import Capture
from gsfw.jobs.job import Job, Resources
from gsfw.partition.block_data import rows_of
from gsfw.partition.document import FILE, Block, Partition
from gsfw.partition.merging import run_splats
from gsfw.partition.starts import write_start
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import restore
from gsfw.plugins.settings import COMMAND_LINE, PLANNED_BY, Layer, resolve

SETTINGS, COARSE, STARTS, RUNS = "training.json", "coarse", "starts", "blocks"
"""Names in the folder of a partition."""
SCHEMA = 1
FREE = ("device", "data", "cache_mb", "gpu_cache_mb", "check_memory")
"""Settings that may differ from those of blocks that are trained."""
GROWTH = ("strategy", "init", "resolution_schedule", *PLANNED_BY, "steps", "preset", "downscale")
"""Settings of blocks that the coarse model has of its own."""


@dataclass(frozen=True)
class CoarseWishes:
    """The coarse model of the whole scene."""

    steps: int = 500
    """0: none; blocks start from their points alone."""
    downscale: float = 2.0
    """Divisor of the images, on top of that of the blocks."""
    points: int = 500_000
    """Points of the data set that it starts from at most: it does not grow."""
    rest: bool = True
    """True if blocks are trained with the rest of it that their views see."""


@dataclass(frozen=True)
class BlockTraining:
    """The training of all blocks of a partition, and what of it is done."""

    partition: Partition
    given: Mapping[str, str]
    """Settings of the blocks, as the user typed them."""
    coarse: CoarseWishes
    registry: Registry
    source: str = ""
    """Place of the data set; empty for that of the partition."""
    resources: Resources = field(default_factory=Resources)

    @property
    def folder(self) -> Path:
        """The folder of the partition."""
        return self.partition.path.parent

    def data_settings(self, **own: str) -> dict[str, str]:
        """Settings of a run that concern its data."""
        source = {"datamanager.source": self.source} if self.source else {}
        return {"data": str(self.folder / FILE), **source, **own}

    def run_of(self, block: Block) -> Path:
        """Folder of the run of a block."""
        return self.folder / RUNS / block.name

    def start_of(self, block: Block) -> Path:
        """File of the Gaussians that a block begins with."""
        return self.folder / STARTS / f"{block.name}.ply"

    def check_same(self) -> None:
        """Keep the settings, or check that they are those of an earlier call.

        Raises:
            ConfigError: they differ; names the keys.
        """
        path = self.folder / SETTINGS
        now = {key: text for key, text in self.given.items() if key not in FREE}
        now |= {f"coarse.{key}": str(value) for key, value in vars(self.coarse).items()}
        if path.exists():
            found = read_document(path, SCHEMA, "Remove it to train all blocks anew.")
            before = found.get("settings", {})
            changed = sorted(key for key in {*now, *before} if now.get(key) != before.get(key))
            if changed:
                key = changed[0]
                raise ConfigError(
                    f"{self.folder}: its blocks were begun with {key}="
                    f"{before.get(key, 'its default')}, and now it is {now.get(key, 'its default')}"
                    ".",
                    "Give the same settings to continue, or again=true to train all blocks anew.",
                )
        document = {"schema": SCHEMA, "settings": now}
        write_atomically(path, (json_text(document, indent=1) + "\n").encode())

    def coarse_job(self) -> Job | None:
        """The run of the coarse model; ``None`` if it is finished, or not wanted."""
        folder = self.folder / COARSE
        if not self.coarse.steps or RunFolder(folder).is_finished:
            return None
        kept = {
            key: text for key, text in self.given.items() if key.partition(".")[0] not in GROWTH
        }
        downscale = float(self.given.get("downscale", "1")) * self.coarse.downscale
        settings = kept | {
            "strategy": "none",
            "init": "points",
            "steps": str(self.coarse.steps),
            "downscale": f"{downscale:g}",
            "eval_every": "0",
            "report": "false",
            **self.data_settings(**{"datamanager.points": str(self.coarse.points)}),
        }
        return self._job("coarse model", settings, folder)

    def block_job(self, block: Block) -> Job | None:
        """The run of a block; ``None`` if it is finished."""
        folder = self.run_of(block)
        if RunFolder(folder).is_finished:
            return None
        own = {"datamanager.block": block.name}
        settings = {**self.given, **self.data_settings(**own)}
        if self.coarse.steps:
            settings["init"] = str(self.start_of(block))
        return self._job(f"block {block.name}", settings, folder)

    def _job(self, name: str, settings: Mapping[str, str], folder: Path) -> Job:
        pairs = [f"{key}={text}" for key, text in settings.items()]
        return Job(
            name=name,
            work=("train", *pairs, f"out={folder}"),
            resources=self.resources,
            reads=(self.folder, self.partition.data),
            folder=folder,
            resume=("resume", str(folder)),
            result=RunFolder(folder).summary,
        )

    def write_starts(self) -> None:
        """Write the starts of the blocks that have none.

        Raises:
            DataError: the coarse model or the data set cannot be read.
            OutputError: a file cannot be written.
        """
        missing = [block for block in self.partition.blocks if self._needs_start(block)]
        if not self.coarse.steps or not missing:
            return
        coarse = run_splats(restore(RunFolder(self.folder / COARSE), self.registry))
        data = self._whole
        count = len(data.recording.points)
        used = np.zeros(count, bool)
        used[rows_of(count, self.coarse.points)] = True
        (self.folder / STARTS).mkdir(exist_ok=True)
        with stage("writing the starts of blocks", len(missing)) as advance:
            for number, block in enumerate(missing):
                write_start(
                    self.start_of(block), block, coarse, data, used, self.partition.ground,
                    rest=self.coarse.rest,
                )  # fmt: skip
                advance(number + 1)
        data.close()

    def _needs_start(self, block: Block) -> bool:
        return self.block_job(block) is not None and not self.start_of(block).exists()

    @cached_property
    def _whole(self) -> Capture:
        """The whole data set."""
        data = open_data(resolve(self.registry, [self.layer()]))
        assert isinstance(data, Capture)
        return data

    def layer(self) -> Layer:
        """Settings of a run of the whole data set."""
        kept = {key: text for key, text in self.given.items() if key != "init"}
        return Layer(COMMAND_LINE, {**kept, **self.data_settings()})

    def pending(self) -> Sequence[Job]:
        """The runs of the blocks that are not finished."""
        found = (self.block_job(block) for block in self.partition.blocks)
        return [job for job in found if job is not None]
