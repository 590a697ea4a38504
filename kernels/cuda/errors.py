"""Errors between Python and a GPU."""

from __future__ import annotations

from gsfw.core.errors import UnavailableError


class CudaError(UnavailableError):
    """CUDA kernels cannot be compiled, loaded or started on this machine, and why."""
