"""Rasterizer: draws splats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import final

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Capabilities
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.splats import Sh, Splats


class Rasterizer(ABC):
    """Draws splats. A backend writes ``capabilities`` and ``_draw``; callers call ``render``."""

    @classmethod
    @abstractmethod
    def capabilities(cls) -> Capabilities:
        """What it can do on this machine; answers without building anything."""

    @final
    def render(
        self, splats: Splats, cameras: Cameras, settings: RenderSettings | None = None
    ) -> RenderOutput:
        """Draw ``splats`` from each camera.

        Raises:
            ValueError: an input has the wrong form, device or dtype, or (with full validation)
                holds values that cannot be drawn; the message names the field, and the first row.
        """
        settings = settings or RenderSettings()
        check_form(splats, cameras, settings)
        if settings.validation is Validation.FULL:
            check_values(splats, cameras)
        return self._draw(splats, cameras, settings)

    @abstractmethod
    def _draw(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        """Draw checked inputs."""


def check_form(splats: Splats, cameras: Cameras, settings: RenderSettings) -> None:
    """Check shapes, dtypes and devices, without looking at a value.

    Raises:
        ValueError: naming the field, what was expected and what was found.
    """
    has_axes = splats.quats is not None and splats.scales is not None
    if has_axes == (splats.covariances is not None) or (splats.quats is None) != (
        splats.scales is None
    ):
        raise ValueError("splats: give either quats and scales, or covariances")
    if cameras.width < 1 or cameras.height < 1:
        raise ValueError(f"cameras: image size {cameras.width}x{cameras.height} has no pixel")
    named = {f"splats.{name}": tensor for name, tensor in splats.tensors().items()}
    if isinstance(splats.colors, Sh) and splats.colors.offsets is not None:
        named.pop("splats.colors")
    for name, tensor in named.items():
        if len(tensor) != len(splats):
            raise ValueError(f"{name}: expected {len(splats)} rows, found {len(tensor)}")
    named = {f"splats.{name}": tensor for name, tensor in splats.tensors().items()}
    named |= {"cameras.world_to_camera": cameras.world_to_camera}
    named |= {"cameras.intrinsics": cameras.intrinsics}
    if settings.background is not None:
        named["settings.background"] = settings.background
        if len(settings.background) != splats.channels:
            raise ValueError(
                f"settings.background: expected {splats.channels} channels, "
                f"found {len(settings.background)}"
            )
    for name, tensor in named.items():
        if tensor.dtype != splats.means.dtype or not tensor.dtype.is_floating_point:
            raise ValueError(f"{name}: expected {splats.means.dtype}, found {tensor.dtype}")
        if tensor.device != splats.means.device:
            raise ValueError(
                f"{name}: expected device {splats.means.device}, found {tensor.device}"
            )


def check_values(splats: Splats, cameras: Cameras) -> None:
    """Check that every value can be drawn.

    Raises:
        ValueError: naming the field, how many rows are wrong, and the first of them.
    """
    named = {f"splats.{name}": tensor for name, tensor in splats.tensors().items()}
    named["cameras.world_to_camera"] = cameras.world_to_camera
    named["cameras.intrinsics"] = cameras.intrinsics
    for name, tensor in named.items():
        _refuse(name, ~tensor.isfinite(), "finite values", tensor)
    if splats.scales is not None:
        _refuse("splats.scales", splats.scales < 0, "scales >= 0", splats.scales)
    opacities = splats.opacities
    _refuse("splats.opacities", (opacities < 0) | (opacities > 1), "values in [0, 1]", opacities)
    focal = torch.stack([cameras.intrinsics[:, 0, 0], cameras.intrinsics[:, 1, 1]], dim=1)
    _refuse("cameras.intrinsics", focal <= 0, "focal lengths > 0", focal)
    skew = cameras.intrinsics[:, 0, 1]
    _refuse("cameras.intrinsics", skew != 0, "no skew", skew)


def _refuse(name: str, wrong: Tensor, expected: str, values: Tensor) -> None:
    rows = wrong.flatten(1).any(1) if wrong.dim() > 1 else wrong
    count = int(rows.sum())
    if count:
        first = int(rows.nonzero()[0])
        raise ValueError(
            f"{name}: expected {expected}; {count} of {len(rows)} rows are not, "
            f"the first is row {first}: {values[first].detach().flatten().tolist()[:16]}"
        )
