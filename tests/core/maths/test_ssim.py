"""SSIM against an implementation of its own, in float64."""

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from gsfw.core.maths.ssim import ssim, ssim_map


def reference_map(x, y):
    """Wang et al. 2004, equation 13, for one channel, with a full two-dimensional window."""
    offsets = np.arange(-5, 6)
    window = np.exp(-(offsets[:, None] ** 2 + offsets[None, :] ** 2) / (2 * 1.5**2))
    window /= window.sum()

    def mean(image):
        return convolve2d(image, window, mode="same", boundary="fill", fillvalue=0)

    mean_x, mean_y = mean(x), mean(y)
    variance_x, variance_y = mean(x * x) - mean_x**2, mean(y * y) - mean_y**2
    covariance = mean(x * y) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * mean_x * mean_y + c1) / (mean_x**2 + mean_y**2 + c1)
    return luminance * (2 * covariance + c2) / (variance_x + variance_y + c2)


def pictures(*shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return [torch.rand(*shape, generator=generator, dtype=torch.float64) for _ in range(2)]


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 3), (11, 11), (23, 30)])
def test_the_map_agrees_with_a_plain_implementation(size):
    rendered, target = pictures(2, *size, 3)
    found = ssim_map(rendered, target)
    for image in range(2):
        for channel in range(3):
            expected = reference_map(
                rendered[image, ..., channel].numpy(), target[image, ..., channel].numpy()
            )
            np.testing.assert_allclose(found[image, ..., channel].numpy(), expected, atol=1e-12)
    assert float(ssim(rendered, target)) == pytest.approx(float(found.mean()), rel=1e-12)


def test_equal_pictures_are_as_similar_as_can_be():
    picture, _ = pictures(1, 15, 15, 3)
    assert float(ssim(picture, picture)) == pytest.approx(1.0, abs=1e-12)


def test_float32_is_close_to_float64():
    rendered, target = pictures(1, 32, 32, 3)
    close = target + 0.01 * rendered
    found = ssim(close.float(), target.float())
    assert float(found) == pytest.approx(float(ssim(close, target)), abs=2e-5)


def test_the_gradient_is_that_of_finite_differences():
    rendered, target = pictures(1, 9, 13, 2)
    valid = torch.rand(1, 9, 13, 1, generator=torch.Generator().manual_seed(3)) < 0.7
    rendered.requires_grad_()
    assert torch.autograd.gradcheck(lambda x: ssim(x, target), rendered, fast_mode=True)
    assert torch.autograd.gradcheck(lambda x: ssim(x, target, valid), rendered, fast_mode=True)


def test_a_mask_shows_the_target_where_it_is_not_valid():
    rendered, target = pictures(1, 20, 24, 3)
    valid = torch.rand(1, 20, 24, 1, generator=torch.Generator().manual_seed(5)) < 0.6
    filled = np.where(valid.numpy(), rendered.numpy(), target.numpy())
    inside = valid[0, ..., 0].numpy()
    expected = np.mean(
        [reference_map(filled[0, ..., c], target[0, ..., c].numpy())[inside] for c in range(3)]
    )
    assert float(ssim(rendered, target, valid)) == pytest.approx(expected, rel=1e-12)


def test_what_is_outside_the_mask_does_not_matter():
    rendered, target = pictures(1, 20, 24, 3)
    valid = torch.ones(1, 20, 24, 1, dtype=torch.bool)
    valid[:, 3:8, 4:20] = False
    disturbed = torch.where(valid, rendered, 7.0)
    assert float(ssim(rendered, target, valid)) == float(ssim(disturbed, target, valid))
