"""Method 3dgs with a trained column more: each Gaussian has a label that is rendered and fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gsfw.api import (
    Column,
    Feature,
    LearningRate,
    Needs,
    Spec,
    StaticGaussians,
    StaticGaussiansConfig,
    StaticGaussiansMethod,
    hookimpl,
)


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [Spec("3dgs-bright", "3dgs that learns brightness", f"{__name__}:BrightConfig")]


@dataclass
class BrightConfig(StaticGaussiansConfig):
    def needs(self) -> Needs:
        return super().needs() | Needs(features=frozenset({Feature.EXTRA}), extra_channels=1)

    def build(self):
        return Bright(self)


class BrightGaussians(StaticGaussians):
    def splats(self, time=None, cameras=None):
        return replace(super().splats(time, cameras), extra=self.extra["brightness"].values)


class Bright(StaticGaussiansMethod):
    model_class = BrightGaussians

    def extra_columns(self, scene, count):
        brightness = scene.point_colors.new_zeros(count, 1)
        return {"brightness": Column(brightness, LearningRate(0.01))}

    def losses(self, context):
        return {**super().losses(context), "brightness": 0.1 * brightness_error(context)}

    def view_metrics(self, context):
        return {"brightness_error": float(brightness_error(context))}


def brightness_error(context):
    """Mean error over black: extra channels are rendered over 0."""
    wanted = context.batch.target(context.target.new_zeros(3)).mean(dim=-1, keepdim=True)
    return (context.rendered.extra - wanted).abs().mean()
