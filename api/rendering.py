"""Rendering: splats, cameras, rasterizers, and the mathematics that they share.

For authors of rasterizers, which derive from ``Rasterizer`` and render ``Splats`` from ``Cameras``
under ``RenderSettings``, and of models, whose ``splats`` fill in ``Splats``.
"""

from gsfw.core.bands import BandedSplats, Bands, RenderedBand
from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.lens import project_points
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.maths.rotations import (
    multiply_quaternions,
    quaternions_of,
    rotation_matrices,
    unit_matrices,
)
from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import dc_to_rgb, rgb_to_dc, sh_basis
from gsfw.core.maths.ssim import ssim_map
from gsfw.core.numerics import NumericsProfile
from gsfw.core.rasterizer import Rasterizer, StageTime
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings, Statistic, Validation
from gsfw.core.splats import Sh, Splats
from gsfw.plugins.open_rasterizer import open_rasterizer

__all__ = [
    "BandedSplats",
    "Bands",
    "CameraModel",
    "Cameras",
    "Depth",
    "NumericsProfile",
    "Rasterizer",
    "RenderOutput",
    "RenderSettings",
    "RenderStatistics",
    "RenderedBand",
    "Sh",
    "Similarity",
    "Splats",
    "StageTime",
    "Statistic",
    "Validation",
    "dc_to_rgb",
    "multiply_quaternions",
    "open_rasterizer",
    "pixel_rays",
    "project_points",
    "quaternions_of",
    "rgb_to_dc",
    "rotation_matrices",
    "sh_basis",
    "ssim_map",
    "unit_matrices",
]
