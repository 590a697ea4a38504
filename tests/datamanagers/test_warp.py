"""Images and masks of distorted lenses."""

import numpy as np
import pytest
from support.distorted_images import (
    DISTORTIONS,
    HEIGHT,
    WIDTH,
    lens,
    slopes_on_grid,
    spot_errors,
    spots,
)
from support.sampling import sampled

from gsfw.datamanagers.area import shrink_values, to_pixels, to_values
from gsfw.datamanagers.images import fit_image
from gsfw.datamanagers.undistortion import LensRule, undistortion_of
from gsfw.datamanagers.warp import MapCache, Warp

FISHEYES = [model for model in DISTORTIONS if lens(model).is_fisheye]


def warp(model: str, rule: LensRule | None = None) -> Warp:
    return Warp(undistortion_of(lens(model), rule or LensRule()), MapCache())


def fit(straightened: Warp, pixels, valid=None, shrunk: float = 1):
    target = straightened.undistortion.target
    width, height = round(target.width / shrunk), round(target.height / shrunk)
    return fit_image(pixels, valid, width, height, straightened)


@pytest.mark.parametrize(
    ("model", "rule"),
    [
        *((model, LensRule()) for model in DISTORTIONS),
        *sampled([(model, LensRule(blank_pixels=1.0)) for model in DISTORTIONS], range(4)),
        *sampled([(model, LensRule(keep_fisheye=True)) for model in FISHEYES], range(2)),
    ],
)
def test_rays_show_where_the_undistorted_camera_puts_them(model, rule):
    straightened = warp(model, rule)
    target = straightened.undistortion.target
    image = fit(straightened, spots(lens(model), target, slopes_on_grid())).pixels
    errors = spot_errors(image, target.project(slopes_on_grid()))
    assert np.abs(errors).max() < 0.01


def test_rays_show_where_they_should_in_shrunk_images():
    straightened = warp("OPENCV")
    target = straightened.undistortion.target
    image = fit(straightened, spots(lens("OPENCV"), target, slopes_on_grid()), shrunk=2).pixels
    small = target.resized(image.shape[1], image.shape[0])
    errors = spot_errors(image, small.project(slopes_on_grid()), spread=2.5)
    assert np.abs(errors).max() < 0.02


@pytest.mark.parametrize("channels", [3, 4])
def test_strips_of_one_channel_give_the_bits_of_the_whole_image(channels):
    straightened = warp("OPENCV")
    target = straightened.undistortion.target
    generator = np.random.default_rng(4)
    pixels = generator.integers(0, 256, (HEIGHT, WIDTH, channels), np.uint8)
    whole = straightened.colors(to_values(pixels), 0, target.height)
    for shrunk in (1, 1.3):
        found = fit(straightened, pixels, shrunk=shrunk).pixels
        wanted = to_pixels(shrink_values(whole, found.shape[1], found.shape[0]))
        assert np.array_equal(found, wanted)


def test_a_straight_gradient_in_front_of_the_lens_is_straight_again():
    straightened = warp("FULL_OPENCV")
    target = straightened.undistortion.target
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    seen = target.project(lens("FULL_OPENCV").unproject(np.stack([x.ravel(), y.ravel()], axis=1)))
    values = (0.7 * seen[:, :1] + 20).astype(np.float32).reshape(HEIGHT, WIDTH, 1)
    found = straightened.colors(values, 0, target.height)[..., 0]
    wanted = 0.7 * (np.arange(target.width) + 0.5) + 20
    # Next to the border the colours beyond it, which the kernel looks at, repeat those within.
    assert np.abs(found - wanted)[2:-2, 2:-2].max() < 2e-3


def test_pixels_that_were_not_seen_are_masked_and_others_are_not():
    straightened = warp("OPENCV", LensRule(blank_pixels=1.0))
    pixels = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    image = fit(straightened, pixels)
    assert image.mask is not None
    assert 0.5 < image.mask.mean() < 1
    assert not image.mask[0, 0]
    assert image.mask[image.mask.shape[0] // 2, image.mask.shape[1] // 2]
    assert (image.pixels == 200).all()
    assert fit(warp("OPENCV"), pixels).mask is None


def test_a_masked_pixel_takes_those_along_that_are_mixed_with_it():
    straightened = warp("OPENCV")
    pixels = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    valid = np.ones((HEIGHT, WIDTH), dtype=bool)
    valid[60:70, 100:120] = False
    spoiled = pixels.copy()
    spoiled[~valid] = 255
    clean, dirty = fit(straightened, pixels, valid), fit(straightened, spoiled, valid)
    assert clean.mask is not None
    assert (dirty.pixels[clean.mask] == 100).all()
    assert 200 < (~clean.mask).sum() < 500


def test_colours_where_nothing_covers_do_not_bleed_into_others():
    pixels = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    pixels[..., 0] = 255
    pixels[40:140, 50:190] = (0, 90, 200, 255)
    found = fit(warp("SIMPLE_RADIAL"), pixels).pixels
    shown = found[..., 3] > 30
    assert np.abs(found[shown][:, :3].astype(int) - (0, 90, 200)).max() <= 2
    assert 0 < found[..., 3].mean() < 255


def test_maps_are_computed_once_and_dropped_beyond_the_budget(monkeypatch):
    first, second = (undistortion_of(lens(model), LensRule()) for model in ("OPENCV", "FOV"))
    maps = MapCache()
    assert maps.get(first) is maps.get(first)
    held = maps.get(first)
    maps.get(second)
    assert maps.get(first) is held
    small = MapCache(budget=1)
    held = small.get(first)
    assert small.get(first) is held
    small.get(second)
    assert small.get(first) is not held
