"""Stand-ins by which trainers that were written for CUDA run on the CPU engine."""

import gc
import subprocess
import sys
import weakref
from dataclasses import replace
from pathlib import Path

import peers.stand_ins.diff_gaussian_rasterization as stand_in
import pytest
import torch
from peers.stand_ins.cuda_on_cpu import CudaOnCpu
from peers.stand_ins.simple_knn._C import distCUDA2
from support.scenes import random_splats, turned_camera

from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer

LAUNCH = Path(stand_in.__file__).parent / "launch.py"


@pytest.fixture
def view():
    """A turned camera, and it as the original's settings: its principal point is the middle."""
    camera = turned_camera().to(dtype=torch.float32)
    matrix = camera.intrinsics[0].clone()
    matrix[0, 2], matrix[1, 2] = camera.width / 2, camera.height / 2
    settings = stand_in.GaussianRasterizationSettings(
        image_height=camera.height,
        image_width=camera.width,
        tanfovx=camera.width / (2 * float(matrix[0, 0])),
        tanfovy=camera.height / (2 * float(matrix[1, 1])),
        bg=torch.tensor([0.2, 0.4, 0.6]),
        scale_modifier=1.0,
        viewmatrix=camera.world_to_camera[0].T,
        projmatrix=torch.eye(4),
        sh_degree=1,
        campos=camera.centers[0],
        prefiltered=False,
        debug=False,
    )
    return settings


def rendered(view, splats, screen):
    return stand_in.GaussianRasterizer(view)(
        means3D=splats.means,
        means2D=screen,
        opacities=splats.opacities[:, None],
        shs=splats.colors.coefficients,
        scales=splats.scales,
        rotations=splats.quats,
    )


def test_the_original_interface_renders_what_the_engine_renders(view):
    splats = random_splats(30)
    image, radii = rendered(view, splats, torch.zeros(30, 3))
    settings = RenderSettings(background=view.bg, near=stand_in.NEAR)
    output = CpuRasterizer().render(splats, view.camera(), settings)
    torch.testing.assert_close(image, output.color[0].permute(2, 0, 1), rtol=0, atol=0)
    assert torch.equal(radii > 0, output.statistics.visible[0])
    assert (radii > 0).any()


def test_the_screen_gradient_arrives_where_the_original_trainer_reads_it(view):
    splats = random_splats(30)
    means = splats.means.clone().requires_grad_()
    screen = torch.zeros(30, 3, requires_grad=True)
    image, _ = rendered(view, replace(splats, means=means), screen)
    weights = torch.rand(image.shape, generator=torch.Generator().manual_seed(1))
    (image * weights).sum().backward()
    given = splats.means.clone().requires_grad_()
    settings = RenderSettings(
        background=view.bg,
        near=stand_in.NEAR,
        statistics=frozenset({Statistic.SCREEN_GRADIENT}),
    )
    output = CpuRasterizer().render(replace(splats, means=given), view.camera(), settings)
    (output.color[0].permute(2, 0, 1) * weights).sum().backward()
    assert torch.equal(means.grad, given.grad)
    assert torch.equal(screen.grad[:, :2].norm(dim=1), output.statistics.screen_gradient[0])
    assert (screen.grad[:, 0] > 0).any()


def test_nothing_of_a_step_stays_when_its_image_is_gone(view):
    splats = random_splats(30)
    means = splats.means.clone().requires_grad_()
    image, _ = rendered(view, replace(splats, means=means), torch.zeros(30, 3, requires_grad=True))
    nodes = [image.grad_fn]
    while "WithScreenGradient" not in nodes[0].name():
        node = nodes.pop(0)
        nodes += [after for after, _ in node.next_functions if after is not None]
    step = weakref.ref(nodes[0])
    image.sum().backward()
    del image, nodes, node
    gc.collect()
    assert step() is None


def test_halves_of_covariances_become_symmetric_matrices():
    (matrix,) = stand_in._matrices(torch.arange(6.0)[None])
    assert matrix.tolist() == [[0, 1, 2], [1, 3, 4], [2, 4, 5]]


def test_distances_are_mean_squares_to_three_neighbours():
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [50, 50, 50]])
    assert distCUDA2(points)[0] == pytest.approx((1 + 4 + 9) / 3)


def test_tensors_that_are_asked_for_on_cuda_are_on_the_cpu():
    with CudaOnCpu():
        made = [
            torch.zeros(2, device="cuda"),
            torch.tensor([1.0], device=torch.device("cuda")),
            torch.ones(2).cuda(),
            torch.ones(2).to("cuda"),
            torch.ones(2).to(torch.device("cuda:0"), torch.float64),
        ]
    assert {tensor.device.type for tensor in made} == {"cpu"}
    assert made[-1].dtype == torch.float64


@pytest.mark.slow
def test_a_trainer_is_launched_with_its_own_modules_and_the_stand_ins(tmp_path):
    (tmp_path / "scene.py").write_text("NAME = 'its own'\n")
    (tmp_path / "train.py").write_text(
        "import sys, torch\n"
        "from diff_gaussian_rasterization import GaussianRasterizer\n"
        "from simple_knn._C import distCUDA2\n"
        "from scene import NAME\n"
        "start, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))\n"
        "start.record(); end.record()\n"
        "torch.cuda.set_device(torch.device('cuda:0'))\n"
        "weight = torch.nn.Parameter(torch.ones(2, device='cuda'))\n"
        "torch.optim.Adam([weight]).zero_grad()\n"
        "print(NAME, sys.argv[1:], weight.device, start.elapsed_time(end) >= 0)\n"
    )
    command = [sys.executable, str(LAUNCH), str(tmp_path / "train.py"), "-s", "DATA"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "its own ['-s', 'DATA'] cpu True\n"
