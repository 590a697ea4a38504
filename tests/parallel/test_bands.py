"""An image in bands, from splats of several processes, is the image of all splats at once.

By the kernels of the CPU rasterizer and by flat splats, which any rasterizer can draw.
"""

from dataclasses import replace

import pytest
import torch
from support.fast_rasterizer import fast_rasterizer
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.parallel.sharded.division import Division
from gsfw.parallel.sharded.flat_bands import FlatBands
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

MODELS = [CameraModel.PINHOLE, CameraModel.FISHEYE, CameraModel.ORTHOGRAPHIC]
COUNT, WIDTH, HEIGHT, IMAGES = 300, 48, 80, 2
BANDS = Division(4, 1).bands(HEIGHT)


def kernel_bands(splats, cameras, settings):
    found = fast_rasterizer().bands(splats, cameras, settings, BANDS)
    if found is None:
        pytest.skip("the native module is not built")
    return found


def flat_bands(splats, cameras, settings):
    return FlatBands(fast_rasterizer(), splats, cameras, settings, BANDS)


WAYS = pytest.mark.parametrize("bands_of", [kernel_bands, flat_bands])


def views(model=CameraModel.PINHOLE, dtype=torch.float64):
    """Two cameras, whose poses take gradients."""
    first = replace(front_camera(WIDTH, HEIGHT).to(dtype=dtype), model=model)
    poses = first.world_to_camera.repeat(2, 1, 1)
    poses[1, :2, 3] += 0.4
    cameras = replace(Cameras.cat([first, first]), world_to_camera=poses)
    return replace(cameras, world_to_camera=poses.requires_grad_())


def indices(rows):
    return torch.tensor(rows, dtype=torch.int64)


def in_bands(image, splats, parts):
    """The whole image, and a function from its gradients to those of splats and to statistics."""
    banded = [image.project(splats.take(indices(rows))) for rows in parts]
    sent = zip(*[one.rows.split(list(one.counts)) for one in banded], strict=True)
    rendered = [image.render(number, torch.cat(rows)) for number, rows in enumerate(sent)]
    assert len(rendered) == IMAGES * len(BANDS)
    shape = (IMAGES, HEIGHT, WIDTH, -1)
    pixels = torch.cat([band.image for band in rendered]).view(shape).requires_grad_()
    alpha = torch.cat([band.alpha for band in rendered]).view(shape).requires_grad_()

    def back():
        sums = [[] for _ in banded]
        for number, band in enumerate(rendered):
            picture, strip = divmod(number, len(BANDS))
            place = slice(BANDS[strip].start, BANDS[strip].stop)
            by_alpha = None if alpha.grad is None else alpha.grad[picture, place, :, 0]
            found = band.sums(pixels.grad[picture, place], by_alpha)
            for to, part in zip(
                sums, found.split([one.counts[number] for one in banded]), strict=True
            ):
                to.append(part)
        joined = [torch.cat(part) for part in sums]
        pairs = [one.gradient(part) for one, part in zip(banded, joined, strict=True)]
        torch.autograd.backward(*map(list, zip(*pairs, strict=True)))
        return [one.statistics(part) for one, part in zip(banded, joined, strict=True)]

    return image.output(pixels, alpha), back


PARTS = [list(range(0, COUNT, 2)), list(range(1, COUNT, 2)), []]
"""The rows of three processes, the last of which has none."""


def compare(bands_of, splats, cameras, settings):
    """Images, gradients of splats and of the pose, and statistics, against one render of all."""
    wanted = [*splats.tensors().values(), cameras.world_to_camera]
    output = fast_rasterizer().render(splats, cameras, settings)
    generator = torch.Generator().manual_seed(3)
    weights = torch.rand(output.color.shape, dtype=output.color.dtype, generator=generator)

    def loss(images):
        total = (images.color * weights).sum() + (images.alpha**2).sum()
        if images.depth is not None:
            total = total + 0.1 * images.depth.sum()
        return total if images.extra is None else total + images.extra.square().sum()

    expected = torch.autograd.grad(loss(output), wanted)
    found, back = in_bands(bands_of(splats, cameras, settings), splats, PARTS)
    for name in ("color", "alpha", "depth", "extra"):
        if getattr(output, name) is not None:
            torch.testing.assert_close(getattr(found, name), getattr(output, name))
    for tensor in wanted:
        tensor.grad = None
    loss(found).backward()
    statistics = back()
    for tensor, truth in zip(wanted, expected, strict=True):
        torch.testing.assert_close(tensor.grad, truth)
    for rows, measured in zip(map(indices, PARTS), statistics, strict=True):
        for name in ("visible", "radii", "screen_gradient", "absgrad", "contribution"):
            truth = getattr(output.statistics, name)
            if truth is not None:
                torch.testing.assert_close(getattr(measured, name), truth[:, rows])


