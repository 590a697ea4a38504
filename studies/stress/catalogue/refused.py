"""Refused: input that must be refused, and parts of the message."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TypeVar

import torch
from torch import Tensor

from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase, coefficients, front_camera
from gsfw.studies.stress.catalogue.splats import covariances
from gsfw.studies.stress.catalogue.variants import COUNT, SIZE, ordinary

Record = TypeVar("Record")

ROW = 7
BAD = {"nan": torch.nan, "infinity": torch.inf, "minus-infinity": -torch.inf}
WHERE = f"1 of {COUNT} rows are not, the first is row {ROW}"


def _field(splats: Splats, name: str) -> Tensor:
    return splats.tensors()[name]


def _with(splats: Splats, name: str, values: Tensor) -> Splats:
    """Splats with one tensor replaced, of any shape and type."""
    if name == "colors":
        return _forced(splats, "colors", _forced(splats.colors, "coefficients", values))
    return _forced(splats, name, values)


def _forced(record: Record, name: str, value: object) -> Record:
    """A copy with a field that type checks at run time refuse in the constructor."""
    copied = copy(record)
    object.__setattr__(copied, name, value)
    return copied


def _spoilt(name: str, value: float) -> Drawing:
    splats = replace(ordinary(), extra=torch.zeros(COUNT, 2))
    if name == "covariances":
        splats = covariances(0.01, 0.02, 0.03)(splats)
    values = _field(splats, name).clone()
    values[ROW].view(-1)[-1] = value
    return Drawing(_with(splats, name, values), front_camera(*SIZE), RenderSettings())


FIELDS = ("means", "quats", "scales", "covariances", "opacities", "colors", "extra")

NOT_FINITE = tuple(
    StressCase(
        f"input/{kind}-in-{name}",
        partial(_spoilt, name, value),
        refusal=(f"splats.{name}: expected finite values", WHERE),
    )
    for name in FIELDS
    for kind, value in BAD.items()
)


def _camera(name: str, row: int, column: int, value: float) -> Drawing:
    camera = front_camera(*SIZE)
    changed = getattr(camera, name).clone()
    changed[0, row, column] = value
    return Drawing(ordinary(), replace(camera, **{name: changed}), RenderSettings())


def _splats(change: Callable[[Splats], Splats]) -> Drawing:
    return Drawing(change(ordinary()), front_camera(*SIZE), RenderSettings())


def _changed(name: str, function: Callable[[Tensor], Tensor]) -> Change:
    return lambda splats: _with(splats, name, function(_field(splats, name)))


def _background(values: Tensor) -> Drawing:
    return Drawing(ordinary(), front_camera(*SIZE), RenderSettings(background=values))


def _sized(width: int, height: int) -> Drawing:
    camera = replace(front_camera(*SIZE), width=width, height=height)
    return Drawing(ordinary(), camera, RenderSettings())


def _half() -> Drawing:
    splats = ordinary().map(lambda tensor: tensor.half())
    return Drawing(splats, front_camera(*SIZE, dtype=torch.float16), RenderSettings())


def _no_camera() -> Drawing:
    return Drawing(ordinary(), front_camera(*SIZE).select([]), RenderSettings())


def _not_contiguous() -> Drawing:
    """Tensors that are not contiguous, as transposed ones: rendered, not refused."""
    transposed = ordinary().map(lambda t: t.transpose(0, -1).contiguous().transpose(0, -1))
    return Drawing(transposed, front_camera(*SIZE), RenderSettings())


SHAPES: dict[str, tuple[Change, str]] = {
    "means": (_changed("means", lambda t: t[:, :2]), "[20, 3], found [20, 2]"),
    "quats": (_changed("quats", lambda t: t[:, :3]), "[20, 4], found [20, 3]"),
    "scales": (_changed("scales", lambda t: t[:-1]), "[20, 3], found [19, 3]"),
    "opacities": (_changed("opacities", lambda t: t[:, None]), "[20], found [20, 1]"),
    "colors": (_changed("colors", lambda t: t[:3]), "[20, any, 3], found [3, 4, 3]"),
}

OTHERS: dict[str, tuple[Callable[[], Drawing], tuple[str, ...]]] = {
    "negative-scales": (
        partial(_spoilt, "scales", -1e-9),
        ("splats.scales: expected scales >= 0", WHERE),
    ),
    "opacity-above-1": (
        partial(_spoilt, "opacities", 1.0001),
        ("splats.opacities: expected values in [0, 1]", WHERE),
    ),
    "opacity-below-0": (
        partial(_spoilt, "opacities", -1e-7),
        ("splats.opacities: expected values in [0, 1]", WHERE),
    ),
    "nan-in-the-pose": (
        partial(_camera, "world_to_camera", 1, 3, torch.nan),
        ("cameras.world_to_camera: expected finite values", "row 0"),
    ),
    "infinity-in-intrinsics": (
        partial(_camera, "intrinsics", 0, 2, torch.inf),
        ("cameras.intrinsics: expected finite values", "row 0"),
    ),
    "skew": (partial(_camera, "intrinsics", 0, 1, 0.5), ("cameras.intrinsics: expected no skew",)),
    "focal-zero": (
        partial(_camera, "intrinsics", 1, 1, 0.0),
        ("cameras.intrinsics: expected focal lengths > 0",),
    ),
    "focal-negative": (
        partial(_camera, "intrinsics", 0, 0, -20.0),
        ("cameras.intrinsics: expected focal lengths > 0",),
    ),
    "no-camera": (_no_camera, ("cameras: expected at least one",)),
    "no-pixel": (partial(_sized, 0, 15), ("cameras: image size 0x15 has no pixel",)),
    "nan-in-the-background": (
        lambda: _background(torch.tensor([0.0, torch.nan, 0.0])),
        ("settings.background: expected finite values", "row 1"),
    ),
    "background-of-4": (
        lambda: _background(torch.zeros(4)),
        ("settings.background: expected 3 channels, found 4",),
    ),
    "both-forms-of-shape": (
        lambda: _splats(lambda s: replace(s, covariances=torch.eye(3).repeat(COUNT, 1, 1))),
        ("give either quats and scales, or covariances",),
    ),
    "no-form-of-shape": (
        lambda: _splats(lambda s: replace(s, quats=None, scales=None)),
        ("give either quats and scales, or covariances",),
    ),
    "three-coefficients": (
        lambda: _splats(lambda s: replace(s, colors=Sh(coefficients(s)[:, :3], 1))),
        ("3",),
    ),
    "double-opacities": (
        lambda: _splats(_changed("opacities", lambda t: t.double())),
        ("splats.opacities: expected torch.float32, found torch.float64",),
    ),
    "float16": (_half, ("splats.means: expected float32 or float64, found torch.float16",)),
    "other-device": (
        lambda: _splats(_changed("opacities", lambda t: t.to("meta"))),
        ("splats.opacities: expected device", "found meta"),
    ),
}

REFUSED = (
    *NOT_FINITE,
    StressCase("input/not-contiguous", _not_contiguous),
    *(
        StressCase(
            f"input/shape-of-{name}", partial(_splats, change), refusal=(f"splats.{name}", found)
        )
        for name, (change, found) in SHAPES.items()
    ),
    *(
        StressCase(f"input/{name}", make, refusal=refusal)
        for name, (make, refusal) in OTHERS.items()
    ),
)
"""All cases of this section."""
