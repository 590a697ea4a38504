"""Methods for moving scenes, to extend: their settings, their models and their training.

For a motion of one's own, derive from ``MovingConfig``, ``MovingGaussians`` and ``MovingMethod``.
For other losses or columns, derive from one of the methods: its ``canonical_method`` makes the
canonical Gaussians, as method 3dgs does, with ``model_class`` and ``extra_columns``.
"""

from gsfw.methods.gaussians4d.config import DeformationConfig
from gsfw.methods.gaussians4d.method import DeformationMethod
from gsfw.methods.moving.config import MovingConfig
from gsfw.methods.moving.gaussians import MovingGaussians
from gsfw.methods.moving.method import MovingMethod
from gsfw.methods.moving.still_rows import StillRows
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig
from gsfw.methods.rotor4d.method import SlicedGaussiansMethod
from gsfw.methods.spacetime.config import SpacetimeConfig
from gsfw.methods.spacetime.method import SpacetimeMethod

__all__ = [
    "DeformationConfig",
    "DeformationMethod",
    "MovingConfig",
    "MovingGaussians",
    "MovingMethod",
    "SlicedGaussiansConfig",
    "SlicedGaussiansMethod",
    "SpacetimeConfig",
    "SpacetimeMethod",
    "StillRows",
]
