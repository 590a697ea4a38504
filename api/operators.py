"""Operators: the expensive operations of a step besides rendering, for authors of a device's set.

Methods and refiners only call the ``Operators`` that they are given. A set for another kind of
device derives from it, overrides what is faster there, and says so in ``preference``; the other
classes are arguments and results of its functions.
"""

from gsfw.core.maths.slices import Slices
from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Gate, Operators
from gsfw.core.stereo.fusion import FusedImage, FusionRule
from gsfw.core.stereo.plane_sweep import DepthImage
from gsfw.core.stereo.plans import SweepPlan
from gsfw.core.stereo.views import StereoViews

__all__ = [
    "AdamMoments",
    "AdamSettings",
    "AdamUpdate",
    "DepthImage",
    "FusedImage",
    "FusionRule",
    "Gate",
    "Operators",
    "Slices",
    "StereoViews",
    "SweepPlan",
]
