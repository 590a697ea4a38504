"""The radix sort, on the emulation, against torch's."""

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from gsfw.kernels.cuda.sort import KEY_TYPES, KEYS_PER_THREAD, THREADS, radix_sort

SIZES = [0, 1, 31, 2047, 2048, 2049, 50001]

WIDTHS = {torch.int16: 16, torch.int32: 32, torch.int64: 64}


def random_keys(count: int, dtype: torch.dtype, seed: int = 0) -> Tensor:
    """Keys of all bit patterns."""
    generator = torch.Generator().manual_seed(seed)
    limits = torch.iinfo(dtype)
    keys = torch.randint(limits.min, limits.max, (count,), generator=generator, dtype=torch.int64)
    return keys.to(dtype)


def order_of(keys: Tensor, bits: int) -> Tensor:
    """The stable order by the lowest bits, which torch knows for signed numbers only."""
    low = keys.long() & ((1 << bits) - 1 if bits < 64 else -1)
    if bits == 64:
        low = low ^ torch.iinfo(torch.int64).min
    return low.sort(stable=True).indices


def check(launcher: EmulatedLauncher, keys: Tensor, bits: int) -> None:
    before, order = keys.clone(), order_of(keys, bits)
    payload = torch.arange(len(keys), dtype=torch.int32) * 3 - 7
    for given_payload in (None, payload):
        sorted_keys, sorted_payload = radix_sort(launcher, keys, given_payload, bits)
        expected = order.int() if given_payload is None else payload[order]
        assert torch.equal(sorted_keys, before[order])
        assert torch.equal(sorted_payload, expected)
        assert sorted_payload.dtype == torch.int32
    assert torch.equal(keys, before)


@pytest.mark.parametrize("dtype", KEY_TYPES, ids=str)
@pytest.mark.parametrize("size", SIZES)
def test_keys_of_every_width_are_sorted_as_torch_sorts_them(size: int, dtype: torch.dtype) -> None:
    check(EmulatedLauncher(), random_keys(size, dtype), WIDTHS[dtype])


@pytest.mark.parametrize("dtype", KEY_TYPES, ids=str)
def test_a_block_that_is_just_full_and_one_key_more_are_sorted(dtype: torch.dtype) -> None:
    block = THREADS * KEYS_PER_THREAD[dtype]
    for size in (block - 1, block, block + 1):
        check(EmulatedLauncher(), random_keys(size, dtype), 8)


def test_equal_keys_stay_in_order() -> None:
    for key in (0, 1, -1):
        check(EmulatedLauncher(), torch.full((5000,), key, dtype=torch.int16), 16)


def test_few_different_keys_stay_in_order() -> None:
    check(EmulatedLauncher(), random_keys(5000, torch.int32) & 0x0101, 32)


@pytest.mark.parametrize("bits", [1, 7, 8, 9, 13, 16])
def test_bits_above_those_asked_for_do_not_count(bits: int) -> None:
    check(EmulatedLauncher(), random_keys(3000, torch.int16), bits)


def test_keys_of_64_bits_count_as_unsigned() -> None:
    keys = torch.tensor([-1, 0, 1, -(2**63), 2**63 - 1, 2**40, -1, 0])
    check(EmulatedLauncher(), keys, 64)


def test_threads_and_blocks_in_any_order_give_the_same() -> None:
    keys = random_keys(9000, torch.int32)
    for seed in (1, 2, 3):
        check(EmulatedLauncher(seed=seed, os_threads=2), keys, 16)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 2**16 - 1), max_size=80), st.integers(1, 16), st.integers(0, 5))
def test_any_short_list_is_sorted(numbers: list[int], bits: int, seed: int) -> None:
    keys = torch.tensor(numbers, dtype=torch.int64).to(torch.int16)
    check(EmulatedLauncher(seed=seed), keys, bits)


def test_keys_of_another_type_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected keys of int16, int32 or int64, found torch\.f"):
        radix_sort(EmulatedLauncher(), torch.zeros(3), None, 8)


def test_no_bits_and_more_than_a_key_has_are_refused() -> None:
    keys = torch.zeros(3, dtype=torch.int16)
    for bits in (0, 17):
        with pytest.raises(ValueError, match=rf"cannot sort torch\.int16 by {bits} bits"):
            radix_sort(EmulatedLauncher(), keys, None, bits)


def test_keys_that_are_not_contiguous_are_refused() -> None:
    with pytest.raises(ValueError, match="expected a contiguous tensor, found strides"):
        radix_sort(EmulatedLauncher(), torch.zeros(6, dtype=torch.int16)[::2], None, 8)
