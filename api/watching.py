"""Watching: callbacks and metrics, and what they receive."""

from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport, TrainingView
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.metrics import Metric

__all__ = [
    "Callback",
    "Control",
    "EvaluatedView",
    "Evaluation",
    "Metric",
    "ModelHandle",
    "RunInfo",
    "StepReport",
    "TrainingView",
]
