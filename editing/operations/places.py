"""Places: move, rotate and scale; turn upright; the floor and the true size."""

from __future__ import annotations

import math
from collections.abc import Callable

from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import ConfigError
from gsfw.core.maths.axes import axis_vector
from gsfw.core.maths.similarity import Similarity
from gsfw.editing import alignment, transforms
from gsfw.editing.editable import Editable
from gsfw.editing.operations.edit import Edit, Edited, Surroundings, real_capture
from gsfw.editing.operations.values import number, numbers, point


def transform(of: Callable[[str], Similarity]) -> Callable[[str], Edit]:
    """Move to another world."""

    def parse(text: str) -> Edit:
        similarity = of(text)
        return lambda piece, _: Edited(piece.transformed(similarity))

    return parse


def rotation(text: str) -> Similarity:
    """Parse "axis,degrees", with an axis by name or as a vector."""
    *axis, degrees = text.split(",")
    if len(axis) == 1:
        angle = number(degrees, "an axis and degrees, such as x,90", -math.inf)
        return transforms.rotate(axis_vector(axis[0]), angle)
    x, y, z, angle = numbers(text, "x,y,z of the axis,degrees")
    return transforms.rotate(point((x, y, z)), angle)


def translation(text: str) -> Similarity:
    """Parse a vector."""
    return transforms.move(point(numbers(text, "x,y,z")))


def scaling(text: str) -> Similarity:
    """Parse a factor."""
    return transforms.scale(number(text, "a factor above 0", 1e-300))


def true_size(text: str) -> Similarity:
    """Parse two points and their distance."""
    found = numbers(text, "x,y,z,x,y,z of two points,distance")
    return alignment.true_size(point(found[:3]), point(found[3:6]), found[6])


def align(text: str) -> Edit:
    """Turn upwards into an axis."""
    by, _, axis = text.partition(",")
    if by not in ("cameras", "floor"):
        raise ValueError(f"expected cameras or floor, found {by!r}")
    axis = axis or "z"
    target = axis_vector(axis)

    def edit(piece: Editable, _: Surroundings) -> Edited:
        up = _upward(piece, by)
        angle = math.degrees(math.acos(max(-1.0, min(1.0, float(up @ target)))))
        piece = piece.transformed(alignment.turned_upright(up, target))
        was = ",".join(f"{value:.3f}" for value in up.tolist())
        return Edited(piece.with_up(axis), f"up was {was}; turned by {angle:.1f} degrees to {axis}")

    return edit


def _upward(piece: Editable, by: str) -> Float64[Tensor, " 3"]:
    """The upward direction by the cameras, or by the floor that they, or the file, point to."""
    if by == "floor":
        hint = piece.upward()
        if hint is None:
            hint = _up_of_cameras(piece)
        return _floor(piece, hint, alignment.LARGEST_TILT, "align=floor").normal
    real_capture(piece, "align=cameras")
    return _up_of_cameras(piece)


def _up_of_cameras(piece: Editable) -> Float64[Tensor, " 3"]:
    return piece.world_from_scene().rotation @ alignment.up_of_cameras(piece.capture().cameras)


def _floor(piece: Editable, up: Float64[Tensor, " 3"], tilt: float, name: str) -> alignment.Floor:
    splats = piece.splats()
    try:
        return alignment.fit_floor(splats.means, splats.opacities, up, tilt)
    except ValueError as error:
        raise ConfigError(
            f"{name}: no floor was found: {error}.",
            "Crop what is around the scene first, or align by the cameras: align=cameras",
        ) from None


def floor_at(text: str) -> Edit:
    """Move the floor to a height."""
    (height,) = numbers(text, "a height")

    def edit(piece: Editable, _: Surroundings) -> Edited:
        up = piece.upward()
        if up is None:
            raise ConfigError(
                f"floor={text}: which way is up is not known.", "Align first: align=cameras"
            )
        found = _floor(piece, up, 0.0, f"floor={text}")
        note = f"the floor was at {found.height:.4g} along {piece.up}"
        return Edited(piece.transformed(transforms.move((height - found.height) * up)), note)

    return edit
