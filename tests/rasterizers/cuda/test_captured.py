"""Images whose number of pairs the host does not know, as in a CUDA graph; on the emulation."""

import ctypes

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.native_programs import compiler
from support.scenes import front_camera, random_splats

from gsfw.core.render_settings import RenderSettings
from gsfw.kernels.cuda.launcher import Kernel, Launcher
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer


class CapturingLauncher(Launcher):
    """The emulation, which says that it records a graph once ``capturing`` is set."""

    def __init__(self) -> None:
        compiler()
        self.capturing = False
        self._launcher = EmulatedLauncher(seed=1)

    def captures(self) -> bool:
        return self.capturing

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        self._launcher.launch(kernel, blocks, threads, job)


def drawn(rasterizer: CudaRasterizer, count: int) -> list[torch.Tensor]:
    """An image and all gradients."""
    splats = random_splats(count, 1, 7).map(lambda tensor: tensor.requires_grad_())
    output = rasterizer.render(splats, front_camera(70, 40), RenderSettings())
    output.color.square().sum().backward()
    return [output.color.detach(), *(leaf.grad for leaf in splats.tensors().values())]


@pytest.mark.parametrize("count", [0, 40, 300])
def test_a_captured_image_and_its_gradients_have_the_same_bits(count):
    launcher = CapturingLauncher()
    rasterizer = CudaRasterizer(launcher)
    expected = drawn(rasterizer, count)
    assert rasterizer.fits() is None
    launcher.capturing = True
    found = drawn(rasterizer, count)
    assert rasterizer.fits()
    assert rasterizer.fits() is None
    for ours, theirs in zip(found, expected, strict=True):
        # Gradients of an image are summed in any order, which the emulation keeps.
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-7)
    assert torch.equal(found[0], expected[0])


def test_an_image_with_more_pairs_than_room_tells_so_and_gets_room_the_next_time():
    launcher = CapturingLauncher()
    rasterizer = CudaRasterizer(launcher)
    drawn(rasterizer, 10)
    expected = drawn(CudaRasterizer(CapturingLauncher()), 300)
    launcher.capturing = True
    drawn(rasterizer, 300)
    assert not rasterizer.fits()
    rasterizer.make_room()
    found = drawn(rasterizer, 300)
    assert rasterizer.fits()
    assert torch.equal(found[0], expected[0])


def test_backends_whose_steps_the_host_waits_for_are_not_captured():
    launcher = CapturingLauncher()
    assert CudaRasterizer(launcher).can_be_captured
    assert not CudaRasterizer(launcher, deterministic=True).can_be_captured
    assert not CudaRasterizer(launcher, time_stages=True).can_be_captured