def scene(degree=2, extras=0):
    splats = random_splats(COUNT, degree=degree)
    if extras:
        splats = replace(splats, extra=torch.rand(COUNT, extras))
    return splats.map(lambda tensor: tensor.double().requires_grad_())


@WAYS
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("antialias", [False, True])
def test_bands_are_the_image_of_all_splats_with_all_gradients(bands_of, model, antialias):
    settings = RenderSettings(
        background=torch.tensor([0.2, 0.4, 0.6], dtype=torch.float64),
        statistics=frozenset({Statistic.SCREEN_GRADIENT}),
        depth=Depth.EXPECTED,
        antialias=antialias,
    )
    compare(bands_of, scene(), views(model), settings)


@WAYS
def test_extra_channels_and_weighted_contributions_are_added_up_over_bands(bands_of):
    generator = torch.Generator().manual_seed(5)
    settings = RenderSettings(
        statistics=frozenset({Statistic.CONTRIBUTION, Statistic.SCREEN_GRADIENT}),
        contribution_weights=torch.rand(IMAGES, HEIGHT, WIDTH, 1, generator=generator).double(),
        depth=Depth.ACCUMULATED,
    )
    compare(bands_of, scene(degree=0, extras=2), views(), settings)


def test_absolute_gradients_are_added_up_over_bands_by_kernels():
    settings = RenderSettings(statistics=frozenset(Statistic))
    compare(kernel_bands, scene(), views(), settings)


@WAYS
def test_splats_without_a_cut_off_reach_all_bands(bands_of):
    settings = RenderSettings(profile=replace(DEFAULT, alpha_min=0.0))
    splats, cameras = scene(degree=0), views()
    banded = bands_of(splats, cameras, settings).project(splats)
    assert len(set(banded.counts)) == 1
    compare(bands_of, splats, cameras, settings)


@WAYS
def test_a_learned_background_gets_its_gradient(bands_of):
    background = torch.full((3,), 0.3, dtype=torch.float64, requires_grad=True)
    settings = RenderSettings(background=background)
    splats, cameras = scene(degree=0), views()
    whole = fast_rasterizer().render(splats, cameras, settings)
    (expected,) = torch.autograd.grad(whole.color.square().sum(), background)
    found, _ = in_bands(bands_of(splats, cameras, settings), splats, PARTS)
    torch.testing.assert_close(found.color, whole.color)
    (gradient,) = torch.autograd.grad(found.color.square().sum(), background)
    torch.testing.assert_close(gradient, expected)


@WAYS
def test_a_splat_is_sent_only_to_the_bands_that_it_reaches(bands_of):
    splats, cameras = random_splats(200, degree=0), views(dtype=torch.float32)
    whole = fast_rasterizer().render(splats, cameras)
    seen = int(whole.statistics.visible.sum())
    banded = bands_of(splats, cameras, RenderSettings()).project(splats)
    assert sum(banded.counts) == len(banded.rows)
    assert seen <= len(banded.rows) < seen * len(BANDS)


@pytest.mark.parametrize("threads", [1, 3])
def test_kernels_have_the_same_bits_for_any_number_of_threads(threads):
    splats = random_splats(3000, degree=1).map(lambda tensor: tensor.requires_grad_())
    cameras, settings = views(dtype=torch.float32), RenderSettings(statistics=frozenset(Statistic))
    before = torch.get_num_threads()
    results = []
    try:
        for count in (2, threads):
            torch.set_num_threads(count)
            image = kernel_bands(splats, cameras, settings)
            output, back = in_bands(image, splats, [list(range(1500)), list(range(1500, 3000))])
            for tensor in splats.tensors().values():
                tensor.grad = None
            output.color.square().sum().backward()
            (first, second) = back()
            gradients = [tensor.grad for tensor in splats.tensors().values()]
            results.append([output.color, first.absgrad, second.contribution, *gradients])
    finally:
        torch.set_num_threads(before)
    for one, other in zip(*results, strict=True):
        assert torch.equal(one, other)


def test_absolute_gradients_of_flat_splats_are_refused():
    settings = RenderSettings(statistics=frozenset({Statistic.ABSGRAD}))
    with pytest.raises(ConfigError, match="has no kernels that add them up over bands"):
        FlatBands(ReferenceRasterizer(), scene(), views(), settings, BANDS)
