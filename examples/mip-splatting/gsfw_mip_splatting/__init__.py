"""Mip-Splatting for gsfw (Yu et al. 2024)."""

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [
        Spec(
            "mip-splatting",
            "3D Gaussians no finer than the training cameras can sample",
            "gsfw_mip_splatting.method:MipSplattingConfig",
            paper="Yu et al. 2024",
            tags=frozenset({"static"}),
        )
    ]
