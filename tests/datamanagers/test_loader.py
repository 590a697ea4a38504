"""Batches are the same on every device, whatever stays there."""

import numpy as np
import pytest
import torch
from support.scenes import front_camera
from support.slow_ship import SlowShip

from gsfw.core.datamanager import Split, Views
from gsfw.datamanagers.image_cache import ImageCache
from gsfw.datamanagers.images import DecodedImage
from gsfw.datamanagers.loader import Loader

CPU = torch.device("cpu")
WIDTH, HEIGHT = 6, 4
BYTES = WIDTH * HEIGHT * 5


def image(number: int) -> DecodedImage:
    """Every third has alpha, every second a mask."""
    values = np.arange(WIDTH * HEIGHT * 4, dtype=np.uint8).reshape(HEIGHT, WIDTH, 4) + number
    mask = values[..., 0] > 40 if number % 2 else None
    return DecodedImage(values if number % 3 == 0 else values[..., :3].copy(), mask)


def views(count: int) -> Views:
    cameras = tuple(front_camera(WIDTH, HEIGHT, distance=4.0 + i) for i in range(count))
    return Views(tuple(f"v{i}" for i in range(count)), cameras)


@pytest.fixture
def loader():
    built = []

    def build(**settings) -> Loader:
        cache = ImageCache(image, [BYTES] * 8, 10_000)
        splits = {Split.TRAIN: views(6), Split.EVAL: views(2)}
        built.append(Loader(splits, cache, **settings))
        return built[-1]

    yield build
    for item in built:
        item.close()


def same(one, two) -> bool:
    pairs = [(getattr(one, name), getattr(two, name)) for name in ("images", "alpha", "mask")]
    return all(
        (a is None) == (b is None) and (a is None or torch.equal(a, b)) for a, b in pairs
    ) and torch.equal(one.cameras.world_to_camera, two.cameras.world_to_camera)


def test_images_with_and_without_alpha_and_mask_share_a_batch(loader):
    (batch,) = loader().load(Split.TRAIN, [0, 1], CPU)
    assert batch.images.shape == (2, HEIGHT, WIDTH, 3)
    assert batch.views == (0, 1)
    assert torch.equal(batch.images[0, 0, 1], torch.tensor([4.0, 5.0, 6.0]) / 255)
    assert torch.equal(batch.alpha[0, 0, 1], torch.tensor([7.0]) / 255)
    assert bool((batch.alpha[1] == 1).all())
    assert bool(batch.mask[0].all())
    assert batch.mask[1, :, :, 0].tolist() == image(1).mask.tolist()
    (plain,) = loader().load(Split.TRAIN, [2], CPU)
    assert (plain.alpha, plain.mask) == (None, None)


def test_batches_are_the_same_whatever_way_the_images_take(loader):
    plain = loader()
    for budget in (0, 3 * BYTES, 100 * BYTES):
        ship = SlowShip()
        shipped = loader(gpu_budget=budget, way_to=lambda _, ship=ship: ship)
        for _ in range(2):
            for split, indices in ((Split.TRAIN, [0, 1]), (Split.TRAIN, [5]), (Split.EVAL, [1])):
                shipped.prefetch(split, indices)
                (found,) = shipped.load(split, indices, CPU)
                (wanted,) = plain.load(split, indices, CPU)
                assert same(found, wanted)
        assert len(ship.sent) == {0: 8, 3 * BYTES: 6, 100 * BYTES: 4}[budget]


def test_the_images_that_are_trained_on_stay_first_and_the_user_is_told(loader):
    assert loader().notes() == ()
    assert loader(gpu_budget=8 * BYTES).notes() == ()
    assert loader(gpu_budget=7 * BYTES).notes() == (
        "7 of 8 images stay on the GPU (gpu_cache_mb=0), the others are copied to it for each use",
    )


def test_a_loader_may_change_its_device(loader):
    moving = loader(gpu_budget=1000)
    (here,) = moving.load(Split.TRAIN, [3], CPU)
    (there,) = moving.load(Split.TRAIN, [3], torch.device("meta"))
    devices = {there.images.device.type, there.mask.device.type, there.alpha.device.type}
    assert devices == {there.cameras.intrinsics.device.type} == {"meta"}
    (back,) = moving.load(Split.TRAIN, [3], CPU)
    assert same(here, back)


@pytest.mark.cuda
def test_batches_on_a_gpu_are_those_of_the_cpu(loader):
    if not torch.cuda.is_available():
        pytest.skip("torch sees no GPU here")
    gpu = torch.device("cuda", torch.cuda.current_device())
    plain = loader()
    for budget in (0, 3 * BYTES, 100 * BYTES):
        there = loader(gpu_budget=budget)
        for step in range(12):
            there.prefetch(Split.TRAIN, [(step + 1) % 6, (step + 2) % 6])
            (found,) = there.load(Split.TRAIN, [step % 6], gpu)
            (wanted,) = plain.load(Split.TRAIN, [step % 6], CPU)
            assert found.images.device == found.cameras.intrinsics.device == gpu
            # A GPU divides by multiplying with the inverse, which may cost the last bit.
            torch.testing.assert_close(found.images.cpu(), wanted.images, rtol=2e-7, atol=0)
            assert (found.mask is None) == (wanted.mask is None)
