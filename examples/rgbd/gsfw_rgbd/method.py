"""Method 3dgs-depth: 3dgs whose depth is held to a per-view map named "depth".

The loss is that of Turkulainen et al. 2024, "DN-Splatter": the logarithm of the depth error,
weighted less at edges of the image, where depth sensors err.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from gsfw.api import (
    ConfigError,
    Depth,
    Feature,
    Needs,
    StaticGaussiansConfig,
    StaticGaussiansMethod,
    number,
)

MAP = "depth"
"""Name of the per-view map; z along the camera's axis, in scene units."""
SOLID = 0.5
"""Pixels that Gaussians cover less have no depth to compare or to show."""


@dataclass
class DepthConfig(StaticGaussiansConfig):
    """3D Gaussians held to measured depths."""

    depth_weight: float = number(0.2, at_least=0)
    """Weight of the depth loss; 0: depth is measured, and not trained on."""

    def needs(self) -> Needs:
        return super().needs() | Needs(features=frozenset({Feature.DEPTH}))

    def build(self):
        return DepthMethod(self)


class DepthMethod(StaticGaussiansMethod):
    def begin(self, scene, views, model):
        if MAP not in views.maps:
            raise ConfigError(
                f"method 3dgs-depth: the data has no per-view map {MAP!r}.",
                "Name a folder of depth maps, datamanager.maps=depth:FOLDER, or take a format that "
                "has them, such as tum-rgbd.",
            )
        # The number that lengths in scene units are multiplied with for the data's own unit.
        self.unit = scene.world_from_scene.scale

    def render_settings(self, settings, step):
        return replace(settings, depth=Depth.EXPECTED)

    def losses(self, context):
        losses = super().losses(context)
        weight = self.config.depth_weight
        if weight == 0:
            return losses
        measured = context.batch.maps[MAP]
        error = (context.rendered.depth - measured.values).abs() / context.extent
        term = measured.mean(flatness(context.target) * error.log1p())
        return {**losses, "depth": weight * term}

    def view_metrics(self, context):
        """Mean absolute error of depth in the data's unit, where both depths are known."""
        measured, rendered = context.batch.maps.get(MAP), context.rendered
        if measured is None or rendered.depth is None:
            return {}
        both = replace(measured, known=measured.known & (rendered.alpha > SOLID))
        error = both.mean((rendered.depth - measured.values).abs())
        return {"depth_error": float(error) * self.unit}

    def view_images(self, context):
        """Measured and rendered depth, near is bright; black where unknown."""
        measured, rendered = context.batch.maps.get(MAP), context.rendered
        if measured is None or rendered.depth is None:
            return {}
        depth, known = measured.values[0], measured.known[0]
        near, far = (depth[known].min(), depth[known].max()) if bool(known.any()) else (0.0, 1.0)

        def shown(values, where):
            bright = 1 - 0.9 * ((values - near) / (far - near + 1e-9)).clamp(0, 1)
            return torch.where(where, bright, 0.0).expand(-1, -1, 3)

        rendered_depth = shown(rendered.depth[0], rendered.alpha[0] > SOLID)
        return {"measured_depth": shown(depth, known), "depth": rendered_depth}


def flatness(images):
    """exp(-|gradient|) of images [c, h, w, 3]: 1 where flat, less at edges; [c, h, w, 1]."""
    down = torch.nn.functional.pad((images[:, 1:] - images[:, :-1]).abs(), (0, 0, 0, 0, 0, 1))
    right = torch.nn.functional.pad((images[:, :, 1:] - images[:, :, :-1]).abs(), (0, 0, 0, 1))
    return (-(down + right).mean(dim=-1, keepdim=True)).exp()
