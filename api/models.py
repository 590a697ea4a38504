"""Models: load, render and save splats of any origin; differentiable renders of one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Literal, final

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.commands.interface.runs import RunArgument, find_run, restore_run
from gsfw.core.background import background_tensor
from gsfw.core.cameras import Cameras
from gsfw.core.config import AUTO
from gsfw.core.datamanager import Split, Views
from gsfw.core.embedded_image import image_element
from gsfw.core.errors import ConfigError, without_inner_frames
from gsfw.core.exchange import ExportSource, Holds
from gsfw.core.input_checks import check_tensors
from gsfw.core.maths.camera_path import at_times
from gsfw.core.maths.frame import in_frame
from gsfw.core.maths.inner_box import inner_box
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Splats
from gsfw.formats.visible_splats import without_invisible
from gsfw.plugins.compose import Composition
from gsfw.plugins.exporters import format_for, make_exporter, readable_value_errors
from gsfw.plugins.open_rasterizer import open_rasterizer, render_needs
from gsfw.plugins.registry import did_you_mean, installed
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import RunSource, data_times, is_dynamic
from gsfw.plugins.settings import COMMAND_LINE, Layer
from gsfw.plugins.splat_instant import check_export_time, check_time
from gsfw.rendering.camera_batches import one_batch
from gsfw.rendering.paths import PATHS, FilmRule, paths

__all__ = ["Model", "load", "render"]


@final
class Model:
    """A trained model, or the splats of a file; made by ``gsfw.load`` and ``Run.model``.

    Positions, cameras and depths are in the world of the data, as in exported files. Copies, and
    processes that it is sent to (it pickles), read its file again, which has to be there.
    """

    def __init__(
        self, found: RunArgument, changed: Layer | None, restored: Restored | None = None
    ) -> None:
        """Open a run or a file with settings that replace its own, or take a restored one."""
        self.name, self._changed = found.name, changed
        self._restored = restored or restore_run(found, installed(), changed)
        self._found = found.pinned(self._restored.step)

    def __reduce__(self) -> tuple[object, ...]:
        """Cross to another process as a file or a checkpoint, with the changed settings."""
        return Model, (self._found, self._changed)

    @property
    def _composition(self) -> Composition:
        return self._restored.composition

    @property
    def method(self) -> str:
        """Name of the method that renders it."""
        return self._composition.settings.method.name

    @property
    def device(self) -> torch.device:
        """Device of its tensors."""
        return self._composition.parts.device

    @property
    def num_gaussians(self) -> int:
        """Number of Gaussians."""
        return self._composition.parts.model.num_rows

    @property
    def is_dynamic(self) -> bool:
        """True if it may change with time."""
        return is_dynamic(self._composition)

    @property
    def antialias(self) -> bool:
        """True if it is rendered with Mip-Splatting's 2D filter."""
        return self._composition.plan.settings.antialias

    @cached_property
    def bounds(self) -> Float[Tensor, "2 3"]:
        """The lowest and the highest corner of the box of nearly all Gaussians, float64, CPU.

        It leaves out a sky, and the outermost 2 % on each side of each axis, which float far
        away; of a dynamic model at time 0.
        """
        return inner_box(self._world_splats(None).means)

    def _world_splats(self, time: float | None) -> Splats:
        return RunSource(self._restored, time or 0.0).splat_file().splats

    def splats(self, time: float | None = None) -> Splats:
        """The activated Gaussians, float32, without gradients.

        Rows that are not finite are left out. float32 is coarse for large coordinates. Splats that
        depend on the view are those without a view. ``Model.render`` is exact, and for each view.

        Args:
            time: in [0, 1]; ``None`` for 0. A static model ignores it.

        Raises:
            ConfigError: the time is out of range.
        """
        if time is not None:
            check_time(time)
        return self._world_splats(time).map(torch.Tensor.float).to(self.device)

    def cameras(self, split: Literal["train", "eval"] = "train") -> tuple[Cameras, ...]:
        """The cameras of the capture, one per view; float64 and on the CPU.

        Cameras of a splat file stand around it: 24 to train on, and one held out.

        Raises:
            ConfigError: there is no such split.
        """
        return tuple(self._in_world(camera) for camera in self._views("cameras", split).cameras)

    def names(self, split: Literal["train", "eval"] = "train") -> tuple[str, ...]:
        """The names of the capture's images, in the order of ``cameras``.

        Raises:
            ConfigError: there is no such split.
        """
        return self._views("names", split).names

    def _views(self, asked: str, split: str) -> Views:
        _check_choice(asked, split, [item.value for item in Split])
        return self._composition.parts.data.views(Split(split))

    def camera_path(
        self,
        what: Literal[
            "orbit", "path", "spiral", "time", "orbit-time", "path-time", "spiral-time"
        ] = "orbit",
        *,
        frames: int = 60,
        width: int = 0,
        time: float = 0.0,
    ) -> Cameras:
        """The cameras of a film, one per frame; float64 and on the CPU.

        Args:
            what: as of ``gsfw render what=``: orbit (around the scene), path (through the views),
                spiral, time (from one camera), or with time passing too.
            frames: number of frames.
            width: of the images in pixels; 0 for that of the views.
            time: of all frames, in [0, 1], of a dynamic model.

        Raises:
            ConfigError: the path needs a dynamic model, the time is out of range, or there is no
                such path.
        """
        check_time(time)
        _check_choice("camera_path", what, PATHS)
        (path,) = paths(self._composition, what, FilmRule(frames, width=width, time=time))
        return self._in_world(path.cameras)

    @without_inner_frames
    def render(
        self,
        cameras: Cameras | Sequence[Cameras],
        *,
        time: float | None = None,
        background: str | Sequence[float] | Tensor | None = None,
        depth: bool = False,
        rasterizer: str = AUTO,
    ) -> RenderOutput:
        """Render images, without gradients; statistics are those of each Gaussian of the model.

        Args:
            cameras: in the world of the data, of one image size.
            time: in [0, 1]; ``None`` for the times of the cameras, or 0 where they have none.
            background: white, black, "r,g,b" or three numbers in [0, 1]; ``None`` for that of the
                training.
            depth: true to render expected depth, too.
            rasterizer: name of a backend; auto for the model's own.

        Raises:
            ConfigError: the cameras differ in size, the time is out of range, or the rasterizer or
                background cannot be used.
        """
        joined = self._in_scene(one_batch(cameras))
        if time is not None:
            check_time(time)
            joined = at_times(joined, [time] * len(joined))
        settings = self._settings(background, depth)
        with torch.no_grad():
            # One by one: a camera's splats may depend on it, and on its time.
            outputs = [
                self._render(joined.select([index]), settings, rasterizer)
                for index in range(len(joined))
            ]
        output = outputs[0] if len(outputs) == 1 else RenderOutput.cat(outputs)
        if output.depth is None:
            return output
        return replace(output, depth=output.depth * self._composition.scene.world_from_scene.scale)

    def _settings(
        self, background: str | Sequence[float] | Tensor | None, depth: bool
    ) -> RenderSettings:
        parts, settings = self._composition.parts, self._composition.plan.settings
        kind = Depth.EXPECTED if depth else Depth.NONE
        color = background_tensor(background, settings.background)
        color = None if color is None else color.to(parts.device)
        return parts.method.render_settings(replace(settings, background=color, depth=kind), None)

    def _render(self, cameras: Cameras, settings: RenderSettings, rasterizer: str) -> RenderOutput:
        """Render one camera."""
        parts = self._composition.parts
        splats = parts.model.splats(None if cameras.time is None else cameras.time[0], cameras)
        backend = parts.rasterizer
        if rasterizer != AUTO:
            needs = render_needs(splats, cameras, settings)
            backend = open_rasterizer(rasterizer, parts.device, needs)
        output = parts.model.decode(backend.render(splats, cameras, settings), cameras)
        if splats.rows is None:
            return output
        statistics = _by_row(output.statistics, splats.rows, parts.model.num_rows)
        return replace(output, statistics=statistics)

    @without_inner_frames
    def save(
        self,
        path: str | Path,
        *,
        time: float = 0.0,
        format: str = "",
        options: Mapping[str, object] | None = None,
    ) -> Path:
        """Write a file for other tools, or the whole model; return its path.

        Args:
            path: the suffix chooses the format: .ply for the splats of ``Model.splats``, .gsfw for
                the whole model, or that of another installed exporter.
            time: in [0, 1], for the splats of a dynamic model.
            format: name of the exporter; empty for that of the suffix.
            options: options of the format by name; ``None`` for their defaults.

        Raises:
            ConfigError: no exporter writes such files, an option is unknown or wrong, or the time
                is out of range or given for a format of all times.
            DataError: the format cannot hold this model.
            OutputError: the file cannot be written.
        """
        path = Path(path).expanduser()
        registry = installed()
        form = format or format_for(path, registry, str(path))
        exporter = make_exporter(form, registry, options)
        check_export_time(time, form, exporter)
        source: ExportSource = RunSource(self._restored, time, data_times(self._composition))
        with readable_value_errors(path, form):
            if exporter.holds is Holds.SPLATS:
                source, _ = without_invisible(source.splat_file())
            exporter.write(path, source)
        return path

    def _in_world(self, cameras: Cameras) -> Cameras:
        return in_frame(cameras, self._composition.scene.world_from_scene)

    def _in_scene(self, cameras: Cameras) -> Cameras:
        moved = in_frame(cameras, self._composition.scene.world_from_scene.inverse())
        return moved.to(self.device, torch.float32)

    def __repr__(self) -> str:
        return f"<gsfw.Model {self.name}: {self.num_gaussians:,} Gaussians, method {self.method}>"

    def _repr_html_(self) -> str:
        """The first view, for notebooks."""
        camera = next(iter(self.cameras()), None)
        head = f"{self.num_gaussians:,} Gaussians of method {self.method}"
        image = "" if camera is None else image_element(self.render(camera).color[0])
        return f"<div>{head}</div><div>{image}</div>"


