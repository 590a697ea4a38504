"""No result depends on memory that nothing has written: as NVIDIA's initcheck looks for.

initcheck has to watch the kernels of torch too, which takes it too long. So new memory is filled
here, once with ones in all bits (NaN as a float, -1 as an integer), and once with small numbers.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.scenes import front_camera, random_splats
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.launcher import Launcher
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.kernels.cuda.sort import radix_sort
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer

aten = torch.ops.aten

NEW = {aten.empty.memory_format, aten.new_empty.default, aten.empty_like.default}
"""Operations that give memory as it is."""

ONES, SMALL = 0xFF, 0x01
"""Bytes: every float is NaN, or some 1e-38; every integer is -1, or large and positive."""


class Filled(TorchDispatchMode):
    """Fills all memory that is allocated for kernels with a byte."""

    def __init__(self, byte: int) -> None:
        super().__init__()
        self._byte, self.filled = byte, 0

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None):
        found = function(*args, **(kwargs or {}))
        if function in NEW and found.numel():
            found.view(-1).view(torch.uint8).fill_(self._byte)
            self.filled += 1
        return found


@pytest.fixture
def launcher(place: torch.device) -> Launcher:
    return EmulatedLauncher() if place.type == "cpu" else cuda_launcher(place)


def images_and_gradients(launcher: Launcher, place: torch.device, **kind: bool) -> list[Tensor]:
    """All results of a render with a backward pass, and of one without."""
    splats = replace(random_splats(300, 3), extra=torch.rand(300, 2, generator=seeded()))
    splats = splats.map(lambda tensor: tensor.to(place).requires_grad_())
    camera = front_camera(48, 40).to(place)
    rasterizer = CudaRasterizer(launcher, **kind)
    settings = RenderSettings(depth=Depth.EXPECTED, statistics=frozenset(Statistic))
    output = rasterizer.render(splats, camera, settings)
    images = [output.color, output.alpha, output.depth, output.extra]
    sum(image.square().sum() for image in images).backward()
    statistics = output.statistics
    measured = [statistics.visible, statistics.radii, statistics.screen_gradient]
    measured += [statistics.absgrad, statistics.contribution]
    with torch.no_grad():
        images.append(rasterizer.render(splats, camera, RenderSettings()).color)
    return [*images, *measured, *(leaf.grad for leaf in splats.tensors().values())]


def losses_and_steps(launcher: Launcher, place: torch.device) -> list[Tensor]:
    """Losses with their gradient, a step of Adam, the check of gradients, and a sort."""
    operators, generator = CudaOperators(launcher), seeded()
    shape = (1, 23, 19, 3)
    rendered, target = (torch.rand(shape, generator=generator).to(place) for _ in range(2))
    rendered.requires_grad_()
    l1, dssim = operators.l1_dssim(rendered, target)
    (l1 + dssim).backward()
    values = torch.rand(1000, 3, generator=generator).to(place)
    moments, finite = AdamMoments.zeros_like(values), operators.all_finite([values, rendered.grad])
    operators.adam_([AdamUpdate(values, 2 * values, moments, 0.1)], AdamSettings(), finite)
    keys = torch.randint(2**31, (5000,), generator=generator, dtype=torch.int32).to(place)
    ordered = radix_sort(launcher, keys, None, 32)
    return [l1, dssim, rendered.grad, values, moments.first, moments.second, finite, *ordered]


def fields(launcher: Launcher, place: torch.device) -> list[Tensor]:
    """Temporal fields and their gradients, in which at most one term is added to each cell."""
    operators, generator = CudaOperators(launcher), seeded()
    shapes = ((1, 3), (3, 4, 4, 2), (3, 4, 2), (64, 2), (9, 4))
    leaves = [torch.rand(size, generator=generator).to(place) for size in shapes]
    place_, planes, lines, table, quats = (leaf.requires_grad_() for leaf in leaves)
    time = torch.full((), 0.3, device=place)
    outputs = [
        operators.plane_product(place_, [planes], [lines], 1.0),
        operators.hash_features(place_.detach(), time, [table], [(4, 2)]),
        *operators.slices(quats, quats, quats),
        operators.squared_differences(planes, (1, 2), 1, 1.0),
        operators.mean_distance(planes, 1.0, 1.0),
    ]
    sum(output.square().sum() for output in outputs).backward()
    return [*outputs, *(leaf.grad for leaf in leaves)]


def seeded() -> torch.Generator:
    return torch.Generator().manual_seed(5)


def bits(tensor: Tensor) -> Tensor:
    return tensor.detach().contiguous().view(-1).view(torch.uint8)


def same_bits(one: Sequence[Tensor], other: Sequence[Tensor]) -> bool:
    return all(torch.equal(bits(a), bits(b)) for a, b in zip(one, other, strict=True))


WORK = {
    "images": images_and_gradients,
    "images in a fixed order": lambda *there: images_and_gradients(*there, deterministic=True),
    "losses and steps": losses_and_steps,
    "fields": fields,
}


@pytest.mark.parametrize("name", WORK)
def test_results_do_not_depend_on_what_new_memory_holds(name, launcher, place):
    if name == "images" and place.type == "cuda":
        pytest.skip("a GPU sums these gradients in any order")
    found = []
    for byte in (ONES, SMALL):
        with Filled(byte) as memory:
            found.append(WORK[name](launcher, place))
        assert memory.filled > 3
    assert same_bits(*found)
    assert all(result.isfinite().all() for result in found[0])


def test_a_result_that_depends_on_it_is_found():
    found = []
    for byte in (ONES, SMALL):
        with Filled(byte):
            found.append([torch.empty(3) + 1.0])
    assert not same_bits(*found)
