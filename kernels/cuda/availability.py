"""Availability: whether CUDA kernels can be used on this machine, and why not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from gsfw.kernels.cuda.errors import CudaError

if TYPE_CHECKING:
    from gsfw.kernels.cuda.driver import Driver
    from gsfw.kernels.cuda.nvrtc import Nvrtc

GET_TORCH = "Install a build of torch with CUDA: https://pytorch.org/get-started/locally."


@dataclass(frozen=True)
class CudaSystem:
    """Compiler, driver and targets of CUDA kernels."""

    nvrtc: Nvrtc
    driver: Driver
    targets: tuple[str, ...]
    """Compilation target of each device, such as "sm_90"; devices that are too old are left out."""
    devices: tuple[int, ...]
    """The numbers of these devices."""


def cuda_system() -> CudaSystem:
    """The parts that CUDA kernels need.

    Raises:
        CudaError: one is missing or too old.
    """
    import torch

    from gsfw.kernels.cuda.architecture import choose_target
    from gsfw.kernels.cuda.driver import Driver
    from gsfw.kernels.cuda.nvrtc_library import find_nvrtc

    if torch.version.cuda is None:
        kind = "a ROCm build" if torch.version.hip else "a CPU build"
        raise CudaError(f"torch {torch.__version__} is {kind}, without CUDA.", GET_TORCH)
    driver = Driver()
    nvrtc = find_nvrtc(torch.version.cuda)
    driver.require(nvrtc.version)
    count = torch.cuda.device_count()
    if not torch.cuda.is_available() or count == 0:
        raise CudaError(
            f"torch {torch.__version__}, built for CUDA {torch.version.cuda}, cannot use the GPU.",
            "python -c 'import torch; torch.zeros(1).cuda()' says why.",
        )
    targets, refusals = dict[int, str](), []
    for index in range(count):
        major, minor = torch.cuda.get_device_capability(index)
        try:
            targets[index] = choose_target(10 * major + minor, nvrtc.architectures).name
        except CudaError as error:
            refusals.append(error)
    if not targets:
        raise refusals[0]
    return CudaSystem(nvrtc, driver, tuple(targets.values()), tuple(targets))


@lru_cache(maxsize=1)
def unavailable() -> str:
    """The reason why CUDA kernels cannot be used here, and the remedy; empty if they can."""
    try:
        cuda_system()
    except ImportError as error:
        return f"torch does not load: {error}"
    except CudaError as error:
        return str(error).replace("\n", " ")
    return ""
