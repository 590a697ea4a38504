"""Watching: callbacks and metrics, and what they receive.

For authors of loggers and displays (``Callback``; with settings, a ``CallbackConfig`` builds it)
and of figures of the evaluation (``Metric``). Neither can change a training.
"""

from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport, TrainingView
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.findings import Finding
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.metrics import Metric, psnr

__all__ = [
    "Callback",
    "Control",
    "EvaluatedView",
    "Evaluation",
    "Finding",
    "Metric",
    "ModelHandle",
    "RunInfo",
    "StepReport",
    "TrainingView",
    "psnr",
]
