"""Samplers: the order of the training views."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_samplers() -> list[Spec]:
    """The built-in samplers."""
    return [
        Spec(
            "uniform",
            "every view once per epoch, in random order",
            "gsfw.samplers.uniform:UniformConfig",
        ),
        Spec(
            "same-time",
            "several views of one time per step",
            "gsfw.samplers.same_time:SameTimeConfig",
        ),
        Spec(
            "sequential",
            "one time after the other, as an online method sees them",
            "gsfw.samplers.sequential:SequentialConfig",
            paper="Luiten et al. 2024",
        ),
        Spec(
            "progressive",
            "views of a window of times that grows until all are in",
            "gsfw.samplers.progressive:ProgressiveConfig",
            paper="Lee et al. 2024",
        ),
        Spec(
            "error-weighted",
            "views with a large loss more often",
            "gsfw.samplers.error_weighted:ErrorWeightedConfig",
        ),
    ]
