"""Returns: checks the form of what the parts of a run return, which may be those of plugins.

Only types, names and shapes are looked at, so that a check costs no time in a step and never waits
for a GPU.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from numbers import Real
from typing import TYPE_CHECKING, Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.input_checks import check_splats
from gsfw.core.learning_rate import LearningRate
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats

if TYPE_CHECKING:
    from gsfw.core.method import Method
    from gsfw.core.model import PrimitiveModel

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


def checked_splats(source: str, splats: object, num_rows: int | None) -> Splats:
    """The splats that a model returned.

    Args:
        source: the class and the call, such as "MyModel.splats".
        splats: the result of the call.
        num_rows: rows of the model; ``None`` where splats need not be one for each row.

    Raises:
        ConfigError: they are no ``Splats``, a field has a wrong form, or rows are missing that
            ``Splats.rows`` does not list; names the field.
    """
    advice = "Return activated Splats: means [n, 3], opacities [n], ...; their docstring says each."
    if not isinstance(splats, Splats):
        raise ConfigError(f"{source} returned {type(splats).__name__}, expected Splats.", advice)
    try:
        check_splats(splats)
    except ValueError as error:
        raise ConfigError(f"{source} returned splats of a wrong form: {error}.", advice) from error
    if num_rows is not None and splats.rows is None and len(splats) != num_rows:
        raise ConfigError(
            f"{source} returned {len(splats)} splats for {num_rows} rows.",
            "Name the model's row of each splat: Splats(..., rows=rows), with rows [n] of int64.",
        )
    return splats


def splats_to_render(
    model: PrimitiveModel, time: Float[Tensor, ""] | None, cameras: Cameras
) -> Splats:
    """The splats of a model for a render.

    Raises:
        ConfigError: their form is wrong, as of ``checked_splats``.
    """
    found = model.splats(time, cameras)
    # Gradients and statistics are by row; what is only drawn may be a cut of a tree.
    rows = model.num_rows if torch.is_grad_enabled() else None
    return checked_splats(f"{type(model).__name__}.splats", found, rows)


def checked_groups(source: str, model: PrimitiveModel) -> None:
    """Check the parameter groups of a model.

    Args:
        source: the class and the call, such as "MyModel.parameter_groups".
        model: the model that is asked for them.

    Raises:
        ConfigError: one is no ``ParameterGroup``, has a field of another type, or the name of a
            column or of another group.
    """
    advice = 'Such as ParameterGroup("net", tuple(self.net.parameters()), LearningRate(1e-3)).'
    names = list(model.columns())
    groups: object = model.parameter_groups()
    if not isinstance(groups, Iterable):
        raise ConfigError(
            f"{source} returned {type(groups).__name__}, expected a tuple of ParameterGroup.",
            "Return () where there is none.",
        )
    for group in groups:
        if not isinstance(group, ParameterGroup):
            raise ConfigError(
                f"{source} returned {type(group).__name__}, expected a ParameterGroup.", advice
            )
        for field, value, kind in (
            ("parameters", group.parameters, tuple | list),
            ("learning_rate", group.learning_rate, LearningRate),
        ):
            if not isinstance(value, kind):
                wanted = "tuple" if field == "parameters" else "LearningRate"
                raise ConfigError(
                    f"{source} returned {type(value).__name__} as {field} of {group.name!r}, "
                    f"expected {wanted}.",
                    advice,
                )
        for tensor in group.parameters:
            if not isinstance(tensor, Tensor):
                raise ConfigError(
                    f"{source} returned {type(tensor).__name__} among the parameters of "
                    f"{group.name!r}, expected tensors.",
                    advice,
                )
        if group.name in names:
            raise ConfigError(
                f"{source} returned two groups, or a group and a column, of name {group.name!r}.",
                "Name each group differently, and not as a column.",
            )
        names.append(group.name)


def untrained_notes(model: PrimitiveModel) -> tuple[str, ...]:
    """A note on parameters that require gradients and are in no column and no group, if any."""
    held = [column.values for column in model.columns().values()]
    held += [tensor for group in model.parameter_groups() for tensor in group.parameters]
    known = {id(tensor) for tensor in held}
    names = [
        name
        for name, tensor in model.named_parameters()
        if tensor.requires_grad and id(tensor) not in known
    ]
    if not names:
        return ()
    return (
        f"not trained by gsfw: {', '.join(names)} of {type(model).__name__}, in no column and no "
        "parameter group. Return them in parameter_groups(), or call requires_grad_(False).",
    )


def checked_decode(source: str, output: object, cameras: int) -> RenderOutput:
    """The render that a model decoded.

    Args:
        source: the class and the call, such as "MyModel.decode".
        output: the result of the call.
        cameras: number of cameras.

    Raises:
        ConfigError: it is no ``RenderOutput``, or its colours are no [c, h, w, 3].
    """
    advice = "Return dataclasses.replace(output, color=color), with color [c, h, w, 3]."
    if not isinstance(output, RenderOutput):
        raise ConfigError(
            f"{source} returned {type(output).__name__}, expected RenderOutput.", advice
        )
    for name, tensor in (("color", output.color), ("alpha", output.alpha)):
        if not isinstance(tensor, Tensor):
            raise ConfigError(
                f"{source} returned {type(tensor).__name__} as {name}, expected a tensor.", advice
            )
    expected, found = [cameras, *output.alpha.shape[1:3], 3], list(output.color.shape)
    if found != expected:
        raise ConfigError(f"{source} returned color of shape {found}, expected {expected}.", advice)
    return output


def checked_settings(method: Method, settings: RenderSettings, step: int | None) -> RenderSettings:
    """The settings of a render, as ``Method.render_settings`` changes them.

    Raises:
        ConfigError: the method returned no ``RenderSettings``.
    """
    found: object = method.render_settings(settings, step)
    if not isinstance(found, RenderSettings):
        source = f"{method.registered_as or type(method).__name__}: render_settings"
        raise ConfigError(
            f"{source} returned {type(found).__name__}, expected RenderSettings.",
            "Return the settings that were given, or dataclasses.replace(settings, ...).",
        )
    return found


def checked_figures(source: str, figures: object) -> dict[str, float]:
    """The figures of a view or a step that a method returned, as plain numbers.

    Raises:
        ConfigError: they are no mapping of numbers; names the first that is none.
    """
    advice = (
        'Return a mapping such as {"depth_error": float(error.mean())}; {} where there is none.'
    )
    plain = {}
    for name, figure in checked_mapping(source, figures, "numbers by name", advice).items():
        if not isinstance(figure, Real):
            raise ConfigError(
                f"{source} returned {type(figure).__name__} for {name!r}, expected a number.",
                advice,
            )
        plain[name] = figure if isinstance(figure, int | float) else float(figure)
    return plain


def checked_images(source: str, images: object) -> Mapping[str, Tensor]:
    """The images of a view that a method returned.

    Raises:
        ConfigError: they are no mapping of tensors [h, w, 3]; names the first that is none.
    """
    advice = 'Return a mapping of tensors [h, w, 3] in [0, 1], such as {"error": error[0]}.'
    found = checked_mapping(source, images, "images by name", advice)
    for name, image in found.items():
        if not isinstance(image, Tensor) or image.dim() != 3 or image.shape[-1] != 3:
            form = (
                f"shape {list(image.shape)}" if isinstance(image, Tensor) else type(image).__name__
            )
            raise ConfigError(
                f"{source} returned an image of {form} for {name!r}, expected [h, w, 3].", advice
            )
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
