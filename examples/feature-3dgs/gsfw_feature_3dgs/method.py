"""Method feature-3dgs: each Gaussian has a feature, which is rendered and fitted to feature maps.

Zhou et al. 2024, "Feature 3DGS". Features are blended like colours; the loss has the mean
absolute difference to the maps. Maps with more channels than a Gaussian has are reached through
one linear layer (their speed-up module, a 1x1 convolution).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch.nn.functional import cosine_similarity, interpolate

from gsfw.api import (
    Column,
    Feature,
    LearningRate,
    Needs,
    ParameterGroup,
    StaticGaussians,
    StaticGaussiansConfig,
    StaticGaussiansMethod,
    number,
)
from gsfw_feature_3dgs.extractors import find_extractor
from gsfw_feature_3dgs.images import heat, principal_colors

MAP = "features"
"""Per-view map that takes the place of the extractor: datamanager.maps=features:FOLDER."""


@dataclass
class FeatureConfig(StaticGaussiansConfig):
    """Gaussians with features (Zhou et al. 2024)."""

    width: int = number(16, at_least=1)
    """Channels of a Gaussian. Maps with fewer take as many; those with more are decoded from it."""
    extractor: str = "colors"
    """Extractor of feature maps, unless the data brings some, and of words: colors, or
    package.module:Name."""
    feature_weight: float = number(1.0, above=0)
    """Weight of the mean absolute difference of features in the loss."""
    features_lr: float = number(2.5e-3, above=0)
    """Learning rate of features."""
    decoder_lr: float = number(1e-3, above=0)
    """Learning rate of the linear layer."""
    query: str = ""
    """Words whose heat map evaluations and gsfw render show beside the features."""

    def needs(self) -> Needs:
        extra = Needs(features=frozenset({Feature.EXTRA}), extra_channels=self.width)
        return super().needs() | extra

    def build(self):
        return FeatureMethod(self)


class FeatureGaussians(StaticGaussians):
    """``decoder`` is set before training if maps have more channels than a Gaussian."""

    decoder: torch.nn.Linear | None
    decoder_rate = 0.0

    def __init__(self, start, rates, degrees=None, extra=None):
        super().__init__(start, rates, degrees, extra)
        self.register_module("decoder", None)

    def splats(self, time=None, cameras=None):
        features = self.extra["features"].values
        # Without a camera, they are for a file, which has no decoder.
        return replace(
            super().splats(time, cameras),
            extra=features if cameras is not None else self.decoded(features),
        )

    def decoded(self, features):
        """Features [..., width] in the channels of the maps."""
        return features if self.decoder is None else self.decoder(features)

    def parameter_groups(self):
        if self.decoder is None:
            return ()
        rate = LearningRate(self.decoder_rate)
        return (ParameterGroup("decoder", (self.decoder.weight,), rate),)


class FeatureMethod(StaticGaussiansMethod):
    model_class = FeatureGaussians
    model: FeatureGaussians

    def __init__(self, config):
        super().__init__(config)
        self.extracted: dict[tuple[int, ...], torch.Tensor] = {}

    @cached_property
    def extractor(self):
        """The extractor, constructed at the first image or word: never to open or export a run."""
        return find_extractor(self.config.extractor)()

    def extra_columns(self, scene, count):
        values = scene.points.new_zeros(count, self.config.width)
        return {"features": Column(values, LearningRate(self.config.features_lr))}

    def begin(self, scene, views, model):
        width = self.config.width
        channels = views.maps.get(MAP) or find_extractor(self.config.extractor).channels
        self.model = model
        if channels < width:
            column = model.extra["features"]
            model.extra["features"] = Column(column.values[:, :channels], column.learning_rate)
        elif channels > width:
            # Zero features would give a decoder no gradient: it starts as a part of the identity.
            model.decoder = torch.nn.Linear(width, channels, bias=False)
            torch.nn.init.eye_(model.decoder.weight)
            model.decoder_rate = self.config.decoder_lr

    def wanted(self, batch):
        """The feature maps of a batch at its size: those of the data, or else extracted ones."""
        if MAP in batch.maps:
            return batch.maps[MAP].values
        with torch.no_grad():
            found = self.extractor.features(batch.images).movedim(-1, 1)
            size = batch.images.shape[1:3]
            found = interpolate(found, size, mode="bilinear", antialias=True)
        return found.movedim(1, -1)

    def trained(self, batch):
        """The same of a training batch, extracted once for each size of an image."""
        # Numbers of views count within a split: held-out views must not be looked up here.
        key = (*batch.images.shape[1:3], *batch.views)
        if key not in self.extracted:
            self.extracted[key] = self.wanted(batch)
        return self.extracted[key]

    def losses(self, context):
        batch, found = context.batch, self.model.decoded(context.rendered.extra)
        if MAP in batch.maps:
            term = batch.maps[MAP].mean((found - self.wanted(batch)).abs())
        else:
            term = (found - self.trained(batch)).abs().mean()
        return {**super().losses(context), "features": self.config.feature_weight * term}

    def view_metrics(self, context):
        """Mean cosine similarity of rendered features and those of the maps, where opaque."""
        batch, rendered = context.batch, context.rendered
        found = self.model.decoded(rendered.extra)
        similar = cosine_similarity(found, self.wanted(batch), dim=-1)
        weights = rendered.alpha[..., 0]
        if MAP in batch.maps:
            weights = weights * batch.maps[MAP].known[..., 0]
        return {"feature_cosine": float((similar * weights).sum() / weights.sum().clamp_min(1e-6))}

    def view_images(self, context):
        """The first three principal components of the features, and the heat map of the query."""
        found = {"features": principal_colors(self.model, context.rendered)}
        if self.config.query:
            vector = self.extractor.words(self.config.query)
            found["query"] = heat(self.relevance(context.rendered, vector))
        return found

    def relevance(self, rendered, vector):
        """Resemblance of each pixel of the first image to a feature: [h, w] in [0, 1]."""
        found = self.model.decoded(rendered.extra[0])
        similar = cosine_similarity(found, vector.to(found), dim=-1)
        return similar.clamp(0, 1) * rendered.alpha[0, ..., 0]
