"""Appearance embeddings for gsfw (after Lin et al. 2024)."""

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [
        Spec(
            "3dgs-appearance",
            "3D Gaussians of photos with changing light and exposure",
            "gsfw_appearance.method:AppearanceConfig",
            paper="after Lin et al. 2024",
            tags=frozenset({"static"}),
        )
    ]
