"""Sort: our radix sort beside torch.sort, on the keys of an image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor

from gsfw.kernels.cuda.launcher import Launcher
from gsfw.kernels.cuda.sort import radix_sort
from gsfw.studies.bench.timing import timings_on
from gsfw.studies.bench.workload import FULL_HD, SEED

TILE = 16
"""Side of a tile in pixels."""

REACH = 3
"""Number of tiles along each axis that a splat intersects."""

WARM_UP, REPEATS = 3, 20

DEPTH_BITS = 32


def compare_sorts(launcher: Launcher, device: torch.device, splats: int) -> list[dict[str, Any]]:
    """Sort splats by depth (32 bits), and tile intersections by tile (bits for 1920x1080 pixels).

    The intersections are those of ``splats`` random squares of 3x3 tiles, splat after splat, as
    binning emits them. Both sorts get the same numbers and have to give the same order.

    Returns:
        For each kind of keys: their number and bits, milliseconds of both sorts (median and
        distance of the quartiles), and whether the results are equal.
    """
    generator = torch.Generator(device).manual_seed(SEED)
    columns, rows = (-(-side // TILE) for side in FULL_HD)
    depths = torch.rand(splats, generator=generator, device=device).view(torch.int32)
    tiles = _tiles(splats, columns, rows, generator)
    payload = torch.arange(len(tiles), dtype=torch.int32, device=device)
    return [
        _compare("depth", launcher, depths, None, DEPTH_BITS),
        _compare("tile", launcher, tiles, payload, (columns * rows - 1).bit_length()),
    ]


def _tiles(splats: int, columns: int, rows: int, generator: torch.Generator) -> Int[Tensor, " p"]:
    """The tile of each intersection, in 16 bits."""
    device = generator.device

    def first(limit: int) -> Tensor:
        return torch.randint(limit - REACH + 1, (splats, 1), generator=generator, device=device)

    steps = torch.arange(REACH, device=device)
    square = (steps[:, None] * columns + steps).flatten()
    return (first(rows) * columns + first(columns) + square).flatten().to(torch.int16)


def _compare(
    name: str, launcher: Launcher, keys: Tensor, payload: Tensor | None, bits: int
) -> dict[str, Any]:
    def ours() -> Tensor:
        return radix_sort(launcher, keys, payload, bits)[1]

    def torchs() -> Tensor:
        order = torch.sort(keys, stable=True)[1]
        return order.to(torch.int32) if payload is None else payload[order]

    timings = timings_on(keys.device)
    sorts: dict[str, Callable[[], Tensor]] = {"radix_sort": ours, "torch_sort": torchs}
    for repeat in range(WARM_UP + REPEATS):
        for sort, run in sorts.items():
            if repeat < WARM_UP:
                run()
                continue
            with timings.stage(sort):
                run()
    figures = timings.figures()
    wanted = [f"{sort}_{end}" for sort in sorts for end in ("ms", "spread_ms")]
    return {
        "sort": name,
        "keys": len(keys),
        "bits": bits,
        **{key: figures[key] for key in wanted},
        "same": torch.equal(ours(), torchs()),
    }
