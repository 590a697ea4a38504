"""ExportTracks: the paths of a run's Gaussians in the world of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import TrackFile
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.model import PrimitiveModel
from gsfw.core.splats import Sh
from gsfw.core.temporal_metrics.tracks import follow
from gsfw.plugins.restore import Restored


@torch.no_grad()
def take_tracks(restored: Restored, times: Sequence[float]) -> TrackFile:
    """The paths of all rows at ``times``, in float64 on the CPU.

    Raises:
        ConfigError: one time is no path.
    """
    if len(times) < 2:
        raise ConfigError(
            f"tracks of {len(times)} time: expected at least 2.", "Give times=all or times=50."
        )
    parts, scene = restored.composition.parts, restored.composition.scene
    tracks = follow(parts.model, times)
    world = scene.world_from_scene.apply(tracks.positions.cpu())
    assert scene.time_range is not None
    first, last = scene.time_range
    return TrackFile(
        replace(tracks, positions=world, opacities=tracks.opacities.cpu()),
        origin=scene.world_from_scene.translation,
        data_times=tuple(first + time * (last - first) for time in times),
        colors=_first_colors(parts.model, times).cpu(),
    )


def _first_colors(model: PrimitiveModel, times: Sequence[float]) -> Float[Tensor, "n 3"]:
    """What each row looks like when it is there for the first time; black if it never is."""
    like = next(iter(model.columns().values())).values
    colors = torch.zeros(model.num_rows, 3, device=like.device)
    for time in reversed(times):
        splats = model.splats(torch.tensor(time, device=like.device))
        if isinstance(splats.colors, Sh):
            found = dc_to_rgb(_constant(splats.colors))
        else:
            found = splats.colors[:, :3]
        rows = slice(None) if splats.rows is None else splats.rows
        colors[rows] = found.to(colors)
    return colors


def _constant(colors: Sh) -> Float[Tensor, "n 3"]:
    """The coefficients that do not depend on the direction."""
    if colors.offsets is not None:
        return colors.coefficients[colors.offsets[:-1]]
    return colors.coefficients[:, 0]
