"""The emulation of CUDA: what it computes, what it finds out, and what it says then."""

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from emulation import launcher as emulated_launcher
from emulation.launcher import EmulatedLauncher, EmulationError
from support.native_programs import EMULATOR, compile_source, compiler, cross_compiler, run_program
from torch import Tensor

from gsfw.kernels.cuda.launcher import Kernel, address

EMULATION = Path(emulated_launcher.__file__).parent
KERNELS = EMULATION / "kernels"

THREADS = 128
BLOCKS = 3
COUNT = BLOCKS * THREADS
WARP = 32

SEEDS = (0, 1, 2, 3, 12345, 2**63)

NUMBERS = {
    "float": torch.float32,
    "double": torch.float64,
    "int": torch.int32,
    "int64": torch.int64,
}


class ArrayJob(ctypes.Structure):
    """Of every kernel here, see emulation/kernels/arrays.h."""

    _fields_: ClassVar = [
        ("count", ctypes.c_int64),
        ("input", ctypes.c_void_p),
        ("output", ctypes.c_void_p),
    ]


def launcher(seed: int = 0, os_threads: int = 1) -> EmulatedLauncher:
    return EmulatedLauncher(seed, os_threads, folders=[KERNELS])


def run(
    kernel: str,
    source: Tensor,
    output: Tensor,
    count: int = COUNT,
    seed: int = 0,
    os_threads: int = 1,
    blocks: int = BLOCKS,
) -> Tensor:
    """``output``, to which ``kernel``, such as "memory.cu: combine", has written."""
    file, expression = kernel.split(": ")
    job = ArrayJob(count, address(source), address(output))
    launcher(seed, os_threads).launch(Kernel(file, expression), blocks, THREADS, job)
    return output


def numbers(dtype: torch.dtype = torch.int32, low: int = 0, high: int = 1000) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.randint(low, high, (COUNT,), generator=generator).to(dtype)


@pytest.mark.parametrize("name", NUMBERS)
def test_lanes_exchange_numbers_as_cuda_defines(name: str) -> None:
    dtype = NUMBERS[name]
    values = numbers(dtype)
    found = run(f"collectives.cu: exchange<{name}>", values, torch.zeros(COUNT, 6, dtype=dtype))
    warps, lane = values.reshape(-1, WARP), torch.arange(WARP)
    expected = [
        warps.gather(1, warps.long() % WARP),
        warps[:, 5:6].expand_as(warps),
        warps[:, torch.where(lane < 3, lane, lane - 3)],
        warps[:, torch.where(lane + 7 < WARP, lane + 7, lane)],
        warps[:, lane ^ 9],
        warps.sum(1, keepdim=True, dtype=dtype).expand_as(warps),
    ]
    for column, values_expected in enumerate(expected):
        assert torch.equal(found[:, column].reshape(-1, WARP), values_expected), column


def votes(values: Tensor, group: int) -> Tensor:
    """[groups, group]: how many are not zero, whether any and whether all, of each group."""
    true = values.reshape(-1, group) != 0
    columns = torch.stack([true.sum(1), true.any(1), true.all(1)], 1).int()
    return columns.repeat_interleave(group, 0)


@pytest.mark.parametrize("kind", ["some", "none", "all"])
def test_warps_vote_and_blocks_count_as_cuda_defines(kind: str) -> None:
    values = {"some": numbers(high=2), "none": numbers(high=1), "all": numbers(low=1)}[kind]
    counts = run("collectives.cu: count", values, torch.zeros(COUNT, 3, dtype=torch.int32))
    assert torch.equal(counts, votes(values, THREADS))
    found = run("collectives.cu: vote", values, torch.zeros(COUNT, 3, dtype=torch.int32))
    assert torch.equal(found[:, 1:], votes(values, WARP)[:, 1:])
    bits = (values != 0).reshape(-1, WARP).long() << torch.arange(WARP)
    ballots = bits.sum(1).repeat_interleave(WARP)
    assert torch.equal(found[:, 0].long() & 0xFFFFFFFF, ballots)


def test_bits_are_counted_as_cuda_defines() -> None:
    values = torch.randint(0, 2**32, (COUNT,), generator=torch.Generator().manual_seed(1))
    values[:4] = torch.tensor([0, 1, 2**31, 2**32 - 1])
    found = run(
        "memory.cu: count_bits",
        values.to(torch.uint32).view(torch.int32),
        torch.zeros(COUNT, 4, dtype=torch.int32),
    )
    for value, row in zip(values.tolist(), found.tolist(), strict=True):
        text = f"{value:032b}"
        first = (value & -value).bit_length()
        leading = 32 - value.bit_length()
        row[3] %= 2**32
        assert row == [text.count("1"), first, leading, int(text[::-1], 2)]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("os_threads", [1, 2])
