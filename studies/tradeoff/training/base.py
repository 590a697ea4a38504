"""Base: the run that all variants change, and its single changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError, UserError
from gsfw.plugins.compose import check, compose
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve
from gsfw.studies.tradeoff.finished_model import LeftOut
from gsfw.studies.tradeoff.training.axes import AXES, Choice, Recipe


@dataclass(frozen=True)
class Base:
    """The run that all variants change."""

    given: Mapping[str, Any]
    """Given and chosen settings by dotted key."""
    values: Mapping[str, Any]
    """Every setting by dotted key."""

    @property
    def seed(self) -> int:
        """Seed of every run but those of the second seed."""
        return int(self.values["seed"])

    @property
    def downscale(self) -> float:
        """Downscale of the images of the evaluation."""
        return float(self.values["downscale"])

    def sized(self, chosen: Mapping[str, Any]) -> Base:
        """The base with chosen settings: length and size."""
        return replace(self, given={**self.given, **chosen}, values={**self.values, **chosen})


def find_base(given: Mapping[str, Any], registry: Registry) -> Base:
    """Resolve and check settings.

    Raises:
        ConfigError: a setting is unknown or wrong.
        DataError: the data set is missing or of no known format.
    """
    settings = resolve(registry, [Layer(COMMAND_LINE, given)])
    check(settings, registry)
    return Base(given, settings.flat())


@dataclass(frozen=True)
class Capture:
    """Properties of the data set."""

    views: int
    """Number of training views."""
    held_out: int
    width: int
    """Width of an image of the base, in pixels."""
    height: int
    device: str
    """Device of the training: cpu or cuda."""
    has_points: bool
    """True if the data has points to start from."""


def find_capture(base: Base, registry: Registry) -> Capture:
    """Read the properties of the data set.

    Raises:
        DataError: it cannot be used, or no images are held out.
    """
    composition = compose(resolve(registry, [Layer(COMMAND_LINE, base.given)]), registry)
    data = composition.parts.data
    train, held_out = data.views(Split.TRAIN), data.views(Split.EVAL)
    data.close()
    if not held_out:
        raise DataError(
            "There are no held-out images to measure accuracy on.",
            "Hold some out: holdout_every=8.",
        )
    camera = held_out.cameras[0]
    device, has_points = composition.parts.device.type, len(data.scene.points) > 0
    return Capture(len(train), len(held_out), camera.width, camera.height, device, has_points)


def singles(
    base: Base, axes: Sequence[str], registry: Registry
) -> tuple[list[Recipe], list[LeftOut]]:
    """Every recipe of one choice, and the choices that do not fit this base."""
    recipes, left_out = [], []
    for axis in AXES:
        if axis.name not in axes:
            continue
        choices = axis.choices(base.values)
        if not choices:
            left_out.append(LeftOut(axis.name, axis.why_not))
        for choice in choices:
            problem = _problem(base, choice, registry)
            if problem:
                left_out.append(LeftOut(choice.name, problem))
            else:
                recipes.append(Recipe((choice,)))
    return recipes, left_out


def _problem(base: Base, choice: Choice, registry: Registry) -> str:
    """The reason why a choice does not fit the base; empty if it does."""
    try:
        given = {**base.given, **choice.settings}
        check(resolve(registry, [Layer(COMMAND_LINE, given)]), registry)
    except UserError as error:
        return error.message
    return ""
