"""Surfels for gsfw, after 2DGS (Huang et al. 2024)."""

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [
        Spec(
            "2dgs",
            "flat Gaussians with normals, depth distortion and normal consistency",
            "gsfw_2dgs.method:SurfelsConfig",
            paper="after Huang et al. 2024",
            tags=frozenset({"static"}),
        )
    ]
