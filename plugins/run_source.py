"""RunSource: a restored run as a source for exporters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.contributions import MEASURES, Contributions, NoRowsError
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.exchange import (
    DepthView,
    ExportSource,
    MotionFile,
    Preview,
    SplatFile,
    StoredModel,
    TrackFile,
)
from gsfw.core.maths.frame import in_frame
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.model import PrimitiveModel
from gsfw.core.motion.evaluation import in_world
from gsfw.core.motion.fit import FittedMotion, fit_motion
from gsfw.core.splats import Sh, Splats
from gsfw.core.temporal_metrics.tracks import follow
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.compose import Composition
from gsfw.plugins.depth_views import depth_views
from gsfw.plugins.preview import preview
from gsfw.plugins.rebuild import stored_model
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import Restored
from gsfw.plugins.snapshot import snapshot, view_notes


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

    def splat_file(self) -> SplatFile:
        """The splats at one time, in the world of the data."""
        parts, settings = self.restored.composition.parts, self.restored.composition.plan.settings
        instant = torch.tensor(self.time, device=parts.device)
        return snapshot(parts.model, parts.data.scene, settings.antialias, instant, self.edit)

    def view_notes(self) -> list[str]:
        """Warnings on what ``splat_file`` lacks of the model, as a training view shows it."""
        parts = self.restored.composition.parts
        views = parts.data.views(Split.TRAIN).cameras
        if not views:
            return []
        instant = torch.tensor(self.time, device=parts.device)
        return view_notes(parts.model, views[0].to(parts.device), instant)

    @cached_property
    def fits(self) -> dict[bool, FittedMotion]:
        """The fits of motion that were asked for, with pieces or without."""
        return {}

    def fitted_motion(self, *, pieces: bool = True) -> FittedMotion:
        """The motion of all splats in closed form, in the scene frame, and what the form loses.

        Computed once.

        Raises:
            ValueError: the model is static, or nothing is seen at any time.
        """
        composition = self.restored.composition
        if not is_dynamic(composition):
            raise ValueError(f"method {composition.settings.method.name} does not move here")
        if pieces not in self.fits:
            self.fits[pieces] = fit_motion(
                composition.parts.model,
                composition.scene,
                data_times(composition),
                antialiased=composition.plan.settings.antialias,
                cuts=pieces,
            )
        return self.fits[pieces]

    def motion_file(self, *, pieces: bool = True) -> MotionFile:
        """The splats at all times, in the world of the data; those of a static model at rest.

        Raises:
            ValueError: nothing is seen at any time.
        """
        composition = self.restored.composition
        if not is_dynamic(composition):
            return self.splat_file().motion_file()
        return in_world(self.fitted_motion(pieces=pieces).file, composition.scene.world_from_scene)

    def depth_views(self) -> list[DepthView]:
        """Training views at ``time``, evenly spread over all, with depth.

        Raises:
            ValueError: the rasterizer renders no depth.
        """
        return depth_views(self.restored, self.time)

    def cameras(self) -> list[Cameras]:
        """The training cameras, in the world of the data."""
        parts, scene = self.restored.composition.parts, self.restored.composition.scene
        views = parts.data.views(Split.TRAIN).cameras
        return [in_frame(camera, scene.world_from_scene) for camera in views]

    def preview(self) -> Preview:
        """Some training views, and the image of the first one."""
        return preview(self.restored)

    def stored_model(self) -> StoredModel:
        """The whole model.

        Raises:
            ValueError: the model has state that is no tensor; names it.
        """
        return stored_model(self.restored)

    def contributions(self) -> Float[Tensor, " n"] | None:
        """Contribution of each row to the training views, float64 on the CPU; computed once.

        ``None`` where the run's rasterizer cannot measure it, or a view shows no rows, but a cut.
        """
        return self._contributions

    @cached_property
    def _contributions(self) -> Float[Tensor, " n"] | None:
        composition = self.restored.composition
        parts, settings = composition.parts, composition.plan.settings
        able = rasterizer_capabilities(installed())[composition.settings.choices["rasterizer"].name]
        if able.lacking(MEASURES, parts.device.type):
            return None
        model = parts.model
        cameras = [camera.to(parts.device) for camera in parts.data.views(Split.TRAIN).cameras]
        try:
            return Contributions.of(
                model.splats, model.num_rows, cameras, parts.rasterizer, settings
            ).total
        except NoRowsError:
            return None

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
            found = dc_to_rgb(splats.colors.coefficients[:, 0])
        else:
            found = splats.colors[:, :3]
        rows = slice(None) if splats.rows is None else splats.rows
        colors[rows] = found.to(colors)
    return colors
