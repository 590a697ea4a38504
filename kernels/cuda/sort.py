"""Sort: a stable radix sort of unsigned keys and what goes along with them.

The kernels are in sources/sort.cu, which says how they work.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import ClassVar

import torch
from jaxtyping import Int32, Shaped
from torch import Tensor

from gsfw.kernels.cuda.jobs import INT, INT64, POINTER
from gsfw.kernels.cuda.launcher import Entry, Kernel, Launcher, address
from gsfw.kernels.cuda.source_files import constant

THREADS = constant("sort_stages.h", "SORT_THREADS")
"""Threads of a block."""

MOST_DIGIT_BITS = constant("sort_stages.h", "DIGITS").bit_length() - 1
"""Most bits of a digit."""

KEY_TYPES = {torch.int16: "uint16", torch.int32: "uint32", torch.int64: "uint64"}
"""Types of the bits of keys in C++."""

KEYS_PER_THREAD = {torch.int16: 8, torch.int32: 8, torch.int64: 4}
"""``KEYS_PER_THREAD`` of sources/sort_stages.h."""


class DigitField(ctypes.Structure):
    """The digit that one pass sorts by."""

    _fields_: ClassVar = [("shift", INT), ("digits", INT)]


class DigitsJob(ctypes.Structure):
    """Arguments of ``count_digits``."""

    _fields_: ClassVar = [
        ("keys", POINTER),
        ("count", INT64),
        ("field", DigitField),
        ("counts", POINTER),
    ]


class ScatterJob(ctypes.Structure):
    """Arguments of ``scatter``."""

    _fields_: ClassVar = [
        ("keys", POINTER),
        ("payload", POINTER),
        ("count", INT64),
        ("field", DigitField),
        ("ends", POINTER),
        ("sorted_keys", POINTER),
        ("sorted_payload", POINTER),
    ]


def sort_kernels(keys: torch.dtype) -> list[Entry]:
    """The kernels that sort keys of this type."""
    return [(_count_digits(keys), DigitsJob), (_scatter(keys), ScatterJob)]


def _count_digits(keys: torch.dtype) -> Kernel:
    return Kernel("sort.cu", f"count_digits<{KEY_TYPES[keys]}>")


def _scatter(keys: torch.dtype) -> Kernel:
    return Kernel("sort.cu", f"scatter<{KEY_TYPES[keys]}>")


def radix_sort(
    launcher: Launcher,
    keys: Shaped[Tensor, " n"],
    payload: Int32[Tensor, " n"] | None,
    bits: int,
) -> tuple[Shaped[Tensor, " n"], Int32[Tensor, " n"]]:
    """Sort by the lowest ``bits`` bits of the keys; what is equal stays in order.

    Args:
        launcher: runs the kernels where the tensors are.
        keys: int16, int32 or int64, contiguous; their bits count as unsigned numbers.
        payload: goes along with the keys, contiguous; their indices if ``None``.
        bits: from 0 to the width of a key; each eight of them cost a pass over all keys.

    Returns:
        Sorted keys and payload; the inputs are not written to, and with 0 bits they are returned.

    Raises:
        ValueError: the keys have another type or not as many bits, an index does not fit the
            payload, or a tensor is not contiguous.
    """
    if keys.dtype not in KEY_TYPES:
        raise ValueError(f"expected keys of int16, int32 or int64, found {keys.dtype}")
    if not 0 <= bits <= 8 * keys.element_size():
        raise ValueError(f"cannot sort {keys.dtype} by {bits} bits")
    if payload is None and len(keys) > torch.iinfo(torch.int32).max:
        raise ValueError(f"indices of {len(keys)} keys do not fit int32")
    for field in _fields(bits):
        keys, payload = _sort_by_digit(launcher, keys, payload, field)
    if payload is None:
        payload = torch.arange(len(keys), dtype=torch.int32, device=keys.device)
    return keys, payload


def _fields(bits: int) -> Iterator[DigitField]:
    """Digits from the lowest to the highest, as equal as can be: few values make long runs."""
    passes = -(-bits // MOST_DIGIT_BITS)
    for number in range(passes):
        shift, end = bits * number // passes, bits * (number + 1) // passes
        yield DigitField(shift, 1 << (end - shift))


def _sort_by_digit(
    launcher: Launcher, keys: Tensor, payload: Tensor | None, field: DigitField
) -> tuple[Tensor, Tensor]:
    device = keys.device
    blocks = -(-len(keys) // (THREADS * KEYS_PER_THREAD[keys.dtype]))
    counts = torch.empty(field.digits * blocks, dtype=torch.int64, device=device)
    counting = DigitsJob(address(keys), len(keys), field, address(counts))
    launcher.launch(_count_digits(keys.dtype), blocks, THREADS, counting)
    ends = counts.cumsum(0)
    sorted_keys = torch.empty_like(keys)
    sorted_payload = torch.empty(len(keys), dtype=torch.int32, device=device)
    scattering = ScatterJob(
        address(keys),
        address(payload),
        len(keys),
        field,
        address(ends),
        address(sorted_keys),
        address(sorted_payload),
    )
    launcher.launch(_scatter(keys.dtype), blocks, THREADS, scattering)
    return sorted_keys, sorted_payload
