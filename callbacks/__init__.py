"""What watches a run: the screen, TensorBoard, result files, the log. All of them are on."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_callbacks() -> list[Spec]:
    """The built-in watchers."""
    return [
        Spec("log", "log.txt: what was said, line by line", "gsfw.callbacks.log:Log"),
        Spec("progress", "the progress line", "gsfw.callbacks.progress:Progress"),
        Spec("results", "metrics.jsonl, metrics.json, eval/", "gsfw.callbacks.results:Results"),
        Spec("tensorboard", "TensorBoard events", "gsfw.callbacks.tensorboard:TensorBoard"),
    ]
