"""Sharpness of images with and without fine detail, of blurred ones, and of cut-out things."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage

from gsfw.preparation.image_quality import ImageQuality, UsualQuality

SIZE = 240
Pixels = np.ndarray


def painted(detail: float, seed: int = 0) -> Pixels:
    """Rectangles and discs with sharp edges, and as much of a fine texture; [h, w, 1]."""
    generator = np.random.default_rng(seed)
    y, x = np.mgrid[:SIZE, :SIZE]
    grey = np.full((SIZE, SIZE), 0.5)
    for number in range(24):
        left, top, size = generator.uniform(0, SIZE, 3) * (1, 1, 0.3)
        turned = (x - left) * np.cos(number) + (y - top) * np.sin(number)
        across = (y - top) * np.cos(number) - (x - left) * np.sin(number)
        grey[(abs(turned) < size) & (abs(across) < size / 2)] = generator.uniform(0.2, 0.8)
    texture = ndimage.gaussian_filter(generator.normal(size=grey.shape), 0.7)
    return (grey + detail * texture)[..., None].clip(0, 1)


def usual() -> UsualQuality:
    return UsualQuality.of([ImageQuality.of(painted(0.3, seed)) for seed in range(3)])


def test_a_sharp_image_of_smooth_things_is_not_blurred() -> None:
    smooth = ImageQuality.of(painted(0.0, seed=5))
    assert usual().share_of_sharpness(smooth) < 0.3
    assert not usual().is_blurred(smooth)


@pytest.mark.parametrize(
    "blur",
    [
        lambda image: ndimage.gaussian_filter(image, (1.2, 1.2, 0)),
        lambda image: ndimage.uniform_filter1d(image, 13, axis=1),
        lambda image: np.mean([np.roll(image, (k, k), (0, 1)) for k in range(9)], axis=0),
    ],
    ids=["focus", "motion", "oblique motion"],
)
@pytest.mark.parametrize("detail", [0.0, 0.2])
def test_blurred_images_are_blurred_with_and_without_fine_detail(
    blur: Callable[[Pixels], Pixels], detail: float
) -> None:
    assert usual().is_blurred(ImageQuality.of(blur(painted(detail, seed=5))))


def test_the_border_of_what_counts_is_no_edge() -> None:
    y, x = np.mgrid[:SIZE, :SIZE]
    inside = np.hypot(y - SIZE / 2, x - SIZE / 2) < SIZE / 3
    blurred = ndimage.gaussian_filter(painted(0.2, seed=5), (2, 2, 0))
    cut_out = np.where(inside[..., None], blurred, 1.0)
    assert ImageQuality.of(cut_out, inside).edges < 0.6 * usual().edges
    assert ImageQuality.of(cut_out).edges > 0.6 * usual().edges


def test_an_image_without_edges_has_none() -> None:
    assert ImageQuality.of(np.full((40, 40, 3), 0.5)).edges == 0.0
    assert ImageQuality.of(np.full((3, 40, 3), 0.5)).edges == 0.0
