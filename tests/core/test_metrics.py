"""Figures of a picture."""

import math

import pytest
import torch

from gsfw.core.maths.ssim import ssim
from gsfw.core.metrics import PSNR_MAX, ColorCorrectedPsnr, Psnr, Ssim, color_corrected, psnr
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


def random_image(seed: int, height: int = 12, width: int = 15):
    return torch.rand(height, width, 3, generator=torch.Generator().manual_seed(seed))


def squares_map(image, target):
    """The affine map of least squares, by another solver in float64."""
    ones = torch.ones(len(image), 1, dtype=torch.float64)
    colors = torch.cat([image.double(), ones], dim=1)
    return colors @ torch.linalg.lstsq(colors, target.double()).solution


@pytest.mark.parametrize("spread", [1.0, 0.1])
def test_colors_are_corrected_by_the_affine_map_of_least_squares(spread):
    rendered, noise = 0.4 + 0.3 * spread * random_image(0), 0.1 * random_image(1)
    mixed = rendered @ torch.tensor([[0.8, 0.1, 0.0], [0.1, 1.1, 0.1], [0.0, 0.1, 0.7]])
    target = (mixed + spread * noise).clamp(0, 1)
    valid = random_image(2)[..., :1] > 0.5
    wanted = squares_map(rendered[valid[..., 0]], target[valid[..., 0]])
    found = color_corrected(rendered, torch.where(valid, target, 1.0), valid)
    torch.testing.assert_close(found[valid[..., 0]].double(), wanted, atol=2e-5, rtol=0)


def test_a_change_of_gains_and_offsets_costs_nothing_once_colors_are_corrected():
    rendered = random_image(3)
    target = rendered * torch.tensor([0.7, 0.4, 0.5]) + torch.tensor([0.3, 0.5, 0.4])
    assert psnr(rendered, target) < 14
    assert ColorCorrectedPsnr()(rendered, target, None) > 90


@pytest.mark.parametrize(
    ("rendered", "target"),
    [
        (torch.zeros(4, 5, 3), random_image(4, 4, 5)),
        (torch.full((4, 5, 3), 0.3), torch.full((4, 5, 3), 0.9)),
        (random_image(5, 4, 5)[..., :1].expand(4, 5, 3), random_image(6, 4, 5)),
        (random_image(7, 1, 2), random_image(8, 1, 2)),
        (random_image(9, 4, 5), torch.ones(4, 5, 3)),
        (3 * random_image(10, 4, 5) - 1, random_image(11, 4, 5)),
    ],
    ids=["black", "one color", "grey", "two pixels", "white target", "beyond the range"],
)
def test_corrected_colors_are_finite_and_never_worse(rendered, target):
    found = ColorCorrectedPsnr()(rendered, target, None)
    assert psnr(rendered, target) <= found <= PSNR_MAX


def test_one_color_is_corrected_to_the_mean_of_the_photo():
    target = random_image(12)
    found = color_corrected(torch.full_like(target, 0.2), target)
    torch.testing.assert_close(found, target.mean(dim=(0, 1)).expand_as(target))


def test_no_valid_pixels_leave_the_render_as_it_is():
    rendered, nothing = random_image(13), torch.zeros(12, 15, 1, dtype=torch.bool)
    assert torch.equal(color_corrected(rendered, random_image(14), nothing), rendered)


def test_a_render_that_is_not_finite_has_no_corrected_figure():
    rendered = torch.full((4, 5, 3), math.nan)
    assert math.isnan(ColorCorrectedPsnr()(rendered, random_image(0, 4, 5), None))
