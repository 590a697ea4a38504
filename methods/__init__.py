"""Primitive models and the methods built on them: one folder per method."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_methods() -> list[Spec]:
    """The built-in methods."""
    return [
        Spec(
            "3dgs",
            "static 3D Gaussians with spherical-harmonic colours",
            "gsfw.methods.static_gaussians.config:StaticGaussiansConfig",
            paper="Kerbl et al. 2023",
            tags=frozenset({"static"}),
        )
    ]
