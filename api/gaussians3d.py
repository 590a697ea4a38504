"""Method 3dgs, to extend: its settings, its model and its training.

Derive from ``StaticGaussiansMethod``: name another ``model_class``, add ``extra_columns``, override
``losses``; the ``build`` of a ``StaticGaussiansConfig`` makes it.
"""

from gsfw.methods.gaussians3d.config import StaticGaussiansConfig, StaticGaussiansOptim
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.gaussians3d.relocation import coincident_copies

__all__ = [
    "StaticGaussians",
    "StaticGaussiansConfig",
    "StaticGaussiansMethod",
    "StaticGaussiansOptim",
    "coincident_copies",
]
