"""Training: methods, models and their columns, refiners, and the state of a step."""

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.method import Method
from gsfw.core.model import Children, DensifiableModel, PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.refinement.row_statistics import RowStatistics
from gsfw.core.refiner import GrowthLimits, RefineContext, Refinement, Refiner
from gsfw.core.sampler import Sampler
from gsfw.core.table import SplatTable

__all__ = [
    "Children",
    "Column",
    "DensifiableModel",
    "GrowthLimits",
    "Layout",
    "Method",
    "Operators",
    "Optimizer",
    "ParameterGroup",
    "PrimitiveModel",
    "RefineContext",
    "Refinement",
    "Refiner",
    "RowStatistics",
    "Rows",
    "Sampler",
    "SplatTable",
    "StepContext",
]
