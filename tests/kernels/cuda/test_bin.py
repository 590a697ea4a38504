"""Binning, on the emulation, against every pixel and every tile of an image."""

import ctypes
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch
from emulation.launcher import EmulatedLauncher
from emulation.sanitizers import run_sanitized
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.ellipses import (
    LENGTHS,
    STRIDE,
    SUBTILE_HEIGHT,
    SUBTILE_WIDTH,
    TILE,
    Scene,
    drawn_subtiles,
    random_scene,
    reached,
)
from support.sampling import sampled
from torch import Tensor

from gsfw.kernels.cuda.jobs import INT, INT64, POINTER, CountsJob, EmitJob, Grid, TilesJob
from gsfw.kernels.cuda.launcher import Kernel, address
from gsfw.kernels.cuda.sort import radix_sort

C_TYPES = {torch.float32: "float", torch.float64: "double"}
C_KEYS = {torch.int16: "uint16", torch.int32: "uint32"}
IMAGES = [(70, 50), (40, 410), (410, 20), (1, 1), (70, 1), (1, 70)]
"""Width and height; with 410 rows of pixels some splats are counted by a whole warp."""


class ReachJob(ctypes.Structure):
    """Of reach_check.cu."""

    _fields_: ClassVar = [
        ("grid", Grid),
        ("bounded", INT),
        ("stride", INT),
        ("count", INT64),
        ("projected", POINTER),
        ("visible", POINTER),
        ("tile_counts", POINTER),
        ("subtiles", POINTER),
    ]


@dataclass
class Pairs:
    """What binning made of a scene."""

    counts: Tensor
    ends: Tensor
    tiles: Tensor
    payload: Tensor
    rows: Tensor


