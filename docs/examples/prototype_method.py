"""A prototype method: isotropic blobs with their own model, loss and schedule, for strategy=none.

Try it: put this file on the Python path, register it as docs/extending.md says, then
``gsfw train method=blobs strategy=none``.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.api import (
    Column,
    LearningRate,
    Method,
    MethodConfig,
    PrimitiveModel,
    Spec,
    Splats,
    hookimpl,
    number,
)


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [Spec("blobs", "isotropic Gaussians of one colour", f"{__name__}:BlobsConfig")]


@dataclass
class BlobsConfig(MethodConfig):
    """Isotropic Gaussians."""

    count: int = number(2000, at_least=1)
    """Number of blobs."""
    rate: float = number(0.02, above=0)
    """Learning rate of everything; positions times the extent."""

    def build(self) -> Method:
        return Blobs(self)


class BlobModel(PrimitiveModel):
    def __init__(self, means, colors, size, rates):
        super().__init__()
        self.means = Column(means, rates["means"])
        self.colors = Column(colors, rates["others"])
        self.log_sizes = Column(torch.full((len(means),), float(size)).log(), rates["others"])
        self.logits = Column(torch.zeros(len(means)), rates["others"])

    def columns(self):
        names = ("means", "colors", "log_sizes", "logits")
        return {name: getattr(self, name) for name in names}

    def splats(self, time=None, cameras=None):
        means, scales = self.means.values, self.log_sizes.values.exp()[:, None].expand(-1, 3)
        quats = torch.eye(1, 4, device=means.device).expand(len(means), 4)
        return Splats(means, self.logits.values.sigmoid(), self.colors.values, quats, scales)


class Blobs(Method):
    def __init__(self, config):
        self.config = config

    def build_model(self, scene, operators, generator, initial):
        chosen = torch.randint(max(len(scene.points), 1), (self.config.count,), generator=generator)
        rate = self.config.rate
        final = LearningRate(0.1 * rate * scene.extent, 0.001 * rate * scene.extent, 1000)
        rates = {"means": final, "others": LearningRate(rate)}
        points, colors = scene.points[chosen], scene.point_colors[chosen]
        return BlobModel(points, colors, 0.02 * scene.extent, rates)

    def losses(self, context):
        return {"mse": (context.rendered.color - context.target).square().mean()}
