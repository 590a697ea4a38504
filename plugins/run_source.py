"""RunSource: a restored run as a source for exporters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.exchange import ExportSource, SplatFile, StoredModel, TrackFile
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.model import PrimitiveModel
from gsfw.core.splats import Sh, Splats
from gsfw.core.temporal_metrics.tracks import follow
from gsfw.plugins.compose import Composition
from gsfw.plugins.rebuild import stored_model
from gsfw.plugins.restore import Restored
from gsfw.plugins.snapshot import Snapshot, snapshot


def is_dynamic(composition: Composition) -> bool:
    """True if the model may change with time."""
    return composition.scene.is_dynamic and "static" not in composition.settings.method.tags


def data_times(composition: Composition) -> tuple[float, ...]:
    """All distinct times of the data, in [0, 1], ascending."""
    data = composition.parts.data
    return tuple(sorted({time for split in Split for time in data.views(split).times or ()}))


@dataclass(frozen=True)
class RunSource(ExportSource):
    """A run at one time, over some times, and as a whole."""

    restored: Restored
    time: float = 0.0
    """Time of the splats, in [0, 1]; a static model ignores it."""
    times: tuple[float, ...] = ()
    """Times of the tracks, in [0, 1]."""
    edit: Callable[[Splats], Splats] | None = None
    """Edit of the splats before the export, in the scene frame; ``None`` for none."""

    def at(self, time: float) -> RunSource:
        """The same run at another time."""
        return replace(self, time=time)

    def snapshot(self) -> Snapshot:
        """The splats at one time, and the number of dropped ones."""
        parts, settings = self.restored.composition.parts, self.restored.composition.plan.settings
        instant = torch.tensor(self.time, device=parts.device)
        return snapshot(parts.model, parts.data.scene, settings.antialias, instant, self.edit)

    def splat_file(self) -> SplatFile:
        """The splats at one time, in the world of the data."""
        return self.snapshot().content

    def stored_model(self) -> StoredModel:
        """The whole model.

        Raises:
            ValueError: the model has state that is no tensor; names it.
        """
        return stored_model(self.restored)

    @torch.no_grad()
    def track_file(self) -> TrackFile:
        """The paths of all rows at ``times``, in float64 on the CPU.

        Raises:
            ConfigError: there are fewer than two times.
        """
        times = self.times
        if len(times) < 2:
            raise ConfigError(
                f"tracks at {len(times)} times: expected at least 2.",
                "Paths need a moving model: gsfw export RUN format=tracks times=50",
            )
        parts, scene = self.restored.composition.parts, self.restored.composition.scene
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
    """Colour of each row at its first presence; black for rows that are never present."""
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
    """The coefficients of degree 0, which are independent of the direction."""
    if colors.offsets is not None:
        return colors.coefficients[colors.offsets[:-1]]
    return colors.coefficients[:, 0]
