"""``info`` of gsplat's ``rasterization``: what strategies read between two steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor

from gsfw.api import RenderOutput
from gsfw.compat.gsplat_projection import GsplatCamera
from gsfw.compat.screen import ScreenSplats, determinant


class Info(dict[str, Any]):
    """Intermediate results, by gsplat's names."""

    def __missing__(self, name: str) -> Any:  # noqa: ANN401
        raise KeyError(f"info[{name!r}] is not supported by gsfw.compat, which has {sorted(self)}")


@dataclass(frozen=True)
class Projected:
    """The splats in one image: all of them, or if packed those that are seen."""

    splats: ScreenSplats
    radii: Int[Tensor, "m 2"]
    rows: Int[Tensor, " m"] | None
    """Rows of the splats in the call; ``None`` for all."""


def attach_absolute_gradient(
    means2d: Tensor,
    outputs: list[RenderOutput],
    camera: GsplatCamera,
    join: Callable[[list[Tensor]], Tensor],
) -> None:
    """Give ``means2d`` its ``absgrad``, which is written when its gradient is."""
    absgrad = torch.zeros_like(means2d)
    means2d.absgrad = absgrad  # type: ignore[attr-defined]
    if not means2d.requires_grad:
        return
    measured = [output.statistics.absgrad for output in outputs]

    def write(_: Tensor) -> None:
        sums = join([one[0] for one in measured if one is not None])
        # Statistics are in normalized device coordinates; strategies convert pixels to these.
        absgrad[..., 0] = sums / (0.5 * camera.width)

    means2d.register_hook(write)


def make_info(
    projected: list[Projected],
    means2d: Tensor,
    join: Callable[[list[Tensor]], Tensor],
    cameras: list[GsplatCamera],
    dilation: float,
) -> Info:
    """Intermediate results: [c, n, ...], or if packed [m, ...] of the splats that are seen."""
    conics = []
    for one in projected:
        xx, xy, yy = one.splats.covariances
        whole = torch.stack([yy + dilation, -xy, xx + dilation], dim=1)
        conics.append(whole / determinant(one.splats.covariances, dilation)[:, None])
    rows = [one.rows for one in projected if one.rows is not None]
    numbers = [torch.full_like(held, index) for index, held in enumerate(rows)]
    return Info(
        means2d=means2d,
        radii=join([one.radii for one in projected]),
        depths=join([one.splats.depths for one in projected]),
        conics=join(conics),
        opacities=join([one.splats.opacities for one in projected]),
        gaussian_ids=torch.cat(rows) if rows else None,
        camera_ids=torch.cat(numbers) if rows else None,
        batch_ids=torch.zeros_like(torch.cat(rows)) if rows else None,
        width=cameras[0].width,
        height=cameras[0].height,
        n_cameras=len(cameras),
        n_batches=1,
    )
