"""Training: methods, models and their columns, refiners, samplers, and the state of a step.

For authors of methods (``Method``, with a ``PrimitiveModel`` of ``Column``s), of strategies
(``Refiner``) and of samplers (``Sampler``). The mean absolute difference of images is
``masked_mean((rendered - target).abs(), valid)``; ``context.operators.l1_dssim`` is that and 1 -
SSIM in one native call.
"""

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.context import StepContext, ViewContext
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.maths.ssim import masked_mean, ssim
from gsfw.core.method import Method
from gsfw.core.model import Children, DensifiableModel, PrimitiveModel
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.refinement.row_statistics import RowStatistics
from gsfw.core.refiner import GrowthLimits, RefineContext, Refinement, Refiner
from gsfw.core.sampler import Sampler
from gsfw.core.scene import Scene
from gsfw.core.sky import Sky
from gsfw.core.table import SplatTable

__all__ = [
    "Children",
    "Column",
    "DensifiableModel",
    "GrowthLimits",
    "Layout",
    "Method",
    "Optimizer",
    "ParameterGroup",
    "PrimitiveModel",
    "RefineContext",
    "Refinement",
    "Refiner",
    "RowStatistics",
    "Rows",
    "Sampler",
    "Scene",
    "Sky",
    "SplatTable",
    "StepContext",
    "ViewContext",
    "masked_mean",
    "ssim",
]
