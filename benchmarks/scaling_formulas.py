"""Formulas: memory, exchanged bytes and time of a step of very large scenes, by way of training.

Letters: n Gaussians of the scene, N processes (one a machine), V views of a step, v Gaussians that
a view sees. Nothing is measured here; ``scaling_costs`` measures the constants, and
``scaling_plan`` compares the formulas with small cases and prints the plan.

Gaussian parallel follows Grendel-GS (Zhao et al. 2024): rows are divided among the processes, and
every view is divided into bands of image rows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gsfw.core.training_memory import BASE_BYTES, POINT_BYTES, START_BYTES, USUAL_ROW
from gsfw.planning.costs import GAUSSIANS_PER_PIXEL

ROW_BYTES = USUAL_ROW.peak
"""Memory of a Gaussian of SH degree 3 in training."""
ROW_NUMBERS = 59
"""Parameters of a Gaussian of SH degree 3: 3 + 3 + 4 + 1 + 48."""
FLOAT = 4
"""Bytes of a float32."""
CHECKPOINTED = 3
"""Copies of a parameter in a checkpoint: itself and two moments."""
SPLAT_BYTES = 15 * FLOAT
"""A projected splat as it is sent: 11 numbers of its ellipse, colour and depth."""
RETURNED_BYTES = 9 * FLOAT
"""The sums of a band that come back, from which its gradient follows."""
SEEN_BYTES = 3 * FLOAT
"""Statistics of a Gaussian that a view has seen, for every process: its number and two values."""
EVERY_ROW_BYTES = 32
"""Statistics of every row of the scene in each process: three of a view, and those of refiners."""
CHANNELS = 4
"""Channels of a band that is gathered: colour and alpha."""
MEASURED_ROWS = 3
"""Statistics of every row that data parallelism gathers: visible, radius, screen gradient."""
MARGIN = 0.15
"""Margin of a block, in parts of its cell's side (``gsfw partition margin=``)."""


@dataclass(frozen=True)
class Costs:
    """Seconds of one core for a unit of work, and speeds of the network."""

    view_row: float
    """Seconds for a held Gaussian in each view: activation, culling, and its empty gradient."""
    step_row: float
    """Seconds for a held Gaussian in each step: the check of its gradient, and dense Adam."""
    splat: float
    """Seconds for a Gaussian that a view sees: projection, colour, sorting, and their backward."""
    pair: float
    """Seconds for a pixel and a Gaussian that contributes to it, forward and backward."""
    pixel: float
    """Seconds for a pixel of the loss and its gradient."""
    fixed: float
    """Seconds of a step without any Gaussian."""
    decode: float
    """Seconds for a pixel of a photo that is decoded."""
    latency: float
    """Seconds of an exchange of nothing between two processes."""
    bytes_per_second: float
    """From one process to another, as far as processors and not the network bound it."""


@dataclass(frozen=True)
class View:
    """A picture and what it sees."""

    width: int
    height: int
    pairs_per_pixel: float = 48.0
    """Contributing Gaussians of a pixel; 13.0 million pairs in 648 x 420 pixels of "garden"
    (docs/results/performance.md)."""
    splat_height: float = 16.0
    """Mean height of a splat on the image, in pixels; 16 where 42,000 of the built-in workload's
    are on 480 x 315 pixels (``scaling_plan`` prints it)."""
    seen: int | None = None
    """Gaussians that it sees; ``None``: ``GAUSSIANS_PER_PIXEL`` for each pixel, as in planning."""

    @property
    def pixels(self) -> int:
        """Pixels of the picture."""
        return self.width * self.height

    def splats(self, rows: float) -> float:
        """Gaussians that it sees of a scene of so many."""
        expected = GAUSSIANS_PER_PIXEL * self.pixels if self.seen is None else float(self.seen)
        return min(rows, expected)

    @property
    def pairs(self) -> float:
        """Pixels times contributing Gaussians."""
        return self.pixels * self.pairs_per_pixel


@dataclass(frozen=True)
class Machine:
    """One machine of the plan, which runs one process."""

    cores: int
    """All work is divided among them without loss: an assumption."""
    memory_mb: float
    network: float
    """Bytes per second in each direction: an assumption."""


# Memory, in bytes per process.


def memory_bytes(rows: float, points: float = 0.0) -> float:
    """Peak bytes of a process that trains so many rows and has read so many points.

    It is the rule by which ``gsfw partition`` cuts. Images come on top: decoded ones up to
    ``cache_mb``, and ``PIXEL_BYTES`` for each pixel of the one that is trained on.
    """
    return BASE_BYTES + rows * ROW_BYTES + points * POINT_BYTES


def gaussian_parallel_memory(
    rows: float, size: int, view: View, points: float = 0.0, start: float = 0.0
) -> float:
    """Peak bytes of a process of Gaussian parallelism: its rows, and the splats of its band.

    Args:
        rows: of all processes.
        size: processes.
        view: that is rendered.
        points: of the data set, which every process reads.
        start: rows at the start; every process makes all of them, and keeps its own.
    """
    received = band_copies(view, size) * view.splats(rows) / size * (SPLAT_BYTES + RETURNED_BYTES)
    pictures = 2 * CHANNELS * FLOAT * view.pixels
    training = memory_bytes(rows / size, points) + received + pictures + rows * EVERY_ROW_BYTES
    return max(training, memory_bytes(0, points) + start * START_BYTES)


