"""Smaller batches are the means of large ones: colours, alpha, masks, maps, cameras."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.batch import Batch, MaskMode, Resampling, ViewMap
from gsfw.core.loop.area import area_means, shrink_batch
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SIZES = [(12, 8), (7, 5), (11, 9), (23, 16), (1, 1)]
"""Widths and heights, some of which divide 24 x 18 and some of which do not."""


def overlap(part: int, parts: int, pixel: int, size: int) -> float:
    """How much of a pixel lies in one of equal parts of a row."""
    step = size / parts
    return max(0.0, min((part + 1) * step, pixel + 1) - max(part * step, pixel))


def naive_means(values: torch.Tensor, width: int, height: int) -> torch.Tensor:
    """Means of [h, w, d] by a loop over pixels."""
    rows, columns, channels = values.shape
    means = torch.zeros(height, width, channels, dtype=torch.float64)
    for y in range(height):
        for x in range(width):
            for row in range(rows):
                across = overlap(y, height, row, rows)
                for column in range(columns) if across else ():
                    share = across * overlap(x, width, column, columns)
                    means[y, x] += share * values[row, column].double()
    return means * (width * height) / (rows * columns)


def random_batch(**fields) -> Batch:
    generator = torch.Generator().manual_seed(5)
    views = [replace(front_camera(24, 18), camera_index=torch.tensor([i])) for i in range(2)]
    return Batch(
        torch.rand(2, 18, 24, 3, generator=generator), views[0].cat(views), (0, 1), **fields
    )


def random_field(threshold: float = 0.0) -> torch.Tensor:
    """[2, 18, 24, 1]; values below the threshold become 0."""
    values = torch.rand(2, 18, 24, 1, generator=torch.Generator().manual_seed(6))
    return torch.where(values < threshold, 0.0, values)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_means_are_those_of_a_loop_over_covered_areas(width, height):
    images = random_batch().images
    means = area_means(images, width, height)
    for picture, expected in zip(means, images, strict=True):
        torch.testing.assert_close(
            picture.double(), naive_means(expected, width, height), atol=1e-6, rtol=0
        )


@pytest.mark.parametrize("mode", MaskMode)
@pytest.mark.parametrize("with_alpha", [False, True])
def test_over_any_background_a_small_target_is_the_mean_of_the_large(mode, with_alpha):
    mask = random_field() > 0.3 if mode is MaskMode.EMPTY else None
    alpha = random_field(0.2) if with_alpha else None
    batch = random_batch(alpha=alpha, mask=mask, mask_mode=mode)
    small = shrink_batch(batch, 11, 7)
    for background in (torch.zeros(3), torch.tensor([0.2, 1.0, 0.6])):
        expected = naive_means(batch.target(background)[1], 11, 7)
        torch.testing.assert_close(
            small.target(background)[1].double(), expected, atol=1e-6, rtol=0
        )


def test_where_nothing_covers_a_pixel_it_is_black_and_empty():
    small = shrink_batch(random_batch(alpha=torch.zeros(2, 18, 24, 1)), 7, 5)
    assert small.alpha is not None
    assert float(small.alpha.abs().max()) == float(small.images.abs().max()) == 0


def test_pixels_are_valid_where_all_that_they_cover_is():
    mask = random_field() > 0.1
    small = shrink_batch(random_batch(mask=mask), 11, 9)
    assert small.valid is not None
    expected = naive_means(mask[0].double(), 11, 9) > 1 - 1e-9
    assert torch.equal(small.valid[0], expected)
    assert 0 < int(expected.sum()) < expected.numel()
    assert small.mask_mode is MaskMode.IGNORE


@pytest.mark.parametrize("rule", [Resampling.MEAN, Resampling.DEPTH])
def test_maps_are_means_of_the_known_and_known_where_half_of_a_pixel_is(rule):
    values = random_field(0.4).expand(2, 18, 24, 3) * torch.tensor([1.0, 2.0, 3.0])
    raw = torch.where(values > 0, values, torch.nan)
    small = shrink_batch(random_batch(maps={"m": ViewMap.of(raw, rule)}), 11, 9).maps["m"]
    part = naive_means((values[1] > 0).double(), 11, 9)
    expected = naive_means(values[1], 11, 9) / part.clamp(min=1e-9)
    known = part[..., :1] > 0.5 - 1e-6
    assert torch.equal(small.known[1], known)
    assert 0 < int(known.sum()) < known.numel()
    torch.testing.assert_close(small.values[1].double(), expected * known, atol=1e-5, rtol=0)
    assert small.rule is rule


def test_labels_are_picked_from_the_pixel_in_the_middle():
    labels = torch.arange(18 * 24.0).view(1, 18, 24, 1).repeat(2, 1, 1, 1)
    label_map = ViewMap.of(labels, Resampling.NEAREST)
    small = shrink_batch(random_batch(maps={"labels": label_map}), 8, 6).maps["labels"]
    assert torch.equal(small.values, labels[:, 1::3, 1::3])
    assert bool(small.known.all())


@pytest.mark.parametrize("rule", Resampling)
def test_maps_are_unknown_where_a_small_pixel_is_not_valid(rule):
    mask = random_field() > 0.1
    full = ViewMap.of(1 + random_field(), rule)
    small = shrink_batch(random_batch(mask=mask, maps={"m": full}), 11, 9)
    assert torch.equal(small.maps["m"].known, small.valid)
    assert float(small.maps["m"].values[~small.valid].abs().max()) == 0


def test_the_mean_of_an_error_counts_known_pixels_only():
    values = torch.tensor([1.0, torch.nan, 3.0, torch.inf]).view(1, 2, 2, 1)
    found = ViewMap.of(values)
    assert found.values.flatten().tolist() == [1, 0, 3, 0]
    assert float(found.mean((found.values - 1).abs().expand(1, 2, 2, 5))) == 1.0
    nothing = ViewMap.of(torch.zeros(1, 2, 2, 1), Resampling.DEPTH)
    assert float(nothing.mean(torch.ones(1, 2, 2, 1))) == 0.0


def test_everything_else_stays_and_a_full_batch_is_the_same_object():
    batch = random_batch()
    assert shrink_batch(batch, 24, 18) is batch
    small = shrink_batch(batch, 10, 7)
    assert (small.views, small.alpha, small.mask, small.maps) == ((0, 1), None, None, {})
    assert (small.cameras.width, small.cameras.height) == (10, 7)
    assert torch.equal(small.cameras.camera_index, batch.cameras.camera_index)


def test_a_small_rendering_is_the_mean_of_a_large_one():
    splats = random_splats(40, degree=0)
    splats = replace(splats, scales=splats.scales + 0.2)  # Wide: pixels hardly blur them.
    rasterizer, camera = ReferenceRasterizer(), front_camera(96, 72)
    large = rasterizer.render(splats, camera).color
    small = shrink_batch(Batch(large, camera, (0,)), 37, 25)
    drawn = rasterizer.render(splats, small.cameras).color
    astray = replace(small.cameras, intrinsics=small.cameras.intrinsics.clone())
    astray.intrinsics[:, :2, 2] += 0.5  # As if the sizes' ratio had been rounded.
    error, error_astray = (
        float((rasterizer.render(splats, cameras).color - small.images).abs().mean())
        for cameras in (small.cameras, astray)
    )
    assert drawn.shape == small.images.shape
    assert error < 5e-3, "what remains is the blur of at least a pixel that splats get"
    assert error_astray > 3 * error
