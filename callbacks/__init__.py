"""Callbacks that watch a run: the screen, TensorBoard, result files, the log, checkpoints."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_callbacks() -> list[Spec]:
    """The built-in callbacks."""
    return [
        Spec("autosave", "checkpoints by the clock", "gsfw.callbacks.config:AutosaveConfig"),
        Spec("log", "log.txt: events of a run, line by line", "gsfw.callbacks.config:LogConfig"),
        Spec("progress", "the progress line", "gsfw.callbacks.config:ProgressConfig"),
        Spec("results", "figures as JSON", "gsfw.callbacks.config:ResultsConfig"),
        Spec("tensorboard", "TensorBoard events", "gsfw.callbacks.config:TensorBoardConfig"),
    ]