def test_blocks_sum_alike_in_any_order(seed: int, os_threads: int) -> None:
    values = torch.randn(COUNT, generator=torch.Generator().manual_seed(1))
    arguments = ("collectives.cu: block_sums<float>", values[:-50].contiguous())
    found = run(*arguments, torch.zeros(BLOCKS), COUNT - 50, seed, os_threads)
    values[-50:] = 0.0
    assert torch.allclose(found, values.reshape(BLOCKS, -1).sum(1), atol=1e-5)
    assert torch.equal(found, run(*arguments, torch.zeros(BLOCKS), COUNT - 50))


@pytest.mark.parametrize("name", [*NUMBERS, "uint32", "uint64"])
@pytest.mark.parametrize("os_threads", [1, 2])
def test_atomics_change_memory_in_one_step(name: str, os_threads: int) -> None:
    dtype = NUMBERS.get(name, torch.int64 if name == "uint64" else torch.int32)
    values = numbers(dtype, 1, 1000)
    result = torch.tensor([0, 0, 0, 5000, 0], dtype=dtype)
    found = run(f"memory.cu: gather<{name}>", values, result, seed=7, os_threads=os_threads)
    sum_of_all = values.sum(dtype=dtype)
    expected = torch.stack([sum_of_all, sum_of_all, values.max(), values.min(), found[4]])
    assert torch.equal(found, expected)
    assert found[4] == 2


def test_atomics_combine_bits() -> None:
    values = numbers(high=2**20) | 4
    found = run("memory.cu: combine", values, torch.tensor([0, -1, 0], dtype=torch.int32))
    expected = [0, -1, 0]
    for value in values.tolist():
        expected = [expected[0] | value, expected[1] & value, expected[2] ^ value]
    assert found.tolist() == expected


def test_indices_have_64_bits() -> None:
    stride = 2**33 + 1
    found = run("memory.cu: far_apart", torch.zeros(1), torch.zeros(COUNT).long(), stride)
    rows = torch.arange(BLOCKS).reshape(-1, 1) * stride + torch.arange(THREADS)
    assert torch.equal(found.reshape(BLOCKS, THREADS), rows)


def test_vectors_are_read_as_wholes() -> None:
    values = torch.arange(4.0 * COUNT)
    found = run("memory.cu: copy_fours", values, torch.zeros(COUNT, 4), count=0)
    assert torch.equal(found, values.reshape(-1, 4).flip(1))


@pytest.mark.parametrize("name", ["float", "double"])
def test_shared_memory_is_not_a_number_at_the_start_of_each_block(name: str) -> None:
    dtype = NUMBERS[name]
    found = run(f"memory.cu: leftovers<{name}>", torch.zeros(1), torch.zeros(COUNT, dtype=dtype))
    assert bool(found.isnan().all())


def wrong_seeds(kernel: str, right: Callable[[Tensor], Tensor], **options: Any) -> list[int]:
    """Seeds with which ``kernel`` gives something else than is ``right``."""
    values = numbers()
    expected = right(values)
    results = {
        seed: run(kernel, values, torch.zeros(COUNT, dtype=torch.int32), seed=seed, **options)
        for seed in range(12)
    }
    return [seed for seed, found in results.items() if not torch.equal(found, expected)]


def reversed_blocks(values: Tensor) -> Tensor:
    return values.reshape(-1, THREADS).flip(1).reshape(-1)


def test_a_missing_barrier_of_the_block_is_found() -> None:
    assert wrong_seeds("collectives.cu: reverse<true>", reversed_blocks) == []
    assert len(wrong_seeds("collectives.cu: reverse<false>", reversed_blocks)) == 12


def test_a_missing_barrier_of_the_warp_is_found() -> None:
    def rotated(values: Tensor) -> Tensor:
        return values.reshape(-1, WARP).roll(-5, 1).reshape(-1)

    assert wrong_seeds("collectives.cu: rotate<true>", rotated, count=5) == []
    assert len(wrong_seeds("collectives.cu: rotate<false>", rotated, count=5)) >= 11


def test_a_seed_repeats_itself_and_differs_from_others() -> None:
    values = torch.randn(COUNT, generator=torch.Generator().manual_seed(1))

    def total(seed: int) -> float:
        found = run("memory.cu: add_in_any_order", values, torch.zeros(1), seed=seed)
        return float(found)

    totals = [total(seed) for seed in range(8)]
    assert totals == [total(seed) for seed in range(8)]
    assert len(set(totals)) > 2


