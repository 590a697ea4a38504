"""Sort: a stable radix sort of unsigned keys and what goes along with them.

The kernels are in sources/sort.cu, which says how they work.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import ClassVar

import torch
from jaxtyping import Int32, Shaped
from torch import Tensor

from gsfw.kernels.cuda.jobs import INT, INT64, POINTER
from gsfw.kernels.cuda.launcher import Entry, Kernel, Launcher, address
from gsfw.kernels.cuda.source_files import constant

THREADS = constant("sort_stages.h", "SORT_THREADS")
"""Threads of a block."""

DIGITS = constant("sort_stages.h", "DIGITS")
"""Most values of a digit."""

SORT_PASSES = constant("sort_stages.h", "SORT_PASSES")
COUNT_BLOCKS = constant("sort_stages.h", "COUNT_BLOCKS")

KEY_TYPES = {torch.int16: "uint16", torch.int32: "uint32", torch.int64: "uint64"}
"""Types of the bits of keys in C++."""

KEYS_PER_THREAD = {torch.int16: 8, torch.int32: 8, torch.int64: 4}
"""``KEYS_PER_THREAD`` of sources/sort_stages.h."""

WORD_BYTES = 8
"""Bytes of a word of ``RadixSort.num_words``."""


class DigitField(ctypes.Structure):
    """The digit that one pass sorts by."""

    _fields_: ClassVar = [("shift", INT), ("digits", INT)]


class DigitsJob(ctypes.Structure):
    """Arguments of ``count_digits``."""

    _fields_: ClassVar = [
        ("keys", POINTER),
        ("count", INT64),
        ("counted", POINTER),
        ("fields", DigitField * SORT_PASSES),
        ("passes", INT),
        ("unused", INT),
        ("counts", POINTER),
    ]


class ScatterJob(ctypes.Structure):
    """Arguments of ``scatter``."""

    _fields_: ClassVar = [
        ("keys", POINTER),
        ("payload", POINTER),
        ("count", INT64),
        ("counted", POINTER),
        ("field", DigitField),
        ("pass", INT),
        ("unused", INT),
        ("counts", POINTER),
        ("next", POINTER),
        ("words", POINTER),
        ("sorted_keys", POINTER),
        ("sorted_payload", POINTER),
    ]


@dataclass(frozen=True)
class KeyedRows:
    """Addresses of keys, and of the int32 that goes along with each."""

    keys: int | None
    payload: int | None
    """``None``, before a sort, for the indices of the keys."""


@dataclass(frozen=True)
class RadixSort:
    """A sort by the lowest ``bits`` bits of ``count`` keys; what is equal stays in order."""

    dtype: torch.dtype
    """int16, int32 or int64; the bits of keys count as unsigned numbers."""
    count: int
    bits: int
    """At least 1; each eight of them cost a pass over all keys."""
    counted: int | None = None
    """Address of the number of keys, where only the GPU knows it; ``count`` is the most then."""

    @property
    def num_words(self) -> int:
        """Words that have to be 0 before ``run``: counts, next numbers, and sums of blocks."""
        return (DIGITS + 1) * len(_fields(self.bits)) + DIGITS * self._blocks

    @property
    def _blocks(self) -> int:
        return -(-self.count // (THREADS * KEYS_PER_THREAD[self.dtype]))

    def run(
        self,
        launcher: Launcher,
        given: KeyedRows,
        spare: KeyedRows | None,
        result: KeyedRows,
        words: int,
    ) -> None:
        """Sort ``given`` into ``result``.

        Args:
            launcher: it reaches the memory.
            given: read by the first pass.
            spare: memory that the last pass reads, and every second one before it writes; ``None``
                where one pass is enough.
            result: memory that the last pass writes, and every second one before it.
            words: address of ``num_words`` words of 0.
        """
        count, scatter = sort_kernels(self.dtype)
        fields = _fields(self.bits)
        passes = len(fields)
        every = (DigitField * SORT_PASSES)(*fields)
        blocks = self._blocks
        counting = DigitsJob(given.keys, self.count, self.counted, every, passes, 0, words)
        launcher.launch(count[0], min(blocks, COUNT_BLOCKS), THREADS, counting)
        numbers = words + WORD_BYTES * DIGITS * passes
        for number, field in enumerate(fields):
            target = spare if (passes - number) % 2 == 0 else result
            assert target is not None, "several passes need spare memory"
            job = ScatterJob(
                given.keys,
                given.payload,
                self.count,
                self.counted,
                field,
                number,
                0,
                words + WORD_BYTES * DIGITS * number,
                numbers + WORD_BYTES * number,
                numbers + WORD_BYTES * passes,
                target.keys,
                target.payload,
            )
            launcher.launch(scatter[0], blocks, THREADS, job)
            given = target


@cache
def sort_kernels(keys: torch.dtype) -> tuple[Entry, Entry]:
    """The kernels that sort keys of this type: to count digits, and for each pass."""
    name = KEY_TYPES[keys]
    count, scatter = f"count_digits<{name}>", f"scatter<{name}>"
    return (Kernel("sort.cu", count), DigitsJob), (Kernel("sort.cu", scatter), ScatterJob)


@cache
def _fields(bits: int) -> Sequence[DigitField]:
    """Digits from the lowest to the highest, as equal as can be: few values make long runs."""
    most = DIGITS.bit_length() - 1
    passes = -(-bits // most)
    ends = [bits * number // passes for number in range(passes + 1)]
    return [DigitField(shift, 1 << (end - shift)) for shift, end in pairwise(ends)]


def radix_sort(
    launcher: Launcher,
    keys: Shaped[Tensor, " n"],
    payload: Int32[Tensor, " n"] | None,
    bits: int,
) -> tuple[Shaped[Tensor, " n"], Int32[Tensor, " n"]]:
    """Sort tensors by the lowest ``bits`` bits of the keys; see ``RadixSort``.

    Args:
        launcher: runs the kernels.
        keys: contiguous.
        payload: goes along with the keys, contiguous; their indices if ``None``.
        bits: from 1 to the width of a key.

    Returns:
        Sorted keys and payload; the inputs are not written to.

    Raises:
        ValueError: the keys have another type or not as many bits, an index does not fit the
            payload, or a tensor is not contiguous.
    """
    if keys.dtype not in KEY_TYPES:
        raise ValueError(f"expected keys of int16, int32 or int64, found {keys.dtype}")
    if not 1 <= bits <= 8 * keys.element_size():
        raise ValueError(f"cannot sort {keys.dtype} by {bits} bits")
    if len(keys) > torch.iinfo(torch.int32).max:
        raise ValueError(f"places of {len(keys)} keys do not fit int32")
    sort = RadixSort(keys.dtype, len(keys), bits)
    places = torch.empty(2, len(keys), dtype=torch.int32, device=keys.device)
    found = keys.new_empty(2, len(keys))
    words = torch.zeros(sort.num_words, dtype=torch.int64, device=keys.device)
    spare, result = (
        KeyedRows(address(some), address(along)) for some, along in zip(found, places, strict=True)
    )
    given = KeyedRows(address(keys), address(payload))
    sort.run(launcher, given, spare, result, words.data_ptr())
    return found[1], places[1]
