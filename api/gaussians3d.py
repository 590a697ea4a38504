"""Method 3dgs, to extend: its settings, its model and its training."""

from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.methods.gaussians3d.model import StaticGaussians

__all__ = ["StaticGaussians", "StaticGaussiansConfig", "StaticGaussiansMethod"]
