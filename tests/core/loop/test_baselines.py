"""Baselines: what a colour, a mean image and an image that stands still would score."""

import pytest
import torch
from support.moving_scene import WHITE, MovingImages

from gsfw.core.datamanager import Split
from gsfw.core.loop.baselines import NO_STILL, Baselines, best_constant
from gsfw.core.metrics import psnr

CPU = torch.device("cpu")
FIXED = [(0.0, 3.0), (0.5, 3.0), (1.0, 3.0)]
MOVING = torch.ones(24, 32, 1, dtype=torch.bool)


def measured(data, moving=None) -> Baselines:
    baselines = Baselines(data, Split.EVAL, WHITE.background, CPU)
    for index, image in enumerate(data.images[Split.EVAL]):
        baselines.compare(index, image[0], data.valid, moving)
    return baselines


def mean_psnr(image, data) -> float:
    found = [psnr(image.expand_as(target[0]), target[0]) for target in data.images[Split.EVAL]]
    return sum(found) / len(found)


def test_the_constant_is_the_mean_colour_of_the_training_images():
    data = MovingImages(FIXED)
    colour = torch.cat(data.images[Split.TRAIN]).mean((0, 1, 2))
    assert measured(data).figures()["constant_psnr"] == pytest.approx(mean_psnr(colour, data))


def test_the_background_is_the_best_colour_where_most_images_show_nothing_else():
    white, image = torch.ones(9, 3), torch.full((1, 3), 0.5)
    means = torch.cat([white, image])
    assert torch.equal(best_constant(means, means**2, torch.ones(3)), torch.ones(3))
    assert torch.equal(best_constant(image, image**2, torch.ones(3)), image[0])


def test_the_mean_image_is_that_of_the_training_images_of_the_same_size():
    data = MovingImages(FIXED)
    image = torch.cat(data.images[Split.TRAIN]).mean(0)
    assert measured(data).figures()["mean_image_psnr"] == pytest.approx(mean_psnr(image, data))


def test_a_fixed_camera_with_training_images_has_a_still_image():
    data = MovingImages([(0.5, 3.0)], train=[(0.0, 3.0), (1.0, 3.0), (0.0, 5.0)])
    image = torch.cat(data.images[Split.TRAIN][:2]).mean(0)
    figures = measured(data, MOVING).figures()
    assert figures["still_psnr"] == pytest.approx(mean_psnr(image, data))
    assert figures["still_moving_psnr"] == figures["still_psnr"], "all pixels were said to move"


def test_a_moving_camera_has_none_and_says_so():
    document = measured(MovingImages([(0.5, 4.0)])).document()
    assert "still_psnr" not in document
    assert document["still"] == NO_STILL


def test_a_static_capture_speaks_of_no_still_image():
    data = MovingImages([(None, 3.0)], train=[(None, 4.0)])
    assert set(measured(data).document()) == {
        "constant_psnr", "mean_image_psnr", "constant", "mean_image",
    }  # fmt: skip


def test_pixels_that_are_not_valid_count_in_no_baseline():
    valid = torch.ones(24, 32, 1, dtype=torch.bool)
    valid[:14] = False
    data = MovingImages(FIXED, valid=valid)
    colour = torch.cat(data.images[Split.TRAIN])[:, 14:].mean((0, 1, 2))
    wanted = [
        psnr(colour.expand_as(image[0]), image[0], valid) for image in data.images[Split.EVAL]
    ]
    found = measured(data).figures()["constant_psnr"]
    assert found == pytest.approx(sum(wanted) / len(wanted))


def test_each_view_is_measured_once():
    data = MovingImages(FIXED)
    baselines = measured(data)
    before = baselines.figures()
    data.images[Split.EVAL] = [image * 0 for image in data.images[Split.EVAL]]
    baselines.compare(0, data.images[Split.EVAL][0][0], None, None)  # Another image by now.
    assert baselines.figures() == before
