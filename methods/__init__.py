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
            "gsfw.methods.gaussians3d.config:StaticGaussiansConfig",
            paper="Kerbl et al. 2023",
            tags=frozenset({"static"}),
        ),
        Spec(
            "spacetime",
            "Gaussians on polynomial paths that come and go in time",
            "gsfw.methods.spacetime.config:SpacetimeConfig",
            paper="Li et al. 2024",
            tags=frozenset({"dynamic"}),
        ),
        Spec(
            "4d-rotor",
            "Gaussians of space and time, sliced at an instant",
            "gsfw.methods.rotor4d.config:SlicedGaussiansConfig",
            paper="Duan et al. 2024",
            tags=frozenset({"dynamic"}),
        ),
        Spec(
            "4dgs",
            "canonical Gaussians that a field of space and time deforms",
            "gsfw.methods.gaussians4d.config:DeformationConfig",
            paper="Wu et al. 2024",
            tags=frozenset({"dynamic"}),
        ),
        Spec(
            "dynamic3dgs",
            "persistent Gaussians that are tracked from each time to the next",
            "gsfw.methods.dynamic3d.config:TrackedGaussiansConfig",
            paper="Luiten et al. 2024",
            tags=frozenset({"dynamic"}),
        ),
    ]
