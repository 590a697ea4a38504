"""Memory fit: whether a run fits into the memory of this machine and of its control groups."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Int
from torch import Tensor

from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import NotEnoughMemoryError
from gsfw.core.loop.growth_limit import UNLIMITED
from gsfw.core.machine_memory import Limit, MachineMemory, gpu_memory, process_memory
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.training_memory import (
    BASE_BYTES,
    CERTAIN,
    PIXEL_BYTES,
    USUAL_ROW,
    RowMemory,
    TrainingMemory,
    decoded_bytes,
    model_row_memory,
)
from gsfw.core.words import shell_argument, size
from gsfw.plugins.settings import Settings

CACHE_SHARE = 0.25
"""Part of the memory for decoded images at most, where the user gives no number."""
LEAST_CACHE_MB = 100
"""Megabytes of decoded images that are kept all the same: without any, every use decodes."""
NOTABLE = 0.1
"""Part of the need from which on a remedy is worth a word."""
SAMPLE = 500
"""Points of a model that shows the bytes of a Gaussian."""
FEWEST = 5_000
"""Gaussians to start with that are worth a proposal."""
MEGABYTE = 1_000_000


def usual_cache_mb(settings: Settings) -> int:
    """Megabytes of decoded images: ``cache_mb``, or less where that is a default and too much."""
    most, memory = settings.config.cache_mb, process_memory()
    if "cache_mb" in settings.given or memory is None:
        return most
    share = int((memory.room - BASE_BYTES) * CACHE_SHARE) // MEGABYTE
    return min(most, max(share, LEAST_CACHE_MB))


@dataclass(frozen=True)
class MemoryFit:
    """Compares the need of a run on opened data with the memory that is there."""

    settings: Settings
    data: DataManager
    device: torch.device
    is_new: bool = True
    """False for a model that was trained already: nothing is refused or noted."""

    @cached_property
    def memory(self) -> MachineMemory | None:
        """The memory of this process; ``None`` where it is unknown."""
        return process_memory()

    @cached_property
    def rows_memory(self) -> MachineMemory | None:
        """The memory that has the Gaussians: that of the GPU, or main memory."""
        return gpu_memory(self.device) if self.device.type == "cuda" else self.memory

    @property
    def _checks(self) -> bool:
        """True if a run may be refused."""
        return bool(self.is_new and self.settings.config.check_memory)

    @property
    def _shards(self) -> int:
        """Number of processes that share the Gaussians."""
        config = self.settings.config
        return max(config.processes, 1) if config.shards else 1

    @property
    def _views(self) -> int:
        """Number of views of a step that a process renders at a time, at most."""
        config = self.settings.config
        views = max(int(getattr(config.sampler, "views_per_step", 1)), 1)
        return views if config.shards else -(-views // max(config.processes, 1))

    def row(self, model: PrimitiveModel | None = None) -> RowMemory:
        """The memory of a Gaussian in the steps of this run, of a usual model if it is unknown."""
        if model is not None:
            return model_row_memory(model, self._views)
        return replace(USUAL_ROW, rendered=USUAL_ROW.rendered * self._views)

    def need(self, gaussians: int, row: RowMemory) -> TrainingMemory:
        """The main memory that a process with ``gaussians`` Gaussians takes.

        On a GPU these, and the images of a step, are in its own memory. Shards are each in a
        process of its own.

        Args:
            gaussians: of the model.
            row: of a Gaussian.
        """
        views = self.data.views(Split.TRAIN)
        images = min(decoded_bytes(self.data), usual_cache_mb(self.settings) * MEGABYTE)
        if self.device.type != "cpu":
            return TrainingMemory(0, row, len(self.data.scene.points), 0, images)
        points = len(self.data.scene.points)
        return TrainingMemory(gaussians, self._share(row), points, views.pixels, images)

    def _share(self, row: RowMemory) -> RowMemory:
        """The part of this process, which makes all Gaussians and then has some of them."""
        return row.shared(self._shards) if self._shards > 1 else row

    def rows_need(self, gaussians: int, row: RowMemory) -> float:
        """Bytes of the memory that holds the Gaussians, with all else that is in it.

        On a GPU these are the bytes of the Gaussians alone, without those of rasterizers.
        """
        if self.device.type == "cuda":
            return gaussians * self._share(row).peak
        return self.need(gaussians, row).total

    def most_gaussians(self, row: RowMemory) -> int:
        """Number of Gaussians that fit, with two digits; ``UNLIMITED`` where the memory is unknown.

        Args:
            row: of a Gaussian.
        """
        memory = self.rows_memory
        if memory is None:
            return UNLIMITED
        if memory.limit is Limit.GPU:
            most = int(memory.room / self._share(row).peak)
        else:
            most = self.need(1, row).most_gaussians(memory.room)
        return most - most % 10 ** max(len(str(most)) - 2, 0)

    def check_start(self, method: Method, scene: Scene, initial: Splats | None) -> None:
        """Check, before a model is built, whether there is memory for one of all points.

        Where it may be short, a model of a few of them shows the bytes of a Gaussian.

        Args:
            method: builds it.
            scene: with the points to start from.
            initial: splats to start from instead; ``None`` otherwise.

        Raises:
            NotEnoughMemoryError: there is not.
        """
        count = len(scene.points) if initial is None else len(initial)
        if initial is None and self.settings.config.init == "random":
            count = 0
        is_on_gpu = self._checks and self.device.type == "cuda"
        if not (is_on_gpu or self._is_too_much(self.need(count, self.row()))):
            return
        if not count:
            self._check(0, self.row())
            return
        few = torch.arange(min(count, SAMPLE)) * count // min(count, SAMPLE)
        scene, initial = (
            (_with_points(scene, few), None) if initial is None else (scene, initial.take(few))
        )
        seeded = torch.Generator().manual_seed(0)
        model = method.build_model(scene, Operators(), seeded, initial)
        # A method may use some of the points: then the number is known once the model is built.
        if model.num_rows == len(few):
            self._check(count, self.row(model))

    def check_model(self, model: PrimitiveModel) -> None:
        """Check what the model needs that a run starts with.

        Raises:
            NotEnoughMemoryError: it is more than there is.
        """
        self._check(model.num_rows, self.row(model))

    def _is_too_much(self, need: TrainingMemory) -> bool:
        """True if a run needs more than there is for certain, and may be refused."""
        if not self._checks or self.memory is None:
            return False
        return CERTAIN * need.total > self.memory.room + self.memory.swap

    def _check(self, gaussians: int, row: RowMemory) -> None:
        """Check that the first steps of a run fit, with a margin (``CERTAIN``).

        Raises:
            NotEnoughMemoryError: they do not; names the need, the limit and what needs less.
        """
        need = self.need(gaussians, row)
        self._check_gpu(gaussians, row)
        if self.memory is None or not self._is_too_much(need):
            return
        what = f" for {gaussians:,} Gaussians to start with" if need.gaussians else ""
        raise NotEnoughMemoryError(
            f"training needs about {size(need.total)} of memory{what}, and {self.memory}.",
            self._advice(need, self.memory, self.most_gaussians(row)),
        )

    def _check_gpu(self, gaussians: int, row: RowMemory) -> None:
        """Check that the parameters, gradients and moments of the first step fit on the GPU.

        Raises:
            NotEnoughMemoryError: they do not.
        """
        if not self._checks or self.device.type != "cuda":
            return
        memory, kept = gpu_memory(self.device), gaussians * self._share(row).kept
        if kept <= memory.room:
            return
        raise NotEnoughMemoryError(
            f"training needs {size(kept)} of GPU memory and more for {gaussians:,} Gaussians to "
            f"start with, and {memory}.",
            self._advice(TrainingMemory(gaussians, row, 0, 0, 0), memory, self.most_gaussians(row)),
        )

    def _advice(self, need: TrainingMemory, memory: MachineMemory, most: int) -> str:
        """The settings that need less, and the way to train a scene that fits nowhere.

        Args:
            need: of the run.
            memory: that is there.
            most: Gaussians that fit.
        """
        settings, notable = self.settings.flat(), NOTABLE * need.total
        many, less = need.gaussians * need.row.peak > notable, []
        if many and most >= FEWEST:
            less.append(f"fewer Gaussians to start with (init=dense dense_points={most})")
        if many and int(settings.get("sh_degree", 0)) > 1:
            less.append("fewer numbers of colour (sh_degree=1)")
        if need.images > notable:
            less.append(f"fewer decoded images (cache_mb={int(need.images / 4e6) or 1})")
        if need.images + need.pixels * PIXEL_BYTES > notable:
            less.append(f"smaller images (downscale={2 * settings['downscale']:g})")
        lines = [f"A run needs less with {' or '.join(less)}."] if less else []
        if many and settings["data"] and not self.data.scene.is_dynamic:
            room = size(memory.room).replace(" ", "")
            data = shell_argument(settings["data"])
            lines.append(
                f"gsfw partition {data} out=DIR memory={room} cuts the scene into "
                "blocks that fit; processes=N shards=N shares the Gaussians of one model among "
                "machines."
            )
        lines.append("check_memory=false trains all the same.")
        return "\n".join(lines)

    def notes(self) -> tuple[str, ...]:
        """Note on images that are decoded again and again, as memory is short."""
        usual, decoded = usual_cache_mb(self.settings), decoded_bytes(self.data) / MEGABYTE
        if not self.is_new or usual == self.settings.config.cache_mb or decoded <= usual:
            return ()
        return (
            f"decoded images take at most {usual} MB of {decoded:.0f}, as {self.memory} "
            "(cache_mb=N sets another number).",
        )


def _with_points(scene: Scene, rows: Int[Tensor, " r"]) -> Scene:
    """A scene with some of its points, and without a sky, which has few."""
    times = scene.point_times
    return replace(
        scene,
        points=scene.points[rows],
        point_colors=scene.point_colors[rows],
        point_times=None if times is None else times[rows],
        sky=None,
    )
