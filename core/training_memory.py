"""Training memory: the main memory that a process needs to train on the CPU, about.

Measured as the most anonymous memory (``RssAnon``, which a control group counts) of whole runs of
four methods with 20,000 to 1,000,000 Gaussians and 768 to 7.7 million pixels: the estimate is 0.96
to 1.39 of it. docs/guides/large-scenes.md has the runs.
"""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.datamanager import DataManager, Split
from gsfw.core.model import PrimitiveModel

BASE_BYTES = 350e6
"""Memory of a training process without Gaussians and images."""
COPIES = 8
"""Bytes in training for each byte of a trained column, at the peak: value, gradient, two moments,
and the buffers of a step and of the files at the end."""
WORK_BYTES = 212
"""Bytes of a Gaussian besides: its projection, and its statistics for density control."""
START_BYTES = 735
"""Memory of a Gaussian while a model is built, which each of several processes does for all;
measured with 400,000 (built-in scene)."""
POINT_BYTES = 48
"""Memory of a point of the data set, which every process reads: position and colour in float64."""
PIXEL_BYTES = 400
"""Memory of a step for each pixel of its image: the render, the photo, gradients and SSIM."""
USUAL_COLUMN_BYTES = 4.0 * 59
"""Columns of a Gaussian with SH of degree 3."""


def row_bytes(column_bytes: float) -> float:
    """Memory of a Gaussian in training.

    Args:
        column_bytes: of its trained columns.
    """
    return COPIES * column_bytes + WORK_BYTES


def model_row_bytes(model: PrimitiveModel) -> float:
    """Memory of a Gaussian of a model in training, as a mean."""
    columns = [column for column in model.columns().values() if column.trained]
    return row_bytes(sum(column.values.nbytes for column in columns) / max(model.num_rows, 1))


def decoded_bytes(data: DataManager) -> int:
    """Bytes of all images of a data set once they are decoded, at the size of the training."""
    channels = 4 if data.scene.has_alpha else 3
    cameras = [camera for split in Split for camera in data.views(split).cameras]
    return sum(camera.width * camera.height for camera in cameras) * channels


@dataclass(frozen=True)
class TrainingMemory:
    """The memory that one training process needs, at its peak, in bytes."""

    gaussians: int
    row_bytes: float
    """Bytes of a Gaussian."""
    points: int
    """Points of the data set."""
    pixels: int
    """Pixels of a view at the size of training."""
    images: int | float
    """Bytes of the decoded images that stay in memory."""

    @property
    def besides(self) -> float:
        """All but the Gaussians."""
        points, pixels = self.points * POINT_BYTES, self.pixels * PIXEL_BYTES
        return BASE_BYTES + points + pixels + self.images

    @property
    def total(self) -> float:
        """All of it."""
        return self.besides + self.gaussians * self.row_bytes

    def most_gaussians(self, room: int | float) -> int:
        """Number of Gaussians with which it fits into so many bytes."""
        return max(int((room - self.besides) / self.row_bytes), 0)
