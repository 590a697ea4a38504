"""Methods for moving scenes, to extend: their settings and their training.

Derive from one of the methods: its ``canonical_method`` makes the canonical Gaussians, as method
3dgs does, with ``model_class`` and ``extra_columns``; the ``build`` of its configuration makes it.
"""

from gsfw.methods.gaussians4d.config import DeformationConfig
from gsfw.methods.gaussians4d.method import DeformationMethod
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig
from gsfw.methods.rotor4d.method import SlicedGaussiansMethod
from gsfw.methods.spacetime.config import SpacetimeConfig
from gsfw.methods.spacetime.method import SpacetimeMethod

__all__ = [
    "DeformationConfig",
    "DeformationMethod",
    "SlicedGaussiansConfig",
    "SlicedGaussiansMethod",
    "SpacetimeConfig",
    "SpacetimeMethod",
]
