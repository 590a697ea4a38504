"""Colour edits of harmonics are the same edits of images, wherever nothing is clamped."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.maths.spherical_harmonics import rgb_to_dc
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.editing import colors
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def soft_splats():
    """Splats whose colours stay within 0.3 and 0.7 from everywhere, so that nothing is clamped."""
    splats = random_splats(40, 2, dtype=torch.float64)
    generator = torch.Generator().manual_seed(5)
    coefficients = 0.05 * torch.randn(40, 9, 3, generator=generator, dtype=torch.float64)
    middle = torch.rand(40, 3, generator=generator, dtype=torch.float64) * 0.2 + 0.4
    coefficients[:, 0] = rgb_to_dc(middle)
    return replace(splats, colors=Sh(coefficients, 2))


def render(splats, color=(0.0, 0.0, 0.0)):
    settings = RenderSettings(background=torch.tensor(color, dtype=torch.float64))
    camera = front_camera(32, 24, dtype=torch.float64)
    output = ReferenceRasterizer().render(splats, camera, settings)
    return output.color[0], output.alpha[0]


@pytest.mark.parametrize(
    "change",
    [
        colors.brightness(1.3),
        colors.contrast(0.6),
        colors.saturation(0.2),
        colors.saturation(1.5),
        colors.white_balance(0.9, 0.8, 0.7),
    ],
)
def test_a_change_of_colours_is_the_same_change_of_the_image(change):
    splats = soft_splats()
    before, alpha = render(splats)
    after, _ = render(colors.recolored(splats, change))
    expected = before @ change.matrix.T + alpha * change.offset
    assert float((after - before).abs().max()) > 0.01
    assert float((after - expected).abs().max()) < 1e-12


def test_no_saturation_is_grey_of_the_same_brightness():
    before, _ = render(soft_splats())
    after, _ = render(colors.recolored(soft_splats(), colors.saturation(0.0)))
    luma = before @ torch.tensor(colors.LUMA, dtype=torch.float64)
    assert torch.allclose(after, luma[..., None].expand_as(after), atol=1e-12)


def test_white_balance_makes_its_colour_grey_and_keeps_its_brightness():
    color = torch.tensor([0.9, 0.8, 0.5], dtype=torch.float64)
    grey = colors.white_balance(*color.tolist()).matrix @ color
    luma = float(torch.tensor(colors.LUMA, dtype=torch.float64) @ color)
    assert grey.tolist() == pytest.approx([luma] * 3)
