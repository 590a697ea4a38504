"""Plane: errors over two quantities at a time, with their cliffs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

import torch

from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.studies.entrants import Entrant
from gsfw.studies.stress.case import Drawing, front_camera, random_splats
from gsfw.studies.stress.drawn import GRADIENT, Drawn, distance, draw_everything
from gsfw.studies.stress.runner import DTYPES

COUNT = 3
SIZE = (16, 12)
EMPTY, BROKEN = -1.0, float("nan")
"""Values instead of an error: an empty image; an image that is not finite, or a refusal."""
LEAST_IMAGE = 1e-30
"""Norm below which an image is empty."""


@dataclass(frozen=True)
class Plane:
    """Two quantities, and the input at a place of their plane."""

    name: str
    across: str
    upward: str
    across_values: Sequence[float]
    upward_values: Sequence[float]
    make: Callable[[float, float], Drawing]


@dataclass(frozen=True)
class PlaneErrors:
    """Errors of one backend and dtype over a plane."""

    plane: Plane
    backend: str
    dtype: str
    image: tuple[tuple[float, ...], ...]
    """Relative L2 error of the image; rows as ``upward_values``; EMPTY and NaN as defined there."""
    gradient: tuple[tuple[float, ...], ...]
    """The worst relative L2 of the gradients by means, quats, scales, opacities and colours."""

    def document(self) -> dict[str, Any]:
        """Plain data for ``json=true``; empty places are null."""
        return {
            "plane": self.plane.name,
            "backend": self.backend,
            "dtype": self.dtype,
            "across": {"name": self.plane.across, "values": list(self.plane.across_values)},
            "upward": {"name": self.plane.upward, "values": list(self.plane.upward_values)},
            "image": _readable(self.image),
            "gradient": _readable(self.gradient),
        }


def _readable(rows: tuple[tuple[float, ...], ...]) -> list[list[float | str | None]]:
    return [
        [None if error == EMPTY else "not finite" if isnan(error) else error for error in row]
        for row in rows
    ]


def _at(depth: float, opacity: float, scales: Sequence[float]) -> Drawing:
    """Three splats one behind the other, a pixel apart, that fill a part of the image."""
    splats = random_splats(COUNT, 1, seed=5)
    depths = depth * torch.tensor([1.0, 1.1, 1.2])
    sides = torch.tensor([[-0.1, 0.05], [0.02, -0.06], [0.09, 0.03]]) * depths[:, None]
    assert isinstance(splats.colors, Sh)
    made = Splats(
        means=torch.cat([sides, depths[:, None]], dim=1),
        opacities=torch.full((COUNT,), opacity),
        colors=splats.colors,
        quats=splats.quats,
        scales=torch.tensor([list(scales)]) * torch.tensor([[1.0], [0.8], [1.25]]),
    )
    settings = RenderSettings(near=1e-9)
    return Drawing(made, front_camera(*SIZE, distance=0.0), settings)


def _powers(first: int, last: int) -> tuple[float, ...]:
    return tuple(10.0**power for power in range(first, last + 1))


OPACITIES = (
    *(0.002, 0.003, 0.0039, 0.00395, 0.005, 0.01, 0.03, 0.1, 0.3, 0.6, 0.9),
    *(0.98, 0.989, 0.991, 0.999, 1.0),
)
"""Values on both sides of the cut-off at 1 / 255 and of the clamp at 0.99."""

PLANES = (
    Plane(
        "scale and depth",
        across="scale along the longest axis, scene units",
        upward="depth, scene units",
        across_values=_powers(-8, 8),
        upward_values=_powers(-6, 9),
        make=lambda scale, depth: _at(depth, 0.8, (scale, 0.5 * scale, 0.3 * scale)),
    ),
    Plane(
        "anisotropy and opacity",
        across="longest axis / shortest axis",
        upward="opacity, not to scale",
        across_values=tuple(10.0 ** (power / 2) for power in range(1, 18)),
        upward_values=OPACITIES,
        make=lambda ratio, opacity: _at(4.0, opacity, (0.6, 0.6 / ratio**0.5, 0.6 / ratio)),
    ),
)
"""The measured planes."""

GRADIENTS = ("means", "quats", "scales", "opacities", "colors")


class PlaneOracle:
    """The reference over the planes, rendered once for all backends."""

    def __init__(self, rasterizer: Rasterizer) -> None:
        self._rasterizer = rasterizer
        self._drawn: dict[tuple[str, float, float], Drawn] = {}

    def expected(self, plane: Plane, across: float, upward: float) -> Drawn:
        """The reference's result at a place."""
        key = (plane.name, across, upward)
        if key not in self._drawn:
            drawing = plane.make(across, upward).double()
            self._drawn[key] = draw_everything(self._rasterizer, drawing)
        return self._drawn[key]


def plane_errors(entrant: Entrant, dtype: str, plane: Plane, oracle: PlaneOracle) -> PlaneErrors:
    """Measure a backend over a plane; a refusal counts as not finite."""
    images, gradients = [], []
    for y in plane.upward_values:
        row = [
            _errors(entrant, dtype, plane.make(x, y), oracle.expected(plane, x, y))
            for x in plane.across_values
        ]
        images.append(tuple(image for image, _ in row))
        gradients.append(tuple(gradient for _, gradient in row))
    return PlaneErrors(plane, entrant.name, dtype, tuple(images), tuple(gradients))


def _errors(entrant: Entrant, dtype: str, drawing: Drawing, expected: Drawn) -> tuple[float, float]:
    if float(expected["color"].norm()) < LEAST_IMAGE:
        return EMPTY, EMPTY
    wide = DTYPES[dtype] == torch.float64
    drawing = (drawing.double() if wide else drawing).to(entrant.device)
    try:
        found = draw_everything(entrant.rasterizer, drawing)
    except Exception:  # Whatever a backend raises is no image.
        return BROKEN, BROKEN
    names = [f"{GRADIENT}{name}" for name in GRADIENTS]
    gradients = [distance(found[name], expected[name], name) for name in names]
    finite = all(bool(tensor.isfinite().all()) for tensor in found.values())
    if not finite:
        return BROKEN, BROKEN
    return distance(found["color"], expected["color"], "color"), max(gradients)
