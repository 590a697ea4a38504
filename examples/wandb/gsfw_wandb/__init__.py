"""Runs of gsfw in Weights & Biases."""

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_callbacks() -> list[Spec]:
    return [
        Spec(
            "wandb",
            "curves, images and settings in Weights & Biases",
            "gsfw_wandb.callback:WandbConfig",
        )
    ]
