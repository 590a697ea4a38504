"""Promises of metrics: valid pixels alone count, and every figure is finite."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.metrics import Metric
from gsfw.testing.promise import Promise, require
from gsfw.testing.subject import Subject

WIDTH, HEIGHT = 24, 20
"""Size of the images: larger than the window of SSIM."""
CHANGES = 4
"""Random contents of invalid pixels that are tried."""


def _image(seed: int) -> Float[Tensor, "h w 3"]:
    return torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(seed))


def _left_half() -> Bool[Tensor, "h w 1"]:
    return (torch.arange(WIDTH) < WIDTH // 2).expand(HEIGHT, WIDTH)[..., None].contiguous()


def _valid_is_honoured(subject: Subject) -> None:
    metric, valid = _metric(subject), _left_half()
    rendered, target = _image(0), _image(1)
    expected = metric(rendered, target, valid)
    for seed in range(2, 2 + CHANGES):
        # A window may reach across the border of the mask, in the render and the target alike.
        noise = _image(seed)
        found = metric(
            torch.where(valid, rendered, noise), torch.where(valid, target, noise), valid
        )
        outside = torch.where(valid, rendered, 1 - noise)
        found_apart = metric(outside, torch.where(valid, target, noise), valid)
        for value in (found, found_apart):
            require(
                math.isclose(value, expected, rel_tol=1e-4, abs_tol=1e-5),
                f"the figure is {expected:.6g}, and {value:.6g} when pixels outside valid change.",
                "Take the mean over the pixels where valid is true, and set all others to one "
                "value in both images before any window or network.",
            )


def _equal_images_are_finite(subject: Subject) -> None:
    metric, image = _metric(subject), _image(0)
    for name, shade in (("equal images", image), ("black images", torch.zeros_like(image))):
        for valid in (None, _left_half()):
            found = metric(shade, shade.clone(), valid)
            require(
                math.isfinite(found),
                f"the figure of two {name} is {found}.",
                "Bound it, as gsfw bounds PSNR at 100 dB: means over views have to stay finite.",
            )


def _figures_are_numbers(subject: Subject) -> None:
    metric = _metric(subject)
    cases = {
        "an image and its negative": (_image(0), 1 - _image(0)),
        "colours outside [0, 1]": (_image(0) * 3 - 1, _image(1)),
        "one colour": (torch.zeros(HEIGHT, WIDTH, 3), torch.ones(HEIGHT, WIDTH, 3)),
    }
    for name, (rendered, target) in cases.items():
        found = metric(rendered, target, None)
        is_number = isinstance(found, int | float) and not math.isnan(found)
        require(
            is_number,
            f"the figure for {name} is {found!r}.",
            "Return a plain number that is not NaN.",
        )


def _images_stay_as_they_are(subject: Subject) -> None:
    rendered, target, valid = _image(0) * 2 - 0.5, _image(1), _left_half()
    copies = [tensor.clone() for tensor in (rendered, target, valid)]
    _metric(subject)(rendered, target, valid)
    same = all(map(torch.equal, copies, (rendered, target, valid)))
    require(same, "an image has changed.", "Use no in-place operation: clamp, not clamp_.")


def _metric(subject: Subject) -> Metric:
    metric: Metric = subject.target()
    return metric


PROMISES = (
    Promise(
        "honours-valid",
        "Pixels outside valid have no influence on the figure.",
        _valid_is_honoured,
    ),
    Promise(
        "equal-images-are-finite",
        "The figure of two equal images is finite.",
        _equal_images_are_finite,
    ),
    Promise(
        "figures-are-numbers",
        "The figure of any finite images is a number, and not NaN.",
        _figures_are_numbers,
    ),
    Promise(
        "changes-no-image",
        "It does not change its images.",
        _images_stay_as_they_are,
    ),
)
