"""Figures of a picture."""

import math

import pytest
import torch

from gsfw.core.maths.ssim import ssim
from gsfw.core.metrics import PSNR_MAX, Psnr, Ssim, psnr
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.registry import installed


def test_psnr_of_a_known_error():
    target = torch.full((4, 5, 3), 0.5)
    assert psnr(target + 0.1, target) == pytest.approx(20.0, abs=1e-4)


def test_psnr_clamps_both_pictures():
    assert psnr(torch.full((2, 2, 3), 7.0), torch.ones(2, 2, 3)) == PSNR_MAX
    assert psnr(torch.full((2, 2, 3), -7.0), torch.ones(2, 2, 3)) == pytest.approx(0.0)


def test_psnr_looks_at_valid_pixels_only():
    target = torch.zeros(2, 2, 3)
    rendered = target.clone()
    rendered[0, 0] = 1.0
    rendered[1, 1] = 0.5
    valid = torch.ones(2, 2, 1, dtype=torch.bool)
    valid[0, 0] = False
    expected = -10 * math.log10(0.25 / 3)
    assert psnr(rendered, target, valid) == pytest.approx(expected, abs=1e-5)
    assert Psnr()(rendered, target, valid) == pytest.approx(expected, abs=1e-5)


def test_ssim_is_that_of_the_loss_with_the_rendered_picture_clamped():
    generator = torch.Generator().manual_seed(0)
    rendered = 2 * torch.rand(12, 15, 3, generator=generator) - 0.5
    target = torch.rand(12, 15, 3, generator=generator)
    expected = float(ssim(rendered.clamp(0, 1)[None], target[None]))
    assert Ssim()(rendered, target, None) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("valid", [False, True])
def test_ssim_of_native_operators_is_that_of_torch(valid):
    generator = torch.Generator().manual_seed(1)
    rendered = 2 * torch.rand(33, 41, 3, generator=generator) - 0.5
    target = torch.rand(33, 41, 3, generator=generator)
    mask = torch.rand(33, 41, 1, generator=generator) > 0.6 if valid else None
    set_of_device = choose_operators(installed(), torch.device("cpu"))
    found = Ssim(set_of_device)(rendered, target, mask)
    assert found == pytest.approx(Ssim()(rendered, target, mask), abs=1e-6)