@without_inner_frames
def load(path: str | Path, *, device: str = AUTO) -> Model:
    """Load a model to render and to save.

    Args:
        path: a splat file of any tool (.ply, .spz, .sog, ...), a model file (.gsfw), the folder of
            a run, a checkpoint, or "latest".
        device: auto, cpu, cuda or cuda:N; auto keeps that of the training for a run.

    Raises:
        DataError: there is no such file, it is damaged, or of an unknown format.
        ConfigError: the settings of a run no longer resolve (a plugin is missing).
    """
    found = find_run(str(Path(path).expanduser()), lambda line: None, splats=True)
    return Model(found, None if device == AUTO else Layer(COMMAND_LINE, {"device": device}))


@without_inner_frames
def render(
    source: Model | Splats,
    cameras: Cameras | Sequence[Cameras],
    *,
    time: float | None = None,
    background: str | Sequence[float] | Tensor | None = None,
    antialias: bool = False,
    depth: bool = False,
    rasterizer: str = AUTO,
) -> RenderOutput:
    """Render splats, differentiably, or a model.

    Images of splats are differentiable with respect to every tensor of ``Splats`` and to the poses
    of the cameras; the tensors choose device and precision (float32, or float64 for checks).

    Args:
        source: splats, or a model (then as ``Model.render``).
        cameras: of one image size.
        time: in [0, 1], for dynamic models only.
        background: white, black, "r,g,b", or a number in [0, 1] for each channel; ``None`` for
            black, or for that of the training of a model.
        antialias: true for Mip-Splatting's 2D filter; a model has its own setting.
        depth: true to render expected depth, too.
        rasterizer: name of a backend; auto for the fastest one that fits.

    Raises:
        ConfigError: the cameras differ in size, the rasterizer or background cannot be used, or the
            source is neither.
        ValueError: a tensor has a wrong shape, type or value; names it.
    """
    if isinstance(source, Model):
        if antialias:
            raise ConfigError("render: antialias is a model's own setting.", "Leave it out.")
        return source.render(
            cameras, time=time, background=background, depth=depth, rasterizer=rasterizer
        )

    _check_source(source)
    if time is not None:
        raise ConfigError("render: these splats belong to one time already.", "Leave out time.")
    means = source.means
    batch = one_batch(cameras).to(means.device, means.dtype)
    color = background_tensor(background, dtype=means.dtype)
    settings = RenderSettings(
        background=None if color is None else color.to(means),
        antialias=antialias,
        depth=Depth.EXPECTED if depth else Depth.NONE,
    )
    backend = open_rasterizer(rasterizer, means.device, render_needs(source, batch, settings))
    return backend.render(source, batch, settings)


def _check_source(source: object) -> None:
    """Check what is to be rendered besides models.

    Raises:
        ConfigError: it is no splats.
        ValueError: a field of the splats is no tensor; names it.
    """
    if not isinstance(source, Splats):
        raise ConfigError(
            f"source: expected a Model or Splats, found {type(source).__name__}.",
            "gsfw.load(FILE) or run.model first; the cameras come second.",
        )
    check_tensors(source)


def _check_choice(function: str, given: str, choices: Sequence[str]) -> None:
    """Check a name against its choices.

    Raises:
        ConfigError: it is none of them; lists them.
    """
    if given not in choices:
        raise ConfigError(
            f"{function}: no {given!r}.{did_you_mean(str(given), choices)}",
            f"Choices: {', '.join(choices)}.",
        )


def _by_row(statistics: RenderStatistics, rows: Tensor, count: int) -> RenderStatistics:
    """Statistics of splats as those of all rows of a model; zeros for rows that are absent."""
    return statistics.map(
        lambda values: values.new_zeros(len(values), count).index_copy(1, rows, values)
    )
