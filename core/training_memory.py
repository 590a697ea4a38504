"""Training memory: the main memory that a process needs to train on the CPU, about.

Measured as the most anonymous memory (``RssAnon``, which a control group counts) of whole runs of
four methods with 1000 to 1,000,000 Gaussians, 768 to 1.9 million pixels and 1 to 12 views of a
step by ``benchmarks/training_memory.py``; the estimate is 0.91 to 1.13 of it.
docs/results/large-scenes.md has the table.
"""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.datamanager import DataManager, Split
from gsfw.core.model import PrimitiveModel

CERTAIN = 0.85
"""Part of the estimate that a run takes at least: it was 0.88 to 1.10 of it where it was measured
(docs/results/large-scenes.md). Only a run that needs more than there is even then is refused."""
BASE_BYTES = 292e6
"""Memory of a training process without Gaussians and images."""
COPIES = 4
"""Bytes that stay for each byte of a trained column: value, gradient, two moments."""
UPDATE_BYTES = 240.0
"""Bytes of a Gaussian in the update of all parameters, besides a copy of its largest column."""
VIEW_BYTES = 128.0
"""Bytes of a Gaussian for each view of a step: its projection, tile intersections, gradients."""
SHARED_RENDER = 2.8
"""Factor of that where several processes share the Gaussians, and exchange all views at once:
four views at 320x240 took 2200 to 2600 bytes for each Gaussian (docs/results/large-scenes.md)."""
START_BYTES = 735.0
"""Memory of a Gaussian while a model is built, which each of several processes does for all;
measured with 400,000 (built-in scene)."""
POINT_BYTES = 48
"""Memory of a point of the data set, which every process reads: position and colour in float64."""
PIXEL_BYTES = 540
"""Memory of a step for each pixel of a view: the render, the photo, gradients and SSIM."""


@dataclass(frozen=True)
class RowMemory:
    """The memory of a Gaussian in training, in bytes."""

    kept: float
    """Values, gradients and moments of its trained columns."""
    updated: float
    """Besides these, while parameters are updated."""
    rendered: float
    """Besides these, while the views of a step are rendered."""

    @property
    def first(self) -> float:
        """The part of ``peak`` that the first step takes: all but the values of the columns."""
        return self.peak - self.kept / COPIES

    @property
    def peak(self) -> float:
        """The most of it, with small images."""
        return self.kept + max(self.updated, self.rendered)

    def shared(self, processes: int) -> RowMemory:
        """The part of one of several processes, each of which builds the whole model."""
        kept, rendered = self.kept / processes, SHARED_RENDER * self.rendered / processes
        return RowMemory(kept, max(self.updated / processes, START_BYTES - kept), rendered)


def row_memory(
    columns: float, largest: float, views: int = 1, step_bytes: float = 0.0
) -> RowMemory:
    """Memory of a Gaussian.

    Args:
        columns: bytes of its trained columns.
        largest: bytes of the largest of them.
        views: of a step.
        step_bytes: what its model needs in a step besides (``PrimitiveModel.step_bytes``).
    """
    return RowMemory(COPIES * columns, largest + UPDATE_BYTES, VIEW_BYTES * views + step_bytes)


USUAL_ROW = row_memory(4.0 * 59, 4.0 * 45)
"""A Gaussian with SH of degree 3."""


def model_row_memory(model: PrimitiveModel, views: int = 1) -> RowMemory:
    """Memory of a Gaussian of a model, as a mean.

    Args:
        model: with its columns.
        views: of a step.
    """
    rows = max(model.num_rows, 1)
    sizes = [column.values.nbytes / rows for column in model.columns().values() if column.trained]
    return row_memory(sum(sizes), max(sizes, default=0.0), views, model.step_bytes)


def decoded_bytes(data: DataManager) -> int:
    """Bytes of all images of a data set once they are decoded, at the size of the training."""
    channels = 4 if data.scene.has_alpha else 3
    cameras = [camera for split in Split for camera in data.views(split).cameras]
    return sum(camera.width * camera.height for camera in cameras) * channels


@dataclass(frozen=True)
class TrainingMemory:
    """The memory that one training process needs, at its peak, in bytes."""

    gaussians: int
    row: RowMemory
    """The memory of a Gaussian."""
    points: int
    """Points of the data set."""
    pixels: int
    """Pixels of a view at the size of training."""
    images: int | float
    """Bytes of the decoded images that stay in memory."""

    @property
    def besides(self) -> float:
        """All but the Gaussians and the pixels of a step."""
        return BASE_BYTES + self.points * POINT_BYTES + self.images

    @property
    def total(self) -> float:
        """All of it: in the update of the parameters, or in the render, if that takes more."""
        rendered = self.gaussians * self.row.rendered + self.pixels * PIXEL_BYTES
        kept = self.gaussians * self.row.kept
        return self.besides + kept + max(self.gaussians * self.row.updated, rendered)

    def most_gaussians(self, room: int | float) -> int:
        """Number of Gaussians with which it fits into so many bytes."""
        left, row = room - self.besides, self.row
        updated = left / (row.kept + row.updated)
        rendered = (left - self.pixels * PIXEL_BYTES) / (row.kept + row.rendered)
        return max(int(min(updated, rendered)), 0)
