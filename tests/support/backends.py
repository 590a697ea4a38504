"""The rasterizers, by name, as tests ask them for images on the CPU."""

from collections.abc import Callable

import pytest
import torch
from emulation.launcher import EmulatedLauncher

from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers import gsfw_rasterizers
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from support.native_programs import compiler
from support.on_cuda import OnCuda

SPECS = {spec.name: spec for spec in gsfw_rasterizers()}
"""Every backend of ours, by name."""

EMULATED = "cuda, emulated"

CUDA = ("cuda", "cuda, deterministic") if torch.cuda.is_available() else ()
"""None elsewhere: seven hundred skipped tests would say no more than one does."""


def on_the_cpu(name: str) -> Rasterizer:
    """The backend with its defaults."""
    config = SPECS[name].load()()
    unavailable = config.capabilities().unavailable
    if unavailable:
        pytest.skip(unavailable)
    return config.build(torch.device("cpu"))


def on_cuda(**settings: bool) -> Rasterizer:
    """The CUDA backend on a GPU; it gets tensors on the CPU and gives such back."""
    config = SPECS["cuda"].load()(**settings)
    unavailable = config.capabilities().unavailable
    if unavailable:
        pytest.skip(unavailable)
    return OnCuda(config.build(torch.device("cuda")))


def emulated() -> Rasterizer:
    """The CUDA kernels on the emulation, with threads in scrambled order.

    Its deterministic mode is held to this one in cuda/test_rasterizer.py.
    """
    compiler()
    return CudaRasterizer(EmulatedLauncher(seed=1))


BACKENDS: dict[str, Callable[[], Rasterizer]] = {
    "reference": lambda: on_the_cpu("reference"),
    "cpu": lambda: on_the_cpu("cpu"),
    EMULATED: emulated,
    "cuda": on_cuda,
    "cuda, deterministic": lambda: on_cuda(deterministic=True),
}
"""How each is built here; ``gsplat`` has tests of its own, since it draws with other numbers."""

NAMES = ["cpu", EMULATED, *(pytest.param(name, marks=pytest.mark.cuda) for name in CUDA)]
"""Those that are measured against the reference."""
