"""The rasterizers, by name, as tests ask them for images on the CPU."""

from collections.abc import Callable, Container, Sequence
from typing import Any

import pytest
import torch
from _pytest.mark import ParameterSet
from emulation.launcher import EmulatedLauncher

from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers import gsfw_rasterizers
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from support.native_programs import compiler
from support.on_cuda import OnCuda
from support.sampling import sampled

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


def emulated_sample(cases: Sequence[tuple[Any, ...]], daily: Container[int]) -> list[ParameterSet]:
    """Every case for every backend; a sample of them on the emulation, which is slow.

    Args:
        cases: values of the test's parameters other than the backend, which comes first.
        daily: places of the cases that the emulation takes in plain ``pytest``.
    """
    return [
        *(pytest.param("cpu", *case) for case in cases),
        *sampled([(EMULATED, *case) for case in cases], daily),
        *(pytest.param(name, *case, marks=pytest.mark.cuda) for name in CUDA for case in cases),
    ]
