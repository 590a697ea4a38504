"""Every instruction set that this machine runs draws what the reference draws."""

import os
import subprocess
import sys

import pytest
import torch
from support.agreement import as_float64, check_float32, check_float64, draw_everything
from support.random_scenes import Kind

from gsfw.commands.main import main
from gsfw.core.cameras import CameraModel
from gsfw.core.render_settings import Depth
from gsfw.kernels.cpu import native_module
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

pytestmark = pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT)

KINDS = [
    Kind(1, (40, 30), CameraModel.PINHOLE, degree=4, layout="two parts", antialias=True),
    Kind(2, (33, 9), CameraModel.FISHEYE, cameras=2, covariances=True, layout="ragged"),
    Kind(3, (17, 31), CameraModel.ORTHOGRAPHIC, layout="channels", channels=16, extras=3),
    Kind(4, (64, 64), CameraModel.PINHOLE, count=900, background="differentiated"),
    Kind(5, (40, 30), CameraModel.PINHOLE, depth=Depth.ACCUMULATED, cut_offs=False),
]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind.seed))
def test_it_agrees_with_the_reference(instruction_set, kind):
    narrow = kind.scene(torch.float32)
    wide = as_float64(*narrow)
    expected = draw_everything(ReferenceRasterizer(), *wide)
    check_float64(draw_everything(CpuRasterizer(), *wide), expected)
    check_float32(draw_everything(CpuRasterizer(), *narrow), expected, narrow[2].profile)


def test_it_may_change_between_an_image_and_its_way_back(instruction_set):
    splats, cameras, settings = KINDS[0].scene(torch.float32)
    module = pytest.importorskip("gsfw.kernels.cpu._native")
    expected = draw_everything(CpuRasterizer(), splats, cameras, settings)
    leaf = splats.map(lambda tensor: tensor.clone().requires_grad_())
    output = CpuRasterizer().render(leaf, cameras, settings)
    module.use_instruction_set("scalar")
    output.color.sum().backward()
    assert torch.equal(output.color.detach(), expected["color"])
    assert leaf.means.grad is not None
    module.use_instruction_set(instruction_set)


@pytest.mark.slow
def test_the_environment_forces_one_and_the_doctor_shows_it():
    result = subprocess.run(
        [sys.executable, "-m", "gsfw", "doctor"],
        env=os.environ | {"GSFW_CPU_ISA": "scalar"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "instruction set: scalar" in result.stdout


def test_an_unknown_one_is_refused_with_those_there_are(monkeypatch, capsys):
    expected = ", ".join(instruction_sets())
    monkeypatch.setattr(native_module, "native", native_module.native.__wrapped__)
    monkeypatch.setenv(native_module.FORCED, "avx1024")
    assert main(["doctor"]) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert said.startswith(
        "error: GSFW_CPU_ISA=avx1024: expected one of the instruction sets that this machine runs: "
        f"{expected}."
    )
