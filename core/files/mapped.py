"""Mapped tensors: memory that the system may write to a file and take back when it is short."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from gsfw.core.files.atomic import readable_write_errors

ZEROS = bytes(1 << 20)


def mapped_tensor(folder: Path, shape: Sequence[int], dtype: torch.dtype) -> Tensor:
    """A new tensor on the CPU in a file without a name, which ends with the tensor.

    On Windows, where a file in use keeps its name, it is in plain memory.

    Args:
        folder: that has room for it.
        shape: of the tensor.
        dtype: of the tensor.

    Raises:
        OutputError: the disk is full, or the folder is not writable.
    """
    size = math.prod(shape)
    if os.name == "nt" or not size:
        return torch.zeros(*shape, dtype=dtype)
    with readable_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder, prefix=".rows.")
        try:
            with os.fdopen(handle, "wb") as file:
                _reserve(file.fileno(), size * dtype.itemsize)
            values = torch.from_file(name, shared=True, size=size, dtype=dtype)
        finally:
            os.unlink(name)
    return values.view(*shape)


def _reserve(file: int, num_bytes: int) -> None:
    """Take room on the disk now: a full disk would end the program when the memory is written."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, num_bytes)
        return
    for start in range(0, num_bytes, len(ZEROS)):
        os.write(file, ZEROS[: num_bytes - start])
