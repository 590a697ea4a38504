"""Limits: very many layers, images beyond memory, fewer bits, and the worst cases of a search.

The search is tests/studies/stress/test_search.py: hypothesis chooses a ``Place`` that maximises the
error of backend ``cpu``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from gsfw.core.cameras import CameraModel
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings, Statistic, Validation
from gsfw.core.splats import Sh, Splats
from gsfw.studies.stress.case import (
    Drawing,
    StressCase,
    coefficients,
    front_camera,
    layers,
    random_splats,
)
from gsfw.studies.stress.catalogue.views import camera_with

MANY = 100_000

CUT_OFF = RenderSettings(statistics=frozenset(Statistic))
SMOOTH = replace(CUT_OFF, profile=DEFAULT.without_cutoffs())


def _piled(count: int, opacity: float, settings: RenderSettings = CUT_OFF) -> Drawing:
    return Drawing(layers(count, opacity), front_camera(1, 1), settings)


def _at_the_stop(*opacities: float) -> Drawing:
    """Layers that leave about the transmittance of the stop, and one behind them."""
    splats = layers(len(opacities) + 1, 0.5, channels=3)
    assert splats.scales is not None
    splats = replace(splats, opacities=torch.tensor([*opacities, 0.5]), scales=4.0 * splats.scales)
    return Drawing(splats, front_camera(9, 7), CUT_OFF)


SUM = "a product of thousands of factors accumulates the rounding of each, as in plain float32"

# (1 - 0.99) squared equals the stop: rounding decides whether a second layer of 0.99 is drawn.
LAYERS = (
    StressCase("layers/100000-of-1-in-254", lambda: _piled(MANY, 1 / 254), conditioning=SUM),
    StressCase("layers/100000-of-0.99", lambda: _piled(MANY, 0.99), at_a_cut_off=1),
    StressCase("layers/100000-of-0.5", lambda: _piled(MANY, 0.5)),
    StressCase(
        "layers/5000-seen-through",
        lambda: _piled(5000, 2e-4, SMOOTH),
        conditioning=SUM,
    ),
    StressCase("layers/above-the-stop", lambda: _at_the_stop(0.9, 0.9, 0.95, 0.75)),
    StressCase("layers/below-the-stop", lambda: _at_the_stop(0.9, 0.9, 0.95, 0.85)),
    StressCase("layers/at-the-stop", lambda: _at_the_stop(0.9, 0.9, 0.99), at_a_cut_off=1),
)
"""All cases of this section."""

WIDTH = 2**20
"""Width of an image one tile high: small, with 65,536 tiles of 16 pixels."""


def _covering(count: int) -> Drawing:
    """Splats that each reach every tile."""
    splats = Splats(
        means=torch.zeros(count, 3),
        opacities=torch.full((count,), 0.5),
        colors=torch.ones(count, 1),
        quats=torch.ones(count, 4),
        scales=torch.full((count, 3), 1e6),
    )
    camera = replace(front_camera(WIDTH, 16), model=CameraModel.ORTHOGRAPHIC)
    k = camera.intrinsics.clone()
    k[0, 0, 0], k[0, 1, 1] = 100.0, 100.0
    settings = RenderSettings(validation=Validation.CHEAP)
    return Drawing(splats, replace(camera, intrinsics=k), settings)


SIZE = (
    StressCase(
        "size/more-pairs-than-memory",
        lambda: _covering(20_000),
        refusal=("bytes", "pairs"),
        refused_number=2**31,
    ),
    # 33,000 x 65,536 is above 2^31: in 32 bits with a sign it is negative, and passes any limit.
    # With tiles of 8 pixels it is four times that, of which 32 bits keep 60,817,408.
    StressCase(
        "size/more-pairs-than-int32",
        lambda: _covering(33_000),
        refusal=("bytes", "pairs"),
        refused_number=2**31,
    ),
)
"""All cases of this section."""

Rounding = Callable[[Tensor], Tensor]


def _exact() -> Drawing:
    return Drawing(random_splats(60, 3), front_camera(48, 36), RenderSettings())


def _through(dtype: torch.dtype, values: Tensor) -> Tensor:
    return values.to(dtype).to(values)


def _quantised(bits: int, values: Tensor) -> Tensor:
    """Fixed point between the extremes of each column, as in compressed files."""
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
"""Rounded inputs, and the largest error of the image against that of the exact numbers."""

PRECISION = tuple(
    StressCase(f"precision/{name}", make, truth=lambda: _exact().double(), bound=bound)
    for name, (make, bound) in REDUCED.items()
)
"""All cases of this section."""

FOUND_COUNT = 3
FOUND_SIZE = (16, 12)


@dataclass(frozen=True)
class Place:
    """Properties of three splats and their camera."""

    scale: float
    """Longest axis in scene units."""
    anisotropy: float
    """The longest axis divided by the shortest."""
    depth: float
    opacity: float
    offset: float
    """Distance from the centre of the image, in halves of it."""
    focal: float
    """Focal length in pixels."""
    norm: float
    """Norm of the quaternions."""


def placed(place: Place, settings: RenderSettings) -> Drawing:
    """The input of a place."""
    splats = random_splats(FOUND_COUNT, 1, seed=5)
    assert splats.quats is not None
    depths = place.depth * torch.tensor([1.0, 1.1, 1.2])
    sides = torch.tensor([[-0.1, 0.05], [0.02, -0.06], [0.09, 0.03]]) + place.offset
    half = 0.5 * FOUND_SIZE[0] / place.focal
    axes = torch.tensor([1.0, place.anisotropy**-0.5, 1.0 / place.anisotropy])
    made = Splats(
        means=torch.cat([sides * half * depths[:, None], depths[:, None]], dim=1),
        opacities=torch.full((FOUND_COUNT,), place.opacity),
        colors=splats.colors,
        quats=place.norm * torch.nn.functional.normalize(splats.quats, dim=1),
        scales=place.scale * axes * torch.tensor([[1.0], [0.8], [1.25]]),
    )
    return Drawing(
        made, camera_with(place.focal)(front_camera(*FOUND_SIZE, distance=0.0)), settings
    )


def on_a_cut_off(place: Place) -> int:
    """Number of splats that any rounding may hide: all, or the second of those at the clamp."""
    if place.opacity == DEFAULT.alpha_min:
        return FOUND_COUNT
    return int(place.opacity >= DEFAULT.alpha_max)


FOUND_SETTINGS = RenderSettings(near=1e-9)

# A search over 3,174 random places, continued by hypothesis, found errors beyond those of
# float32 of these two kinds only. In both any rounding decides whether a splat is drawn.
PLACES = {
    # Two layers at the clamp of 0.99 leave (1 - 0.99) squared, which equals the stop: rounding
    # decides whether the second layer is drawn, and backends differ, also in float64.
    "found/clamped-layers": Place(3945.3, 2.3e6, 3.8938, 1.0, 2.076, 4734.5, 8.4e7),
    "found/clamped-layers-near": Place(
        0.00014333, 75086.0, 0.00092704, 0.991, -0.2353, 30678.0, 1e6
    ),
    # An opacity of exactly 1 / 255 is drawn only at a pixel in the centre of its splat, or nowhere.
    "found/opacity-of-the-cut-off": Place(
        13.7946, 14.062, 0.45043, 1 / 255, -1.7706, 2888.4, 5.7e-8
    ),
    "found/needle-of-the-cut-off": Place(
        0.0099943, 3.3e6, 1.2646, 1 / 255, 0.71234, 45308.0, 4.9e10
    ),
}

FOUND = tuple(
    StressCase(name, partial(placed, place, FOUND_SETTINGS), at_a_cut_off=on_a_cut_off(place))
    for name, place in PLACES.items()
)
"""All cases of this section."""
