"""Samplers: which views come next."""

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
    ]
