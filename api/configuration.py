"""Configuration: settings of parts, their ranges, and what a part needs. Light to import.

A part that is chosen by name registers a dataclass that derives from one of the ``...Config``
classes; its fields are settings, ``needs()`` says what it needs of the rasterizer and the model,
and ``build`` (for strategies ``refiners``) makes the part. Derive once more from a config of your
own for presets.
"""

from gsfw.core.capabilities import Capabilities, Determinism, Feature, Needs
from gsfw.core.config import (
    CallbackConfig,
    DataManagerConfig,
    Detection,
    MethodConfig,
    RasterizerConfig,
    SamplerConfig,
    StrategyConfig,
)
from gsfw.core.hold_out import HoldOutBy
from gsfw.core.learning_rate import LearningRate
from gsfw.core.optim_config import OptimConfig
from gsfw.core.ranges import number
from gsfw.core.step_settings import Rescaled, steps_field

__all__ = [
    "CallbackConfig",
    "Capabilities",
    "DataManagerConfig",
    "Detection",
    "Determinism",
    "Feature",
    "HoldOutBy",
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
