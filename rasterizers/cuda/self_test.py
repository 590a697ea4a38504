"""Self-test: sorts, an image and its gradient on one GPU, held to torch and to the reference.

It finds what only the machine itself can show: a driver or a compiler that makes other code than
the tests have seen, a GPU with faulty memory. It takes seconds, and draws from no generator but its
own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.errors import UserError
from gsfw.core.progress import stage
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.kernels.cuda.launcher import Launcher
from gsfw.kernels.cuda.sort import radix_sort
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SORT_SIZES = (0, 1, 4095, 4097, 1_000_000)
"""Numbers of keys: none, one, hardly fewer and hardly more than a block sorts, and many."""

SPLATS, WIDTH, HEIGHT, SH_DEGREE = 600, 100, 60, 3
"""A scene of several chunks in a tile, whose image ends within tiles; the usual degree."""

IMAGE_BOUND = 1e-4
"""Mean distance of pixels from the reference, in [0, 1].

Float32 is as near as 1e-7. A splat that a rounding moves across a cut-off changes a pixel by 1/255
at most, and there are few: measured on the emulation, the distance is below 1e-6."""

GRADIENT_BOUND = 1e-2
"""Relative distance of a gradient (L2) from the reference; ordinary scenes keep 1e-3."""


@dataclass(frozen=True)
class SelfTest:
    """The result of a self-test."""

    seconds: float
    """Time that it took, the compilation of kernels at first use included."""
    fault: str = ""
    """The clause that says what differs and by how much; empty if all is right."""

    def __str__(self) -> str:
        if self.fault:
            return self.fault
        return f"passed in {self.seconds:.1f} s: sorting, an image and its gradient are right"


def self_test(
    launcher: Launcher, device: torch.device, sort_sizes: Sequence[int] = SORT_SIZES
) -> SelfTest:
    """Test the kernels of a launcher on the memory of a device; stops at the first fault.

    Raises:
        torch.OutOfMemoryError: there is no room for it, which is no fault.
    """
    began = time.perf_counter()
    # Whatever torch.set_default_device says, the expected results are those of the CPU.
    with stage(f"testing the CUDA kernels on {device}"), torch.device("cpu"):
        fault = _first_fault(launcher, device, sort_sizes)
    return SelfTest(time.perf_counter() - began, fault)


def _first_fault(launcher: Launcher, device: torch.device, sort_sizes: Sequence[int]) -> str:
    try:
        for faults in (
            _sort_faults(launcher, device, sort_sizes),
            _render_faults(launcher, device),
        ):
            if fault := next(faults, ""):
                return fault
    except torch.OutOfMemoryError:
        raise
    except UserError as error:  # Kernels that do not compile, load or start.
        return " ".join(str(error).split())
    except RuntimeError as error:  # torch's, for what a kernel has done to the GPU.
        return f"it ended in {type(error).__name__}: {str(error).splitlines()[0]}"
    return ""


def _sort_faults(launcher: Launcher, device: torch.device, sizes: Sequence[int]) -> Iterator[str]:
    generator = torch.Generator().manual_seed(0)
    for dtype in (torch.int32, torch.int16):  # Those of depths, and of tiles.
        bits = torch.iinfo(dtype).bits
        for size in sizes:
            # Few different numbers, which reach all bits: equal keys have to keep their order.
            numbers = 65521 * torch.randint(2**16, (size,), generator=generator) % 2**bits
            signed = torch.where(numbers < 2 ** (bits - 1), numbers, numbers - 2**bits).to(dtype)
            expected, order = numbers.sort(stable=True)
            keys, payload = radix_sort(launcher, signed.to(device), None, bits)
            wrong = (payload.cpu() != order) | (keys.cpu().long() % 2**bits != expected)
            if count := int(wrong.sum()):
                first = int(wrong.nonzero()[0])
                yield (
                    f"a radix sort of {size} keys of {bits} bits has {count} of them in a wrong "
                    f"place, the first one at {first}"
                )


def _render_faults(launcher: Launcher, device: torch.device) -> Iterator[str]:
    expected = _drawn(ReferenceRasterizer(), torch.device("cpu"), torch.float64)
    found = _drawn(CudaRasterizer(launcher), device, torch.float32)
    image, true_image = found.pop("image"), expected.pop("image")
    distance = (image - true_image).abs().mean().item()
    if not distance <= IMAGE_BOUND:  # Also where it is not a number.
        yield (
            f"an image of {WIDTH}x{HEIGHT} pixels differs from the reference's by {distance:.2g} "
            f"in the mean, where {IMAGE_BOUND:g} are allowed"
        )
    for name, true in expected.items():
        distance = ((found[name] - true).norm() / true.norm()).item()
        if not distance <= GRADIENT_BOUND:
            yield (
                f"the gradient by {name} differs from the reference's by {distance:.2g} of its "
                f"length, where {GRADIENT_BOUND:g} are allowed"
            )


def _drawn(rasterizer: Rasterizer, device: torch.device, dtype: torch.dtype) -> dict[str, Tensor]:
    """The image of the scene, and the gradient by each tensor; on the CPU, in float64."""
    splats, cameras = _scene()
    with torch.enable_grad():
        splats = splats.to(device).map(lambda tensor: tensor.to(dtype).requires_grad_())
        settings = RenderSettings(background=torch.full((3,), 0.5, dtype=dtype, device=device))
        image = rasterizer.render(splats, cameras.to(device, dtype), settings).color
        # Weights of both signs that no pixel shares: an error somewhere is not made up elsewhere.
        generator = torch.Generator().manual_seed(1)
        weights = torch.randn(image.shape, generator=generator).to(device, dtype)
        tensors = splats.tensors()
        gradients = torch.autograd.grad((weights * image).sum(), list(tensors.values()))
    named = {"image": image.detach(), **dict(zip(tensors, gradients, strict=True))}
    return {name: tensor.cpu().double() for name, tensor in named.items()}


def _scene() -> tuple[Splats, Cameras]:
    """Random splats in front of a camera, in the numbers of float32."""
    generator = torch.Generator().manual_seed(2)

    def normal(*shape: int) -> Tensor:
        return torch.randn(SPLATS, *shape, generator=generator)

    splats = Splats(
        means=normal(3) * torch.tensor([1.2, 0.8, 0.5]),
        opacities=normal().sigmoid(),
        colors=Sh(0.3 * normal((SH_DEGREE + 1) ** 2, 3), SH_DEGREE),
        quats=normal(4),
        scales=0.15 * normal(3).sigmoid(),
    )
    camera = Cameras.look_at((0.0, 0.0, -4.0), width=WIDTH, height=HEIGHT, field_of_view=45.0)
    return splats, camera