def rows_that_fit(memory_mb: float, points: float = 0.0) -> float:
    """Rows that one process has room for; below 1 if the points alone fill the memory."""
    return (memory_mb * 1e6 - memory_bytes(0, points)) / ROW_BYTES


def checkpoint_bytes(rows: float) -> float:
    """Bytes of a checkpoint of so many rows."""
    return rows * ROW_NUMBERS * FLOAT * CHECKPOINTED


# Exchange, in bytes that a process sends in one step.


def data_parallel_bytes(
    parameters: float, size: int, views: int, rows: float = 0.0, statistics: int = 0
) -> float:
    """Bytes of gradients, and of statistics of every row, that a process sends in a step.

    Args:
        parameters: of the whole model.
        size: processes.
        views: of a step.
        rows: Gaussians, of which statistics are gathered for refiners and samplers.
        statistics: numbers of each row.
    """
    rounds = math.ceil(views / size)
    gradients = FLOAT * parameters * (size - 1) / size * (rounds + 1)
    return gradients + FLOAT * statistics * rows * (size - 1) * rounds


def band_copies(view: View, size: int) -> float:
    """Bands that a splat touches in the mean: 1 + h / (H / N), at most N."""
    return min(float(size), 1 + view.splat_height * size / view.height)


def gaussian_parallel_bytes(rows: float, size: int, view: View, views: int) -> float:
    """Bytes that a process sends in a step.

    Flat splats to the bands that they touch and the gradients back, its part of each image to all,
    and the statistics of Gaussians that were seen to all.
    """
    others = (size - 1) / size
    sent = band_copies(view, size) / size * (SPLAT_BYTES + RETURNED_BYTES) + SEEN_BYTES
    return views * others * (view.splats(rows) * sent + CHANNELS * FLOAT * view.pixels)


def exchange_seconds(
    costs: Costs, machine: Machine, sent: float, exchanges: int, size: int
) -> float:
    """Seconds to send so many bytes in so many exchanges of all processes.

    An exchange takes log2 N latencies, rounded up: an assumption beyond two processes.
    """
    delays = exchanges * math.ceil(math.log2(size)) * costs.latency
    return delays + sent / min(machine.network, costs.bytes_per_second)


# Time, in seconds of a step.


def drawing_seconds(costs: Costs, view: View, rows: float) -> float:
    """Seconds of one core for the splats and pairs of a view, of a scene of so many rows."""
    return view.splats(rows) * costs.splat + view.pairs * costs.pair


def one_process_seconds(
    costs: Costs, machine: Machine, view: View, rows: float, views: int = 1
) -> float:
    """Seconds of a step in one process that holds all rows."""
    each = rows * costs.view_row + drawing_seconds(costs, view, rows)
    each += view.pixels * (costs.pixel + costs.decode)
    return (costs.fixed + rows * costs.step_row + views * each) / machine.cores


def data_parallel_seconds(
    costs: Costs, machine: Machine, view: View, rows: float, size: int, views: int
) -> float:
    """Seconds of a step in which N processes render V views."""
    rounds = math.ceil(views / size)
    sent = data_parallel_bytes(rows * ROW_NUMBERS, size, views, rows, MEASURED_ROWS)
    exchanged = exchange_seconds(costs, machine, sent, 2 * rounds + 3, size)
    return one_process_seconds(costs, machine, view, rows, rounds) + exchanged


def gaussian_parallel_seconds(
    costs: Costs, machine: Machine, view: View, rows: float, size: int, views: int
) -> float:
    """Seconds of a step in which N processes render V views, one after the other, in bands.

    Every process decodes the whole photo and computes the whole loss: that time is not divided.
    """
    own = rows / size
    shared = drawing_seconds(costs, view, rows) / size + own * costs.view_row
    whole = view.pixels * (costs.pixel + costs.decode)
    work = costs.fixed + own * costs.step_row + views * (shared + whole)
    sent = gaussian_parallel_bytes(rows, size, view, views)
    return work / machine.cores + exchange_seconds(costs, machine, sent, 4 * views, size)


# Blocks.


def block_overlap() -> float:
    """Area of a square cell with its margin over that of the cell."""
    return (1 + 2 * MARGIN) ** 2


def block_rows(rows: float, blocks: int) -> float:
    """Rows that a block trains, with its margin."""
    return rows if blocks == 1 else rows / blocks * block_overlap()


def blocks_for(rows: float, memory_mb: float, points: float, size: int = 1) -> int | None:
    """Fewest blocks that fit, each into ``size`` machines; ``None`` if the points alone do not.

    Every process reads all points of the data set.
    """
    room = rows_that_fit(memory_mb, points) * size
    if room < 1:
        return None
    blocks = 1 if rows <= room else math.ceil(rows * block_overlap() / room)
    if size == 1:
        return blocks
    # The machines of a team share the rows of a block, but each makes all that it starts with.
    starts = rows_that_fit(memory_mb, points) * ROW_BYTES / START_BYTES
    return max(blocks, math.ceil(points * block_overlap() / starts))
