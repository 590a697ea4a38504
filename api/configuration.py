"""Configuration: settings of parts, their ranges, and what they need of the others."""

from gsfw.core.capabilities import Capabilities, Determinism, Feature, Needs
from gsfw.core.config import (
    CallbackConfig,
    DataManagerConfig,
    Detection,
    MethodConfig,
    OptimConfig,
    RasterizerConfig,
    Rescaled,
    SamplerConfig,
    StrategyConfig,
    steps_field,
)
from gsfw.core.learning_rate import LearningRate
from gsfw.core.ranges import number

__all__ = [
    "CallbackConfig",
    "Capabilities",
    "DataManagerConfig",
    "Detection",
    "Determinism",
    "Feature",
    "LearningRate",
    "MethodConfig",
    "Needs",
    "OptimConfig",
    "RasterizerConfig",
    "Rescaled",
    "SamplerConfig",
    "StrategyConfig",
    "number",
    "steps_field",
]
