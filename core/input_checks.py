"""Checks of a rasterizer's inputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE, degree_of
from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats

ANY = -1
"""Any size, in an expected shape."""


def check_form(splats: Splats, cameras: Cameras, settings: RenderSettings) -> None:
    """Check shapes, dtypes and devices, but no values.

    Raises:
        ValueError: an input is wrong; names the field, the expected and the found value.
    """
    check_splats(splats)
    if cameras.width < 1 or cameras.height < 1:
        raise ValueError(f"cameras: image size {cameras.width}x{cameras.height} has no pixel")
    if len(cameras) == 0:
        raise ValueError("cameras: expected at least one, found none")
    _check_shape("cameras.world_to_camera", cameras.world_to_camera, (len(cameras), 4, 4))
    _check_shape("cameras.intrinsics", cameras.intrinsics, (len(cameras), 3, 3))
    if settings.background is not None and len(settings.background) != splats.channels:
        raise ValueError(
            f"settings.background: expected {splats.channels} channels, "
            f"found {len(settings.background)}"
        )
    if settings.contribution_weights is not None:
        _check_contribution_weights(settings.contribution_weights, cameras, settings)
    _check_types(_tensors_of_view(cameras, settings), splats.means)


def check_splats(splats: Splats) -> None:
    """Check shapes, dtypes and devices of splats, but no values.

    Raises:
        ValueError: a field is wrong; names it, the expected and the found value.
    """
    check_tensors(splats)
    has_axes = splats.quats is not None and splats.scales is not None
    if has_axes == (splats.covariances is not None) or (splats.quats is None) != (
        splats.scales is None
    ):
        raise ValueError("splats: give either quats and scales, or covariances")
    _check_shapes(splats)
    _check_types(_tensors_of_splats(splats), splats.means)
    _check_rows(splats)


def _check_rows(splats: Splats) -> None:
    rows = splats.rows
    if rows is None:
        return
    if not isinstance(rows, Tensor) or rows.dtype != torch.int64:
        found = rows.dtype if isinstance(rows, Tensor) else type(rows).__name__
        raise ValueError(f"splats.rows: expected a tensor of torch.int64, found {found}")
    _check_shape("splats.rows", rows, (len(splats),))
    if rows.device != splats.means.device:
        raise ValueError(f"splats.rows: expected device {splats.means.device}, found {rows.device}")


def _check_types(named: Mapping[str, Tensor], like: Tensor) -> None:
    for name, tensor in named.items():
        if tensor.dtype != like.dtype or not tensor.dtype.is_floating_point:
            raise ValueError(f"{name}: expected {like.dtype}, found {tensor.dtype}")
        if tensor.device != like.device:
            raise ValueError(f"{name}: expected device {like.device}, found {tensor.device}")


def _tensors_of_splats(splats: Splats) -> dict[str, Tensor]:
    """The floating-point tensors of splats, by the names in messages."""
    return {f"splats.{name}": tensor for name, tensor in splats.tensors().items()}


def _tensors_of_view(cameras: Cameras, settings: RenderSettings) -> dict[str, Tensor]:
    """All other floating-point tensors of a render, by the names in messages."""
    named = {
        "cameras.world_to_camera": cameras.world_to_camera,
        "cameras.intrinsics": cameras.intrinsics,
        "settings.background": settings.background,
        "settings.contribution_weights": settings.contribution_weights,
    }
    return {name: tensor for name, tensor in named.items() if tensor is not None}


def check_tensors(splats: Splats) -> None:
    """Check that all fields are tensors, and that none is missing.

    Raises:
        ValueError: one is of another type; names it.
    """
    colors = splats.colors
    needed = {
        "means": splats.means,
        "opacities": splats.opacities,
        "colors": colors.coefficients if isinstance(colors, Sh) else colors,
    }
    for name, value in (needed | splats.tensors()).items():
        if not isinstance(value, Tensor):
            raise ValueError(
                f"splats.{name}: expected a torch tensor, found {type(value).__name__}; "
                "torch.as_tensor makes one"
            )


def _check_contribution_weights(
    weights: Tensor, cameras: Cameras, settings: RenderSettings
) -> None:
    name = "settings.contribution_weights"
    _check_shape(name, weights, (len(cameras), cameras.height, cameras.width, 1))
    if Statistic.CONTRIBUTION not in settings.statistics:
        raise ValueError(f"{name}: expected Statistic.CONTRIBUTION in settings.statistics")


def _check_shapes(splats: Splats) -> None:
    n = len(splats) if splats.means.dim() else ANY
    expected = {
        "means": (n, 3),
        "opacities": (n,),
        "colors": (n, ANY),
        "rest": (n, ANY, 3),
        "quats": (n, 4),
        "scales": (n, 3),
        "covariances": (n, 3, 3),
        "extra": (n, ANY),
    }
    colors = splats.colors
    if isinstance(colors, Sh):
        expected["colors"] = (n, ANY, 3)
        if colors.offsets is not None:
            expected["rest"] = (ANY, 3)
            _check_shape("splats.colors.offsets", colors.offsets, (n + 1,))
        if not 0 <= colors.degree <= MAX_DEGREE:
            raise ValueError(f"splats.colors: expected degree 0 to 4, found {colors.degree}")
    for name, tensor in splats.tensors().items():
        _check_shape(f"splats.{name}", tensor, expected[name])
    if isinstance(colors, Sh):
        _check_parts(colors)
        _check_type_of_offsets(colors, splats.means.device)


def _check_parts(colors: Sh) -> None:
    if colors.offsets is not None and colors.rest is None:
        raise ValueError("splats.colors: expected rest beside offsets, found None")
    if colors.offsets is None:
        degree_of(colors.width)
    if colors.rest is not None and colors.coefficients.shape[1] != 1:
        raise ValueError(
            "splats.colors: expected one constant coefficient beside rest, "
            f"found {colors.coefficients.shape[1]}"
        )


def _check_type_of_offsets(colors: Sh, device: torch.device) -> None:
    offsets = colors.offsets
    if offsets is None:
        return
    name = "splats.colors.offsets"
    if offsets.dtype != torch.int64:
        raise ValueError(f"{name}: expected torch.int64, found {offsets.dtype}")
    if offsets.device != device:
        raise ValueError(f"{name}: expected device {device}, found {offsets.device}")


def _check_shape(name: str, tensor: Tensor, expected: tuple[int, ...]) -> None:
    fits = tensor.dim() == len(expected) and all(
        size in (ANY, found) for size, found in zip(expected, tensor.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size == ANY else str(size) for size in expected)
        raise ValueError(f"{name}: expected shape [{wanted}], found {list(tensor.shape)}")


def check_values(splats: Splats, cameras: Cameras, settings: RenderSettings) -> None:
    """Check that every value is finite and in its range; waits for a GPU once.

    Raises:
        ValueError: a value is wrong; names the field, the number of wrong rows, and the first one.
    """
    flags = [each.holds.all() for each in _conditions(splats, cameras, settings)]
    if not torch.stack([*flags, *_right_ends(splats.colors)]).all():
        for condition in _conditions(splats, cameras, settings):
            condition.refuse()
        _refuse_ends(splats.colors)


def _conditions(splats: Splats, cameras: Cameras, settings: RenderSettings) -> Iterator[_Condition]:
    """All conditions, one after another: flags of all values at once would take memory."""
    for name, tensor in (_tensors_of_splats(splats) | _tensors_of_view(cameras, settings)).items():
        yield _Condition(name, tensor.isfinite(), "finite values", tensor)
    yield from _in_range(splats, cameras)
    yield from _of_offsets(splats.colors)


@dataclass(frozen=True)
class _Condition:
    """A condition that every row of a field has to meet."""

    name: str
    """Name of the field."""
    holds: Tensor
    expected: str
    values: Tensor
    """Values that an error shows, row by row."""

    def refuse(self) -> None:
        """Raise a ``ValueError`` that names the first row where the condition does not hold."""
        holds = self.holds.flatten(1).all(1) if self.holds.dim() > 1 else self.holds
        wrong = (~holds).nonzero()[:, 0]
        if len(wrong):
            first = int(wrong[0])
            raise ValueError(
                f"{self.name}: expected {self.expected}; {len(wrong)} of {len(holds)} rows are "
                f"not, the first is row {first}: "
                f"{self.values[first].detach().flatten().tolist()[:16]}"
            )


def _in_range(splats: Splats, cameras: Cameras) -> Iterator[_Condition]:
    scales, opacities, intrinsics = splats.scales, splats.opacities, cameras.intrinsics
    if scales is not None:
        yield _Condition("splats.scales", scales >= 0, "scales >= 0", scales)
    within = (opacities >= 0) & (opacities <= 1)
    yield _Condition("splats.opacities", within, "values in [0, 1]", opacities)
    focal = torch.stack([intrinsics[:, 0, 0], intrinsics[:, 1, 1]], dim=1)
    yield _Condition("cameras.intrinsics", focal > 0, "focal lengths > 0", focal)
    skew = intrinsics[:, 0, 1]
    yield _Condition("cameras.intrinsics", skew == 0, "no skew", skew)


def _of_offsets(colors: Sh | Tensor) -> Iterator[_Condition]:
    if isinstance(colors, Sh) and colors.offsets is not None:
        lengths = colors.offsets.diff()
        yield _Condition("splats.colors.offsets", lengths >= 0, "row lengths >= 0", lengths)


def _right_ends(colors: Sh | Tensor) -> list[Tensor]:
    """Flags: the offsets of ragged coefficients begin at 0; they end with the rows."""
    if not isinstance(colors, Sh) or colors.offsets is None or colors.rest is None:
        return []
    return [colors.offsets[0] == 0, colors.offsets[-1] == len(colors.rest)]


def _refuse_ends(colors: Sh | Tensor) -> None:
    if all(_right_ends(colors)):
        return
    assert isinstance(colors, Sh)  # Others have no flags.
    assert colors.offsets is not None
    assert colors.rest is not None
    raise ValueError(
        f"splats.colors.offsets: expected 0 first and the {len(colors.rest)} rows of rest last, "
        f"found {int(colors.offsets[0])} and {int(colors.offsets[-1])}"
    )
