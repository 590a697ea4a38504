"""Precision: what is lost where numbers are stored in fewer bits; said, and held to a bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.studies.stress.case import Drawing, StressCase, coefficients
from gsfw.studies.stress.scene import front_camera, random_splats

Rounding = Callable[[Tensor], Tensor]


def _exact() -> Drawing:
    return Drawing(random_splats(60, 3), front_camera(48, 36), RenderSettings())


def _through(dtype: torch.dtype, values: Tensor) -> Tensor:
    return values.to(dtype).to(values)


def _quantised(bits: int, values: Tensor) -> Tensor:
    """Fixed point between the smallest and the largest of each column, as compressed files do."""
    low, high = values.amin(0), values.amax(0)
    steps = 2**bits - 1
    return low + ((values - low) / (high - low) * steps).round() / steps * (high - low)


def _colours(rounding: Rounding) -> Drawing:
    drawing = _exact()
    rounded = Sh(rounding(coefficients(drawing.splats)), 3)
    return replace(drawing, splats=replace(drawing.splats, colors=rounded))


def _field(name: str, rounding: Rounding) -> Drawing:
    drawing = _exact()
    rounded = rounding(drawing.splats.tensors()[name])
    return replace(drawing, splats=replace(drawing.splats, **{name: rounded}))


HALF, BRAIN = partial(_through, torch.float16), partial(_through, torch.bfloat16)

REDUCED: dict[str, tuple[Callable[[], Drawing], float]] = {
    "sh-in-float16": (partial(_colours, HALF), 2**-11),
    "sh-in-bfloat16": (partial(_colours, BRAIN), 2**-8),
    "means-in-float16": (partial(_field, "means", HALF), 2**-7),
    "means-in-16-bits": (partial(_field, "means", partial(_quantised, 16)), 2**-9),
    "means-in-24-bits": (partial(_field, "means", partial(_quantised, 24)), 2**-16),
    "scales-in-8-bits": (partial(_field, "scales", partial(_quantised, 8)), 2**-6),
    "quats-in-8-bits": (partial(_field, "quats", partial(_quantised, 8)), 2**-5),
    "opacities-in-8-bits": (partial(_field, "opacities", partial(_quantised, 8)), 2**-7),
}
"""What is rounded, and how far the picture may be from that of the exact numbers."""

PRECISION = tuple(
    StressCase(f"precision/{name}", make, truth=lambda: _exact().double(), bound=bound)
    for name, (make, bound) in REDUCED.items()
)
"""All cases of this section."""
