"""Flicker: changes from frame to frame that the true images do not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.maths.ssim import masked_mean


@dataclass(frozen=True)
class Still:
    """One moment of a static camera: the rendered and the true image."""

    camera: object
    """Key of the camera, equal for its moments."""
    time: float
    rendered: Float[Tensor, "h w 3"]
    target: Float[Tensor, "h w 3"]
    moving: Bool[Tensor, "h w 1"]
    """True where the scene moves."""
    valid: Bool[Tensor, "h w 1"] | None
    """True where the true image is valid; ``None`` if all pixels are."""

    def change_error(self, before: Still) -> Float[Tensor, "h w 3"]:
        """Error of the change since ``before``; colours in [0, 1]."""
        drawn = self.rendered.clamp(0, 1) - before.rendered.clamp(0, 1)
        true = self.target.clamp(0, 1) - before.target.clamp(0, 1)
        return (drawn - true).abs()


class Flicker:
    """Mean absolute error of the change between neighbouring times, over pairs of images.

    Static pixels move in neither image of a pair: the true images hardly change there, so all
    changes of the rendered ones are flicker. A model with the same error at all times does not
    flicker.
    """

    def __init__(self) -> None:
        self._before: Still | None = None
        self._errors: dict[str, list[float]] = {"static": [], "moving": []}
        self._steps: list[float] = []

    def add(self, still: Still) -> None:
        """Add the next moment; moments of one camera are consecutive, in order of time."""
        before, self._before = self._before, still
        if before is None or before.camera != still.camera or before.time == still.time:
            return
        self._steps.append(still.time - before.time)
        error = still.change_error(before)[None]
        moving = still.moving | before.moving
        counted = torch.ones_like(moving)
        for valid in (still.valid, before.valid):
            counted &= counted if valid is None else valid
        for name, region in (("static", counted & ~moving), ("moving", counted & moving)):
            if bool(region.any()):
                self._errors[name].append(float(masked_mean(error, region[None])))

    def figures(self) -> Mapping[str, float]:
        """Means over the pairs; absent if there is no pair."""
        return {
            f"flicker_{name}": sum(errors) / len(errors)
            for name, errors in self._errors.items()
            if errors
        }

    def note(self) -> str:
        """Definition of the means, for result files."""
        if not self._steps:
            return "not available: no held-out camera shows several times"
        step = sum(self._steps) / len(self._steps)
        return f"{len(self._steps)} pairs of neighbouring times, {step:.4g} apart on average"