def reach_of(launcher: EmulatedLauncher, scene: Scene) -> tuple[Tensor, Tensor]:
    """Tile counts [n], and subtiles met [n, tiles], by the functions of reach.h."""
    count, number = len(scene.visible), C_TYPES[scene.projected.dtype]
    counts = torch.full((count,), -1, dtype=torch.int32)
    subtiles = torch.zeros(count, scene.tiles, dtype=torch.int32)
    job = ReachJob(
        scene.grid,
        scene.bounded,
        STRIDE,
        count,
        address(scene.projected),
        address(scene.visible),
        address(counts),
        address(subtiles),
    )
    launcher.launch(Kernel("reach_check.cu", f"count_all<{number}>"), -(-count // 64), 64, job)
    blocks = -(-count * scene.tiles // 64)
    launcher.launch(Kernel("reach_check.cu", f"find_subtiles<{number}>"), blocks, 64, job)
    return counts, subtiles


def bin_pairs(
    launcher: EmulatedLauncher,
    scene: Scene,
    key: torch.dtype = torch.int16,
    numbered: bool = False,
    room: int | None = None,
) -> Pairs:
    """The pairs, in memory that has room for 64 more, which must stay as they are."""
    counts, _ = reach_of(launcher, scene)
    order = scene.order
    ends = counts[order].cumsum(0)
    total = int(ends[-1])
    tiles = torch.full((total + 64,), -1, dtype=key)
    payload, rows = torch.full((2, total + 64), -1, dtype=torch.int32)
    job = EmitJob(
        scene.grid,
        scene.bounded,
        STRIDE,
        address(scene.projected),
        address(order),
        len(order),
        address(counts),
        address(ends),
        address(tiles),
        address(payload),
        address(rows if numbered else None),
        total + 64 if room is None else room,
        numbered,
    )
    kernel = Kernel("bin.cu", f"emit<{C_TYPES[scene.projected.dtype]}, {C_KEYS[key]}>")
    launcher.launch(kernel, -(-len(order) // 256), 256, job)
    last = total if room is None else min(total, room)
    for written in (tiles, payload, rows):
        assert (written[last:] == -1).all()
    return Pairs(counts, ends, tiles[:total], payload[:total], rows[:total])


def tiles_met(scene: Scene, pairs: Pairs) -> NDArray[np.bool_]:
    """[n, tiles]: whether a splat was emitted for a tile; checks places and their order."""
    met = np.zeros((len(scene.visible), scene.tiles), dtype=bool)
    for splat, end in zip(scene.order.tolist(), pairs.ends.tolist(), strict=True):
        own = slice(end - int(pairs.counts[splat]), end)
        tiles = pairs.tiles[own].numpy().astype(np.int64) & 0xFFFF
        assert (np.diff(tiles) > 0).all()
        assert (pairs.payload[own] == splat).all()
        met[splat, tiles] = True
    return met


@pytest.fixture
def launcher() -> EmulatedLauncher:
    return launcher_of(0)


def launcher_of(seed: int) -> EmulatedLauncher:
    return EmulatedLauncher(seed=seed, folders=[Path(__file__).parent])


@pytest.mark.parametrize(
    ("kind", "size", "dtype"),
    sampled(list(product(LENGTHS, IMAGES, C_TYPES)), daily=range(0, 72, 5)),
)
def test_pairs_are_the_tiles_that_an_ellipse_meets(
    launcher: EmulatedLauncher, kind: str, size: tuple[int, int], dtype: torch.dtype
) -> None:
    scene = random_scene(kind, size, dtype)
    met = tiles_met(scene, bin_pairs(launcher, scene))
    _, subtiles = reach_of(launcher, scene)
    assert scene.visible.any()
    for splat in range(len(met)):
        if not scene.visible[splat]:
            assert not met[splat].any()
            continue
        ellipse = scene.projected[splat].double().numpy()
        rendered = drawn_subtiles(scene.grid, ellipse)
        assert met[splat][rendered != 0].all()
        assert (rendered & ~subtiles[splat].numpy() == 0).all()
        assert reached(scene.grid, ellipse, (TILE, TILE))[met[splat]].all()
        said = subtiles[splat].numpy()[:, None] >> np.arange(8) & 1
        assert reached(scene.grid, ellipse, (SUBTILE_WIDTH, SUBTILE_HEIGHT))[said == 1].all()


@pytest.mark.parametrize("count", [1, 31, 33, 300])
@pytest.mark.parametrize("dtype", C_TYPES, ids=str)
def test_tall_and_short_splats_of_a_warp_are_counted_as_they_are_emitted(
    launcher: EmulatedLauncher, dtype: torch.dtype, count: int
) -> None:
    parts = [random_scene(kind, (150, 600), dtype, count, seed=3) for kind in LENGTHS]
    projected = torch.stack([part.projected for part in parts], dim=1).flatten(0, 1)
    visible = torch.stack([part.visible for part in parts], dim=1).flatten()
    mixed = Scene(parts[0].grid, projected, visible)
    met = tiles_met(mixed, bin_pairs(launcher, mixed))
    tile_rows = met.reshape(len(met), mixed.grid.rows, -1).any(2).sum(1)
    if count > 1:
        assert (tile_rows > 8).any()
        assert ((tile_rows > 0) & (tile_rows < 8)).any()
    alone = [tiles_met(part, bin_pairs(launcher, part)) for part in parts]
    assert (met == np.stack(alone, axis=1).reshape(met.shape)).all()


def test_splats_that_are_not_bounded_meet_everything(launcher: EmulatedLauncher) -> None:
    scene = random_scene("small", (70, 50), torch.float32, 45)
    scene.bounded = False
    met = tiles_met(scene, bin_pairs(launcher, scene))
    _, subtiles = reach_of(launcher, scene)
    assert (met == scene.visible.bool().numpy()[:, None]).all()
    assert (subtiles[scene.visible.bool()] == 0xFF).all()


def test_a_scene_that_nobody_sees_has_no_pairs(launcher: EmulatedLauncher) -> None:
    scene = random_scene("round", (70, 50), torch.float32, 40)
    scene.visible.zero_()
    pairs = bin_pairs(launcher, scene)
    assert len(pairs.tiles) == 0
    assert starts_of(launcher, pairs.tiles, scene.tiles).tolist() == [0] * (scene.tiles + 1)


@pytest.mark.parametrize("key", C_KEYS, ids=str)
def test_numbered_pairs_carry_their_own_place(launcher: EmulatedLauncher, key: torch.dtype) -> None:
    scene = random_scene("round", (150, 90), torch.float32)
    plain = bin_pairs(launcher, scene, key)
    numbered = bin_pairs(launcher, scene, key, numbered=True)
    assert torch.equal(numbered.payload, torch.arange(len(plain.tiles), dtype=torch.int32))
    assert torch.equal(numbered.rows, plain.payload)
    assert torch.equal(numbered.tiles, plain.tiles)
    assert (plain.rows == -1).all()


def test_pairs_beyond_their_room_are_left_out(launcher: EmulatedLauncher) -> None:
    scene = random_scene("round", (150, 90), torch.float32)
    whole = bin_pairs(launcher, scene)
    room = len(whole.tiles) // 2
    part = bin_pairs(launcher, scene, room=room)
    assert torch.equal(part.tiles[:room], whole.tiles[:room])
    assert torch.equal(part.payload[:room], whole.payload[:room])


def test_keys_of_both_widths_are_the_same_tiles(launcher: EmulatedLauncher) -> None:
    scene = random_scene("huge", (70, 50), torch.float64)
    narrow = bin_pairs(launcher, scene, torch.int16)
    wide = bin_pairs(launcher, scene, torch.int32)
    assert torch.equal(narrow.tiles.int(), wide.tiles)
    assert torch.equal(narrow.payload, wide.payload)


@pytest.mark.parametrize("kind", ["round", "huge"])
def test_threads_in_any_order_emit_the_same(kind: str) -> None:
    scene = random_scene(kind, (40, 410), torch.float32, 300)
    expected = bin_pairs(launcher_of(0), scene)
    for seed in (1, 2, 3):
        found = bin_pairs(launcher_of(seed), scene)
        assert torch.equal(found.counts, expected.counts)
        assert torch.equal(found.tiles, expected.tiles)
        assert torch.equal(found.payload, expected.payload)


@dataclass
class Starts:
    """What find_tiles wrote."""

    pairs: Tensor
    chunks: Tensor
    chunk_tiles: Tensor


def tiles_of(
    launcher: EmulatedLauncher,
    tiles: Tensor,
    num_tiles: int,
    chunk: int = 4,
    counted: Tensor | None = None,
) -> Starts:
    """By find_tiles, which has room for three more chunks than it is told of."""
    blocks = -(-(num_tiles + 1) // 256)
    pairs, chunks = torch.full((2, num_tiles + 1), -1)
    most = len(tiles) // chunk
    chunk_tiles = torch.full((most + 3,), 7, dtype=torch.int32)
    words = torch.zeros(1 + blocks, dtype=torch.int64)
    job = TilesJob(
        address(tiles),
        len(tiles),
        address(counted),
        num_tiles,
        chunk,
        address(pairs),
        address(chunks),
        address(chunk_tiles),
        most,
        address(words),
        words.data_ptr() + 8,
    )
    launcher.launch(Kernel("bin.cu", f"find_tiles<{C_KEYS[tiles.dtype]}>"), blocks, 256, job)
    assert (chunk_tiles[most:] == 7).all()
    return Starts(pairs, chunks, chunk_tiles[:most])


def starts_of(launcher: EmulatedLauncher, tiles: Tensor, num_tiles: int) -> Tensor:
    """int64 [num_tiles + 1]: the first pair of each tile."""
    return tiles_of(launcher, tiles, num_tiles).pairs


def test_of_more_tiles_than_there_is_a_count_of_the_first_ones_are_found() -> None:
    tiles = torch.tensor([1, 1, 4, 2, 2], dtype=torch.int16)
    for count, expected in ((3, [0, 0, 2, 2, 2, 3]), (0, [0] * 6), (9, [0, 0, 2, 4, 4, 5])):
        counted = torch.tensor(count)
        given = tiles if count < 5 else tiles.sort().values
        assert tiles_of(launcher_of(0), given, 5, counted=counted).pairs.tolist() == expected


@settings(max_examples=30)
@given(st.lists(st.integers(0, 40), max_size=60), st.sampled_from(list(C_KEYS)))
def test_every_tile_begins_where_its_first_pair_is(numbers: list[int], key: torch.dtype) -> None:
    tiles = torch.tensor(sorted(numbers), dtype=key)
    expected = torch.searchsorted(tiles.long(), torch.arange(44))
    assert torch.equal(starts_of(launcher_of(0), tiles, 43), expected)


def test_tiles_count_as_unsigned(launcher: EmulatedLauncher) -> None:
    tiles = torch.tensor([0, 40000, 65534], dtype=torch.int64).to(torch.int16)
    starts = starts_of(launcher, tiles, 65536)
    assert starts[[0, 1, 40000, 40001, 65534, 65535, 65536]].tolist() == [0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
@pytest.mark.parametrize("num_tiles", [1, 255, 256, 257, 3000])
def test_every_tile_has_a_checkpoint_for_each_chunk_but_the_first(
    num_tiles: int, seed: int
) -> None:
    generator = torch.Generator().manual_seed(num_tiles)
    numbers = torch.randint(0, num_tiles, (5000,), generator=generator).sort().values
    launcher = EmulatedLauncher(seed=seed, os_threads=2)
    found = tiles_of(launcher, numbers.to(torch.int16), num_tiles, chunk=3)
    lengths = numbers.bincount(minlength=num_tiles)
    further = (-(-lengths // 3) - 1).clamp(min=0)
    assert torch.equal(found.pairs[1:], lengths.cumsum(0))
    assert torch.equal(found.chunks[1:], further.cumsum(0))
    assert found.pairs[0] == found.chunks[0] == 0
    assert (found.chunk_tiles == -1).all()


def ends_of(launcher: EmulatedLauncher, order: Tensor, counts: Tensor) -> tuple[Tensor, ...]:
    """Ends by place, ends by row, and the number of pairs, by sum_counts."""
    n, blocks = len(order), -(-len(order) // 1024)
    ends, row_ends = torch.full((2, n), -1)
    words = torch.zeros(2 + blocks, dtype=torch.int64)
    place = words.data_ptr()
    job = CountsJob(
        *(address(order), n, address(counts), address(ends), address(row_ends)),
        *(place, place + 8, place + 16),
    )
    launcher.launch(Kernel("bin.cu", "sum_counts<int>"), blocks, 256, job)
    return ends, row_ends, words[0]


@pytest.mark.parametrize("count", [0, 1, 3, 1023, 1024, 1025, 70001])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_pairs_of_splats_end_where_their_counts_add_up_to(count: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(count)
    order = torch.randperm(count, generator=generator, dtype=torch.int32)
    counts = torch.randint(0, 50000, (count,), generator=generator, dtype=torch.int32)
    expected = counts[order].cumsum(0)
    found, by_row, pairs = ends_of(EmulatedLauncher(seed=seed, os_threads=2), order, counts)
    assert torch.equal(found, expected)
    assert torch.equal(by_row[order], expected)
    assert pairs == counts.sum()


def test_sorted_pairs_of_a_tile_are_its_splats_from_front_to_back(
    launcher: EmulatedLauncher,
) -> None:
    scene = random_scene("round", (150, 90), torch.float32, 200)
    pairs = bin_pairs(launcher, scene)
    tiles, rows = radix_sort(launcher, pairs.tiles, pairs.payload, scene.tiles.bit_length())
    starts = starts_of(launcher, tiles, scene.tiles).tolist()
    met = tiles_met(scene, pairs)
    for tile, (begin, end) in enumerate(pairwise(starts)):
        expected = [splat for splat in scene.order.tolist() if met[splat, tile]]
        assert rows[begin:end].tolist() == expected


SANITIZED = """
import sys
from pathlib import Path
import torch
from emulation.launcher import EmulatedLauncher
from emulation.sanitizers import run_sanitized
sys.path.insert(0, {here!r})
from test_bin import bin_pairs, ends_of, random_scene, starts_of
from gsfw.kernels.cuda.sort import radix_sort

launcher = EmulatedLauncher(sanitize=sys.argv[1], folders=[Path({here!r})])
for kind in ("round", "huge", "needle", "outside"):
    for size in ((40, 410), (1, 1)):
        scene = random_scene(kind, size, torch.float32)
        pairs = bin_pairs(launcher, scene, numbered=True)
        tiles, payload = radix_sort(launcher, pairs.tiles, pairs.payload, 13)
        starts_of(launcher, tiles, scene.tiles)
        ends_of(launcher, scene.order, pairs.counts)
        radix_sort(launcher, pairs.rows, None, 32)
"""


@pytest.mark.native("kernels", "core", "rasterizers", "tests/support")
@pytest.mark.slow
@pytest.mark.parametrize("sanitize", ["address", "undefined"])
def test_binning_and_sorting_touch_only_what_they_may(sanitize: str) -> None:
    script = SANITIZED.format(here=str(Path(__file__).parent))
    done = run_sanitized(script, sanitize)
    assert (done.returncode, done.stderr) == (0, "")