FAULTS = [
    (
        "early_return",
        20,
        "block 0: a deadlock: threads 20-31, 52-63, 84-95, 116-127 have returned; "
        "threads 0-19, 32-51, 64-83, 96-115 wait at __shfl_xor_sync",
    ),
    (
        "divergent_barrier",
        40,
        "block 0: a deadlock: threads 64-127 have returned; "
        "threads 0-39 wait at __syncthreads; threads 40-63 wait at __syncwarp",
    ),
    (
        "different_collectives",
        0,
        "block 0: lanes of one warp meet at __ballot_sync and __shfl_sync",
    ),
    (
        "different_barriers",
        64,
        "block 0: threads of the block meet at __syncthreads and __syncthreads_count",
    ),
    ("half_warp", 0, "block 0: a collective has another mask than that of the full warp"),
    ("large_frame", 120 * 1024, "block 0: a thread has overrun its stack"),
]


@pytest.mark.parametrize(("name", "count", "message"), FAULTS, ids=[name for name, *_ in FAULTS])
def test_a_fault_is_found_and_explained(name: str, count: int, message: str) -> None:
    output = torch.zeros(COUNT, dtype=torch.int32)
    with pytest.raises(EmulationError) as failure:
        run(f"faults.cu: {name}", torch.zeros(1), output, count)
    assert str(failure.value) == (
        f"{name} of faults.cu, {BLOCKS} blocks of {THREADS} threads, seed 0: {message}"
    )


@pytest.mark.parametrize("os_threads", [1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_deadlock_is_found_in_any_order_and_leaves_nothing_behind(
    seed: int, os_threads: int
) -> None:
    output = torch.zeros(COUNT, dtype=torch.int32)
    with pytest.raises(EmulationError, match=r"a deadlock: threads .* wait at __shfl_xor_sync"):
        run("faults.cu: early_return", torch.zeros(1), output, 20, seed, os_threads)
    run("faults.cu: early_return", torch.zeros(1), output, 32, seed, os_threads)
    assert torch.equal(output, torch.ones_like(output))


def test_no_blocks_are_nothing_to_do() -> None:
    run("memory.cu: there_is_no_such_kernel", torch.zeros(1), torch.zeros(1), blocks=0)


def test_a_kernel_that_does_not_compile_says_why() -> None:
    with pytest.raises(EmulationError, match=r"does not compile:(.|\n)*there_is_no_such_kernel"):
        run("memory.cu: there_is_no_such_kernel", torch.zeros(1), torch.zeros(1))


def test_a_missing_source_says_where_it_was_looked_for() -> None:
    with pytest.raises(EmulationError, match=r"no nothing\.cu in any of .*kernels/cuda/sources"):
        run("nothing.cu: nothing", torch.zeros(1), torch.zeros(1))


def test_a_job_that_is_not_the_kernels_names_the_field() -> None:
    Swapped = type("ArrayJob", (ctypes.Structure,), {"_fields_": ArrayJob._fields_[::-1]})
    with pytest.raises(EmulationError, match=r"static assertion failed: ArrayJob\.output"):
        launcher().launch(Kernel("memory.cu", "combine"), 1, THREADS, Swapped())


def test_blocks_keep_to_their_launch_bounds() -> None:
    with pytest.raises(EmulationError) as failure:
        launcher().launch(Kernel("memory.cu", "combine"), 1, THREADS + WARP, ArrayJob())
    assert str(failure.value) == (
        "combine of memory.cu has __launch_bounds__(128), found blocks of 160 threads"
    )
    with pytest.raises(ValueError, match="cannot run 1 blocks of 1056 threads"):
        launcher().launch(Kernel("memory.cu", "combine"), 1, 1056, ArrayJob())


def test_what_is_compiled_stays_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    kernels = [
        (Kernel("memory.cu", "combine"), ArrayJob),
        (Kernel("memory.cu", "far_apart"), ArrayJob),
    ]
    launcher().prepare(kernels)

    def refuse(*_arguments: Any, **_options: Any) -> None:
        pytest.fail("compiled again")

    version = emulated_launcher._version(launcher()._compilation.command[0])
    monkeypatch.setattr(emulated_launcher, "_version", lambda _command: version)
    monkeypatch.setattr(subprocess, "run", refuse)
    launcher().prepare(kernels)


@pytest.mark.slow
@pytest.mark.parametrize(
    "machine", ["this", *(pytest.param(name, marks=pytest.mark.slow) for name in ("any", "arm"))]
)
def test_fibers_switch_by_hand_and_by_the_system(machine: str, tmp_path: Path) -> None:
    command = cross_compiler() if machine == "arm" else compiler()
    folders = [EMULATION, KERNELS, emulated_launcher.SOURCES]
    flags = ["-O1", *(f"-I{folder}" for folder in folders)]
    flags += {"this": [], "any": ["-DEMULATION_UCONTEXT"], "arm": ["-static"]}[machine]
    others = [EMULATION / "runtime.cpp", EMULATION / "fiber.cpp"]
    source = EMULATION / "fibers_check.cpp"
    check = compile_source(command, source, tmp_path / "check", flags, others)
    run_program([*([EMULATOR] if machine == "arm" else []), str(check)])
