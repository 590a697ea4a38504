"""Crop and cut: keep what is inside of a region, or what is outside."""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Bool
from torch import Tensor

from gsfw.core.splats import Splats
from gsfw.editing.editable import Editable
from gsfw.editing.operations.edit import Edit, keeping, real_capture
from gsfw.editing.operations.values import numbers, whole
from gsfw.editing.regions import Box, Sphere, num_cameras_around


def box(text: str) -> Box:
    """Parse two corners.

    Raises:
        ValueError: they are not six numbers.
    """
    x, y, z, u, v, w = numbers(text, "x,y,z,x,y,z of two corners")
    return Box((x, y, z), (u, v, w))


def sphere(text: str) -> Sphere:
    """Parse a centre and a radius.

    Raises:
        ValueError: they are not four numbers, or the radius is negative.
    """
    x, y, z, radius = numbers(text, "x,y,z,radius")
    if radius < 0:
        raise ValueError(f"expected a radius of at least 0, found {radius:g}")
    return Sphere((x, y, z), radius)


def crop(region: Callable[[str], Box | Sphere]) -> Callable[[str], Edit]:
    """Keep what is inside."""

    def parse(text: str) -> Edit:
        found = region(text)
        return keeping(lambda piece: piece.chosen(lambda splats: found.contains(splats.means)))

    return parse


def cut(region: Callable[[str], Box | Sphere]) -> Callable[[str], Edit]:
    """Leave out what is inside."""

    def parse(text: str) -> Edit:
        found = region(text)
        return keeping(lambda piece: ~piece.chosen(lambda splats: found.contains(splats.means)))

    return parse


def crop_views(text: str) -> Edit:
    """Keep what lies within the images of some cameras."""
    least = whole(text, "a number of cameras, at least 1")

    def rows(piece: Editable) -> Bool[Tensor, " n"]:
        cameras = real_capture(piece, f"crop.views={text}").cameras
        scene = piece.world_from_scene().inverse()

        def test(splats: Splats) -> Bool[Tensor, " n"]:
            return num_cameras_around(scene.apply(splats.means), cameras) >= least

        return piece.chosen(test)

    return keeping(rows)
