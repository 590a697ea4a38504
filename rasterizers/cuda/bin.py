"""Bin: from projected splats to the pairs of a splat and a tile, tile after tile, front to back."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.kernels.cuda import jobs
from gsfw.kernels.cuda.arrays import Arrays, capacity
from gsfw.kernels.cuda.instances import Instances
from gsfw.kernels.cuda.launcher import Entry, Launcher
from gsfw.kernels.cuda.sort import WORD_BYTES, KeyedRows, RadixSort, sort_kernels
from gsfw.kernels.cuda.source_files import constant
from gsfw.rasterizers.cuda.pair_rooms import PairRooms
from gsfw.rasterizers.kernel_backend import TooManyPairs

BIN_THREADS = constant("stages.h", "BIN_THREADS")
COUNTS_PER_BLOCK = BIN_THREADS * constant("stages.h", "COUNTS_PER_THREAD")


@dataclass(frozen=True)
class Pairs:
    """The pairs of an image, sorted, in memory that has room for some more."""

    count: int
    """As many as ``room`` where only the GPU knows it."""
    chunks: int
    """Checkpoints that they can need however tiles divide them; 0 without a backward pass."""
    room: int
    """Pairs that there is memory for; what else is kept per pair takes as many."""
    arrays: Arrays
    """By pair: ``rows``, its splat, and if numbered ``slots``, where it was written. By tile:
    ``starts`` and ``chunk_starts``. By chunk: ``chunk_tiles``; see ``TilesJob``."""
    order: Tensor | None
    """Splats from front to back, in which pairs were written; only if numbered."""


@dataclass(frozen=True)
class Binning:
    """The sorts and what is between them. The host waits once, for the number of pairs.

    In a CUDA graph it cannot: the pairs then get the room that ``rooms`` has for them.
    """

    launcher: Launcher
    instances: Instances
    projected: jobs.ProjectJob
    """The projected splats that are binned."""
    rows: Arrays
    """Arrays of ``row_arrays``."""
    row_ends: int | None
    """Address that takes the end of each splat's pairs, by row, if pairs are numbered."""
    max_pairs: int
    rooms: PairRooms

    @property
    def _count(self) -> int:
        """Splats."""
        return int(self.projected.splats.count)

    @property
    def _device(self) -> torch.device:
        return self.rows.device

    def pairs(self, words: Tensor, differentiated: bool) -> Pairs:
        """Write the pairs and sort them by tile.

        Args:
            words: those that ``sort_by_depth`` has returned.
            differentiated: true if a backward pass may follow.

        Raises:
            TooManyPairs: there are more than ``max_pairs``.
        """
        self._count_pairs(words)
        grid, captured = self.projected.grid, self.launcher.captures()
        size = (grid.width, grid.height)
        if captured:
            count = room = min(self.rooms.room(size), self.max_pairs)
            self.rooms.captured(words[0], room)
        else:
            count = int(words[0])  # The number that the host waits for.
            if count > self.max_pairs:
                raise TooManyPairs(count)
            room = min(capacity(count), self.max_pairs)
            self.rooms.seen(size, count, self._device)
        chunk = self.instances.chunk if differentiated else room + 1
        numbered = self.row_ends is not None
        tiles = grid.columns * grid.rows + 1
        sizes = {
            "rows": (room, torch.int32),
            "starts": (tiles, torch.int64),
            "chunk_starts": (tiles, torch.int64),
            "chunk_tiles": (room // chunk, torch.int32),
        }
        if numbered:
            sizes |= {"slots": (room, torch.int32), "written_rows": (room, torch.int32)}
        order = self.rows.tensor("order") if numbered else None
        pairs = Pairs(count, count // chunk, room, Arrays(self._device, sizes), order)
        self._emit_sorted(pairs, words.data_ptr() if captured else None)
        if numbered:
            slots, written = (pairs.arrays.tensor(name) for name in ("slots", "written_rows"))
            rows = pairs.arrays.tensor("rows")
            torch.index_select(written, 0, slots[:count], out=rows[:count])
        return pairs

    def sort_by_depth(self) -> Tensor:
        """Order all rows, the visible ones first, from front to back; equal depths by row.

        Returns:
            Words of 0 for ``pairs``.
        """
        rows, key = self.rows, depth_key(self.instances.dtype)
        sort = RadixSort(key, self._count, 8 * key.itemsize)
        own = 2 + self._count_blocks
        words = torch.zeros(own + sort.num_words, dtype=torch.int64, device=self._device)
        sort.run(
            self.launcher,
            KeyedRows(rows.address("depth_keys"), None),
            KeyedRows(rows.address("spare_keys"), rows.address("spare_order")),
            # The passes are even in number: the first one does not write here, where it reads.
            KeyedRows(rows.address("depth_keys"), rows.address("order")),
            words.data_ptr() + WORD_BYTES * own,
        )
        return words

    @property
    def _count_blocks(self) -> int:
        return -(-self._count // COUNTS_PER_BLOCK)

    def _count_pairs(self, words: Tensor) -> None:
        """Find where each splat's pairs end; the first word takes the number of all."""
        place = words.data_ptr()
        job = jobs.CountsJob(
            order=self.rows.address("order"),
            count=self._count,
            tile_counts=self.projected.tile_counts,
            ends=self.rows.address("ends"),
            row_ends=self.row_ends,
            pairs=place,
            next=place + WORD_BYTES,
            words=place + 2 * WORD_BYTES,
        )
        self.launcher.launch(self.instances.sum_counts, self._count_blocks, BIN_THREADS, job)

    def _emit_sorted(self, pairs: Pairs, counted: int | None) -> None:
        """Write the pairs and sort them; ``counted``: address of their number in a graph."""
        key, room = self.instances.tile_key, pairs.room
        unsorted = Arrays(
            self._device,
            {
                **{name: (room, key) for name in ("tiles", "spare_tiles", "sorted_tiles")},
                **{name: (room, torch.int32) for name in ("payload", "spare_payload")},
            },
        )
        numbered = self.row_ends is not None
        job = jobs.EmitJob(
            grid=self.projected.grid,
            bounded=self.projected.bounded,
            stride=self.projected.stride,
            projected=self.projected.projected,
            order=self.rows.address("order"),
            count=self._count,
            tile_counts=self.projected.tile_counts,
            ends=self.rows.address("ends"),
            tiles=unsorted.address("tiles"),
            payload=unsorted.address("payload"),
            rows=pairs.arrays.address("written_rows"),
            room=pairs.room,
            numbered=numbered,
        )
        blocks = -(-self._count // BIN_THREADS) if pairs.count else 0
        self.launcher.launch(self.instances.emit, blocks, BIN_THREADS, job)
        self._sort_by_tile(pairs, unsorted, counted)

    def _sort_by_tile(self, pairs: Pairs, unsorted: Arrays, counted: int | None) -> None:
        """Sort the pairs by tile; find the first pair of each tile, and its chunks."""
        kept, grid = pairs.arrays, self.projected.grid
        num_tiles = grid.columns * grid.rows
        bits = max(1, (num_tiles - 1).bit_length())
        sort = RadixSort(self.instances.tile_key, pairs.count, bits, counted)
        blocks = -(-(num_tiles + 1) // BIN_THREADS)
        own = 1 + blocks
        words = torch.zeros(own + sort.num_words, dtype=torch.int64, device=self._device)
        place = words.data_ptr()
        payload = kept.address("rows" if self.row_ends is None else "slots")
        sort.run(
            self.launcher,
            KeyedRows(unsorted.address("tiles"), unsorted.address("payload")),
            KeyedRows(unsorted.address("spare_tiles"), unsorted.address("spare_payload")),
            KeyedRows(unsorted.address("sorted_tiles"), payload),
            place + WORD_BYTES * own,
        )
        job = jobs.TilesJob(
            tiles=unsorted.address("sorted_tiles"),
            count=pairs.count,
            counted=counted,
            num_tiles=num_tiles,
            chunk=self.instances.chunk,
            starts=kept.address("starts"),
            chunk_starts=kept.address("chunk_starts"),
            chunk_tiles=kept.address("chunk_tiles"),
            chunks=pairs.chunks,
            next=place,
            words=place + WORD_BYTES,
        )
        self.launcher.launch(self.instances.find_tiles, blocks, BIN_THREADS, job)


def row_arrays(count: int, dtype: torch.dtype, device: torch.device) -> Arrays:
    """Memory by splat that is needed until pairs are written; ``project`` writes the depths."""
    key = depth_key(dtype)
    return Arrays(
        device,
        {
            "depth_keys": (count, key),
            "spare_keys": (count, key),
            "spare_order": (count, torch.int32),
            "order": (count, torch.int32),
            "ends": (count, torch.int64),
        },
    )


def depth_key(dtype: torch.dtype) -> torch.dtype:
    """The integer that depths of a number type are sorted as."""
    return torch.int32 if dtype == torch.float32 else torch.int64


def bin_kernels(chosen: Instances) -> list[Entry]:
    """The kernels that bin an image."""
    return [
        (chosen.sum_counts, jobs.CountsJob),
        (chosen.emit, jobs.EmitJob),
        (chosen.find_tiles, jobs.TilesJob),
        *sort_kernels(depth_key(chosen.dtype)),
        *sort_kernels(chosen.tile_key),
    ]
