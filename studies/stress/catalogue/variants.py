"""Variants: an extreme with every camera model, with and without cut-offs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Feature
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase, front_camera, random_splats

COUNT = 20
"""Splats of an ordinary scene: enough to overlap, few enough to be fast."""
SIZE = (20, 15)
"""Size of its image: several tiles, and not a whole number of them."""

EVERYTHING = RenderSettings(
    antialias=True, depth=Depth.ACCUMULATED, statistics=frozenset(Statistic), near=1e-7
)
"""Everything that a backend can compute, down to almost the camera's centre."""
SMOOTH = replace(EVERYTHING, profile=DEFAULT.without_cutoffs())
OPEN_ENDED = replace(EVERYTHING, near=0.0, far=torch.inf)
EXPECTED = replace(EVERYTHING, depth=Depth.EXPECTED)


@dataclass(frozen=True)
class Variant:
    """Camera model and settings of a variant."""

    model: CameraModel
    settings: RenderSettings
    about: frozenset[Feature] = frozenset()
    """Features without which this variant does not differ from the others."""


VARIANTS: Mapping[str, Variant] = {
    "": Variant(CameraModel.PINHOLE, EVERYTHING),
    "no-cut-offs": Variant(CameraModel.PINHOLE, SMOOTH),
    "expected-depth": Variant(CameraModel.PINHOLE, EXPECTED, frozenset({Feature.DEPTH})),
    "orthographic": Variant(CameraModel.ORTHOGRAPHIC, OPEN_ENDED),
    "fisheye": Variant(CameraModel.FISHEYE, EVERYTHING),
    "fisheye-no-cut-offs": Variant(CameraModel.FISHEYE, SMOOTH),
}
"""Variants by the last part of a case's name; the plain one has none."""


def ordinary() -> Splats:
    """Ordinary splats."""
    return random_splats(COUNT)


def splat_cases(
    changes: Mapping[str, Change],
    reasons: Mapping[str, str],
    about: Mapping[str, frozenset[Feature]] = MappingProxyType({}),
) -> tuple[StressCase, ...]:
    """Cases of extreme splats in front of an ordinary camera.

    Args:
        changes: by name, with the section.
        reasons: why float32 cannot meet the ordinary tolerances, by name of the change or of one
            case of it.
        about: features that a change is about, by its name.
    """
    return tuple(
        _splat_case(
            _named(name, variant),
            change,
            variant,
            _reason(reasons, name, variant),
            about.get(name, frozenset()),
        )
        for name, change in changes.items()
        for variant in VARIANTS
    )


def _splat_case(
    name: str, change: Change, variant: str, reason: str, about: frozenset[Feature]
) -> StressCase:
    way = VARIANTS[variant]

    def make() -> Drawing:
        camera = replace(front_camera(*SIZE), model=way.model)
        return Drawing(change(ordinary()), camera, way.settings)

    return StressCase(name, make, conditioning=reason, about=way.about | about)


def camera_cases(
    changes: Mapping[str, Callable[[Cameras], Cameras]],
    splats: Mapping[str, Change],
    reasons: Mapping[str, str],
) -> tuple[StressCase, ...]:
    """Cases of extreme cameras in front of splats of several kinds, for every camera model."""
    return tuple(
        _camera_case(f"{name}{kind}/{model.value}", change, splat, model, reasons.get(name + kind))
        for name, change in changes.items()
        for kind, splat in splats.items()
        for model in CameraModel
    )


def _camera_case(
    name: str,
    change: Callable[[Cameras], Cameras],
    splat: Change,
    model: CameraModel,
    reason: str | None,
) -> StressCase:
    def make() -> Drawing:
        camera = change(replace(front_camera(*SIZE), model=model))
        return Drawing(splat(ordinary()), camera, EVERYTHING)

    return StressCase(name, make, conditioning=reason or "")


def _named(name: str, variant: str) -> str:
    return f"{name}/{variant}" if variant else name


def _reason(reasons: Mapping[str, str], name: str, variant: str) -> str:
    return reasons.get(_named(name, variant) if variant else f"{name}/pinhole") or reasons.get(
        name, ""
    )
