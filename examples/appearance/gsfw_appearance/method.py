"""Method 3dgs-appearance: each training image has an appearance that only training sees.

Lin et al. 2024, "VastGaussian" (decoupled appearance modelling). The render times the factors of
the image's appearance is compared by L1; SSIM compares the plain render, so that structure comes
from the Gaussians. Afterwards the appearances are dropped: renders have the mean look of the
collection.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.api import (
    LearningRate,
    ParameterGroup,
    StaticGaussians,
    StaticGaussiansConfig,
    StaticGaussiansMethod,
    number,
    steps_field,
)
from gsfw_appearance.network import Appearance

LARGEST = 2.0
"""Logarithms of factors are within this: factors of 1/7 to 7."""
OPAQUE = 0.99
"""Pixels of images with alpha that have a colour of their own, without background."""


@dataclass
class AppearanceConfig(StaticGaussiansConfig):
    """3D Gaussians with appearance embeddings (after Lin et al. 2024)."""

    width: int = number(32, at_least=1)
    """Numbers of an image's embedding."""
    channels: int = number(32, at_least=1)
    """Channels of the network."""
    appearance_lr: float = number(5e-3, above=0)
    """Learning rate of embeddings and network."""
    appearance_start: int = steps_field(500)
    """Steps before appearances are learnt, in which splats learn the mean look."""
    center_weight: float = number(0.1, at_least=0)
    """Weight of the squared mean logarithm of factors, which holds their mean look at that of the
    splats: else darker splats and larger factors are the same."""

    def build(self):
        return AppearanceMethod(self)


class Gaussians(StaticGaussians):
    """Gaussians with the appearances of the training images, which the optimizer trains."""

    appearance: Appearance
    rate: LearningRate

    def parameter_groups(self):
        return (ParameterGroup("appearance", tuple(self.appearance.parameters()), self.rate),)


class AppearanceMethod(StaticGaussiansMethod):
    model_class = Gaussians

    def begin(self, scene, views, model):
        config, generator = self.config, torch.Generator().manual_seed(self.config.seed)
        model.appearance = Appearance(len(views), config.width, config.channels, generator)
        model.rate = LearningRate(config.appearance_lr)
        self.appearance = model.appearance

    def losses(self, context):
        if context.step < self.config.appearance_start:
            return super().losses(context)
        rendered, target, valid = context.rendered.color, context.target, context.batch.valid
        weight = self.config.ssim_weight
        logs = self.appearance.log_factors(rendered, context.batch.views).clamp(-LARGEST, LARGEST)
        # The background behind the splats is no part of the photo.
        shown = rendered * (1 + context.rendered.alpha.detach() * (logs.exp() - 1))
        l1, _ = context.operators.l1_dssim(shown, target, valid)
        _, dssim = context.operators.l1_dssim(rendered, target, valid)
        center = logs.mean(dim=(0, 1, 2)).square().sum()
        return {
            "l1": (1 - weight) * l1,
            "dssim": weight * dssim,
            "center": self.config.center_weight * center,
        }

    def view_metrics(self, context):
        """PSNR after the affine map of colours that fits best: held-out photos have a look too."""
        batch, rendered = context.batch, context.rendered
        known = [batch.valid, None if batch.coverage is None else batch.coverage > OPAQUE]
        where = torch.ones_like(rendered.alpha, dtype=torch.bool)
        for part in known:
            where = where if part is None else where & part
        colors, wanted = (image[where[..., 0]].double() for image in (rendered.color, batch.images))
        if len(colors) < 4:
            return {}
        affine = torch.cat([colors, torch.ones_like(colors[:, :1])], dim=1)
        fitted = affine @ torch.linalg.lstsq(affine, wanted).solution
        error = (fitted.clamp(0, 1) - wanted).square().mean()
        return {"psnr_fitted": float(-10 * torch.log10(error.clamp_min(1e-10)))}
