"""How near a rasterizer must be to float64, as assertions; the rules are those of gsfw stress."""

from collections.abc import Mapping
from types import MappingProxyType

from gsfw.core.cameras import Cameras
from gsfw.core.numerics import NumericsProfile
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.studies.stress import drawn
from gsfw.studies.stress.case import Drawing
from gsfw.studies.stress.drawn import IMAGES, STATISTICS, Drawn, distance, leaves
from gsfw.studies.stress.judgement import faults_of_float32, faults_of_float64

__all__ = ["IMAGES", "STATISTICS", "Drawn", "distance", "leaves"]

FUSED = {"gradient of covariances": 1e-11}
"""Bounds of kernels that fuse multiply-adds in float64: of needles given by their covariance the
determinant is a c - b^2, in which they lose fewer digits than the reference does."""


def as_float64(
    splats: Splats, cameras: Cameras, settings: RenderSettings
) -> tuple[Splats, Cameras, RenderSettings]:
    """The same scene, to the last bit, for the reference."""
    wide = Drawing(splats, cameras, settings).double()
    return wide.splats, wide.cameras, wide.settings


def draw_everything(
    rasterizer: Rasterizer, splats: Splats, cameras: Cameras, settings: RenderSettings
) -> Drawn:
    """Draw, and go back from fixed random weights of every image."""
    return drawn.draw_everything(rasterizer, Drawing(splats, cameras, settings))


def check_float64(
    found: Drawn, expected: Drawn, bounds: Mapping[str, float] = MappingProxyType({})
) -> None:
    """A float64 backend is as near to the reference as rounding lets it: 1e-12, or its bound."""
    assert found.keys() == expected.keys()
    assert all(found[name].dtype == tensor.dtype for name, tensor in expected.items())
    assert not faults_of_float64(found, expected, bounds)


def check_float32(found: Drawn, expected: Drawn, profile: NumericsProfile) -> None:
    """A float32 backend keeps the tolerances that the project states for ordinary scenes."""
    assert found.keys() == expected.keys()
    assert not faults_of_float32(found, expected, profile)
