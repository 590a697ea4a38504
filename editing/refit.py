"""Refit: constant colours of splats such that their renders are nearest to given images.

A render is linear in the constant coefficients while no colour is clamped at 0: with W the matrix
of blending weights, W c = image. The least-squares change solves W^T W d = W^T (image - render),
here by conjugate gradients, for which one render and its backward pass are a product with W^T W.
The row sums of W^T W are at most the contributions, which makes them a good preconditioner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras, resized_by
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.progress import tracked
from gsfw.core.splats import Sh, Splats
from gsfw.editing.capture import Capture

STEPS = 10
"""Steps of conjugate gradients; the built-in scene, at a half and a quarter of its splats, gains
less than 0.01 dB from ten more, and loses as little with five."""
STIFFNESS = 1.0
"""Weight of a colour as it is, in pixels: splats that are hardly seen keep theirs."""
MOST_PIXELS = 200_000
"""Pixels of a view; larger ones are shrunk."""


@dataclass(frozen=True)
class Comparison:
    """The views in which splats are compared with others."""

    capture: Capture
    cameras: Sequence[Cameras]
    """At most ``MOST_PIXELS`` each."""

    @staticmethod
    def of(capture: Capture) -> Comparison:
        """Some views of a capture."""
        return Comparison(capture, [_small(camera) for camera in capture.sampled()])

    @torch.no_grad()
    def render(self, splats: Splats, camera: Cameras) -> Float[Tensor, "h w 3"]:
        """One view of splats in the scene frame."""
        seen = camera.to(self.capture.device)
        return self.capture.rasterizer.render(splats, seen, self.capture.settings).color[0]

    def images(self, splats: Splats) -> list[Float[Tensor, "h w 3"]]:
        """All views of splats in the scene frame."""
        return [self.render(splats, camera) for camera in self.cameras]

    def psnr(self, splats: Splats, targets: Sequence[Float[Tensor, "h w 3"]]) -> float:
        """PSNR against images of these views, in dB, of the mean squared error of all."""
        errors, count = 0.0, 0
        for camera, target in zip(self.cameras, targets, strict=True):
            found = self.render(splats, camera).clamp(0, 1)
            errors += float((found - target.clamp(0, 1)).double().square().sum())
            count += target.numel()
        return -10.0 * float(torch.tensor(max(errors / max(count, 1), 1e-12)).log10())


def _small(camera: Cameras) -> Cameras:
    return resized_by(camera, min(1.0, (MOST_PIXELS / (camera.width * camera.height)) ** 0.5))


def refitted(
    splats: Splats,
    comparison: Comparison,
    targets: Sequence[Float[Tensor, "h w 3"]],
    contributions: Float[Tensor, " n"],
    steps: int = STEPS,
) -> Splats:
    """Splats whose constant colours are refitted to images.

    Args:
        splats: in the scene frame, float32, with SH colours.
        comparison: the views.
        targets: the image of each view.
        contributions: of each splat to these views, in pixels.
        steps: steps of conjugate gradients.
    """
    right = _pull(splats, comparison, targets)
    weights = contributions.to(right)[:, None] + STIFFNESS
    change, residual = torch.zeros_like(right), right
    scaled = residual / weights
    toward, size = scaled, (residual * scaled).sum()
    for _ in tracked(range(steps), "refitting colours", steps):
        if float(size) <= 0:
            break
        product = _normal(splats, comparison, toward) + STIFFNESS * toward
        length = size / (toward * product).sum().clamp_min(1e-30)
        change, residual = change + length * toward, residual - length * product
        scaled = residual / weights
        new = (residual * scaled).sum()
        toward, size = scaled + new / size.clamp_min(1e-30) * toward, new
    assert isinstance(splats.colors, Sh)
    dense = splats.colors.dense().clone()
    dense[:, 0] += change / C0
    return replace(splats, colors=Sh(dense, splats.colors.degree))


def _pull(
    splats: Splats, comparison: Comparison, targets: Sequence[Float[Tensor, "h w 3"]]
) -> Float[Tensor, "n 3"]:
    """W^T applied to what is missing of the targets."""
    total = torch.zeros(len(splats), 3, device=splats.means.device)
    for camera, target in zip(comparison.cameras, targets, strict=True):
        plain = torch.zeros_like(total).requires_grad_()
        missing = target - comparison.render(splats, camera)
        image = _plain(splats, comparison, camera, plain)
        (gradient,) = torch.autograd.grad(image, plain, missing)
        total += gradient
    return total


def _normal(
    splats: Splats, comparison: Comparison, colors: Float[Tensor, "n 3"]
) -> Float[Tensor, "n 3"]:
    """W^T W applied to colours."""
    total = torch.zeros_like(colors)
    for camera in comparison.cameras:
        plain = colors.detach().requires_grad_()
        image = _plain(splats, comparison, camera, plain)
        (gradient,) = torch.autograd.grad(image, plain, image.detach())
        total += gradient
    return total


def _plain(
    splats: Splats, comparison: Comparison, camera: Cameras, colors: Float[Tensor, "n 3"]
) -> Float[Tensor, "h w 3"]:
    """W applied to colours: a render over black."""
    capture = comparison.capture
    settings = replace(capture.settings, background=None)
    plain = replace(splats, colors=colors)
    return capture.rasterizer.render(plain, camera.to(capture.device), settings).color[0]
