"""Returns: checks the form of what the parts of a run return, which may be those of plugins.

Only types, names and shapes are looked at, so that a check costs no time in a step and never waits
for a GPU.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from gsfw.core.errors import ConfigError
from gsfw.core.render_output import RenderOutput

TERMS = "scalar tensors by name"
HOW_TO_TERM = 'Return a mapping of tensors without axes, such as {"l1": error.abs().mean()}.'


def checked_terms(source: str, terms: object) -> Mapping[str, Tensor]:
    """The loss terms that a part returned.

    Args:
        source: the part and the call, such as "method 'mine': losses".
        terms: the result of the call.

    Raises:
        ConfigError: they are no mapping of scalar tensors; names the first that is none.
    """
    checked_mapping(source, terms, TERMS, HOW_TO_TERM)
    assert isinstance(terms, Mapping)
    for name, term in terms.items():
        if not isinstance(term, Tensor):
            raise ConfigError(
                f"{source} returned {type(term).__name__} for {name!r}, expected a scalar tensor.",
                HOW_TO_TERM,
            )
        if term.dim():
            raise ConfigError(
                f"{source} returned a tensor of shape {list(term.shape)} for {name!r}, "
                "expected a scalar tensor.",
                f"Reduce it to one number: {name} = {name}.mean().",
            )
    return terms


def checked_mapping(source: str, found: object, expected: str, advice: str) -> Mapping[str, Any]:
    """The mapping that a part returned.

    Raises:
        ConfigError: it is none.
    """
    if not isinstance(found, Mapping):
        message = f"{source} returned {type(found).__name__}, expected {expected}."
        raise ConfigError(message, advice)
    return found


def check_output(
    source: str, output: object, images: tuple[int, int, int], colors: int, extras: int | None
) -> None:
    """Check the form of a render.

    Args:
        source: name of the rasterizer's class.
        output: the result of ``_render``.
        images: number of cameras, height and width.
        colors: channels of the colours.
        extras: extra channels of the splats; ``None`` or 0 if they have none.

    Raises:
        ConfigError: it is no ``RenderOutput``, or an image has another shape; names it.
    """
    advice = "RenderOutput says the form of each image; gsfw stress tests a rasterizer."
    if not isinstance(output, RenderOutput):
        raise ConfigError(
            f"{source}._render returned {type(output).__name__}, expected RenderOutput.", advice
        )
    shapes: dict[str, tuple[Tensor | None, int]] = {
        "color": (output.color, colors),
        "alpha": (output.alpha, 1),
        "depth": (output.depth, 1),
    }
    if extras:
        shapes["extra"] = (output.extra, extras)
    for name, (image, channels) in shapes.items():
        if image is None and name == "depth":
            continue
        expected = [*images, channels]
        found = list(image.shape) if isinstance(image, Tensor) else type(image).__name__
        if found != expected:
            raise ConfigError(
                f"{source}._render returned {name} of shape {found}, expected {expected}."
                if isinstance(image, Tensor)
                else f"{source}._render returned {found} as {name}, expected a tensor.",
                advice,
            )
