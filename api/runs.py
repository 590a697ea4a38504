"""Runs: train, open, look at, evaluate, export and resume a run from Python."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, final

from gsfw.api.calling import ALONE, calling
from gsfw.api.given_settings import as_words, by_key, layers_of
from gsfw.api.named_settings import without_settings_as_arguments
from gsfw.commands.interface.caller import Caller
from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError, without_inner_frames
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.notebook import is_notebook
from gsfw.plugins.registry import installed

if TYPE_CHECKING:
    from torch import Tensor

    from gsfw.api.models import Model
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.core.callback import Callback
    from gsfw.core.cameras import Cameras
    from gsfw.core.loop.evaluation import Evaluation
    from gsfw.core.render_output import RenderOutput
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.settings import Layer
    from gsfw.reports.run_record import RunRecord

__all__ = ["Run", "open", "train"]


@without_inner_frames
@without_settings_as_arguments
def train(
    *,
    method: str,
    data: str | Path | None = None,
    out: str | Path | None = None,
    preset: str | None = None,
    steps: int | Literal["auto"] | None = None,
    minutes: float | None = None,
    until: float | Literal["auto"] | None = None,
    seed: int | None = None,
    device: str | None = None,
    settings: Mapping[str, object] | None = None,
    callbacks: Sequence[Callback] = (),
    progress: bool = True,
) -> Run:
    """Train a run, as ``gsfw train`` does: the same settings, plan, checks, files and bits.

    Ctrl-C ends the run with a checkpoint; then a program gets ``KeyboardInterrupt``, and a notebook
    the unfinished run. Runs in threads of one process train one after another.

    Args:
        method: name of the method, such as "3dgs".
        data: folder or file of the data set; ``None`` for the built-in scene.
        out: new folder of the run; ``None`` for runs/SCENE/METHOD/TIME.
        preset: name of a preset of the method.
        steps: training steps; "auto" for until="auto".
        minutes: time of the run; without it, ``steps`` or a preset: the usual time for your data.
        until: PSNR in dB that ends the run, or "auto".
        seed: seed of every generator.
        device: auto, cpu, cuda or cuda:N.
        settings: all other settings by dotted key, such as ``{"strategy.cap_max": 40000}``;
            "config" names a config file, whose settings come before these.
        callbacks: watch the run, besides those of the settings.
        progress: false to print nothing.

    Raises:
        ConfigError: a setting is unknown, wrong or given as an argument of its own, or the parts do
            not fit together.
        DataError: the data set cannot be used.
        OutputError: the folder is in use, or cannot be written to.
        TrainingError: the GPU's memory is full, or steps are no longer finite.
    """
    given = {
        **{"method": method, "data": data, "out": out, "preset": preset, "steps": steps},
        **{"minutes": minutes, "until": until, "seed": seed, "device": device},
    }
    values = by_key(given, settings)
    with calling(callbacks, progress) as caller:
        code, folder = _train(values, caller)
    return _ended(code, Run(folder))


@without_inner_frames
def open(path: str | Path = "latest", *, data: str | Path | None = None, device: str = AUTO) -> Run:
    """Open a run that was trained here or elsewhere.

    Args:
        path: its folder, a checkpoint in it, or "latest".
        data: place of the data set; ``None`` for that of the training.
        device: auto, cpu, cuda or cuda:N; auto keeps that of the training.

    Raises:
        DataError: there is no such run; suggests the nearest name.
        ConfigError: it is a file of a model, which ``gsfw.load`` reads.
    """
    from gsfw.commands.interface.runs import find_run

    found = find_run(str(Path(path).expanduser()), lambda line: None, splats=True)
    if found.model_file or found.splat_file:
        raise ConfigError(
            f"{found.name} is a model and no run: it has no settings and no figures.",
            f"Load it: gsfw.load({found.name!r})",
        )
    return Run(found.folder.path, found.checkpoint, data=data, device=device)


@final
class Run:
    """A run in its folder; made by ``gsfw.train`` and ``gsfw.open``.

    Positions and cameras are in the world of the data. ``resume`` returns another ``Run``; this one
    keeps the figures that it had when they were first read.
    """

    def __init__(
        self,
        folder: Path,
        checkpoint: Path | None = None,
        *,
        data: str | Path | None = None,
        device: str = AUTO,
    ) -> None:
        """Take the folder of a run; use ``gsfw.open``, which checks it."""
        self.folder, self.checkpoint = folder.absolute(), checkpoint
        self._data, self._device = data, device
        values = {"data": data, "device": None if device == AUTO else device}
        self._changed = by_key(values, None)

    @cached_property
    def _record(self) -> RunRecord:
        from gsfw.reports.run_reader import read_run

        return read_run(RunFolder(self.folder))

    @property
    def settings(self) -> Mapping[str, Any]:
        """Every setting as plain data, by dotted key."""
        return self._record.settings

    @property
    def metrics(self) -> Mapping[str, Any]:
        """The final figures (metrics.json); those of the latest evaluation of an unfinished run.

        Means over the held-out views by name ("psnr", "ssim"), and in a finished run
        "num_gaussians", "train_seconds" and more; empty before any evaluation.
        """
        return self._record.summary or self._record.evaluation

    @property
    def steps(self) -> int:
        """Number of finished steps."""
        return self._record.steps_done

    @property
    def is_finished(self) -> bool:
        """True if it has trained all of its steps."""
        return self._record.is_finished

    @cached_property
    def _restored(self) -> Restored:
        from gsfw.commands.interface.runs import restore_run

        return restore_run(self._found, installed(), self._layer)

    @property
    def _found(self) -> RunArgument:
        from gsfw.commands.interface.runs import RunArgument

        return RunArgument(RunFolder(self.folder), self.checkpoint)

    @property
    def _layer(self) -> Layer | None:
        from gsfw.plugins.settings import COMMAND_LINE, Layer

        return Layer(COMMAND_LINE, self._changed) if self._changed else None

    @cached_property
    def model(self) -> Model:
        """The trained model, of the checkpoint or the latest one; reads the data set's cameras.

        Raises:
            DataError: there is no checkpoint, or the data set is gone.
        """
        from gsfw.api.models import Model

        return Model(self._found, self._layer, self._restored)

    def cameras(self, split: Literal["train", "eval"] = "eval") -> tuple[Cameras, ...]:
        """The cameras of the held-out or the training views, one each, as ``names``."""
        return self.model.cameras(split)

    def names(self, split: Literal["train", "eval"] = "eval") -> tuple[str, ...]:
        """The names of the images of the held-out or the training views, such as "0001.jpg"."""
        return self.model.names(split)

    def render(
        self,
        cameras: Cameras | Sequence[Cameras],
        *,
        time: float | None = None,
        background: str | Sequence[float] | Tensor | None = None,
        depth: bool = False,
    ) -> RenderOutput:
        """Render the model, as ``Model.render``."""
        return self.model.render(cameras, time=time, background=background, depth=depth)

    @without_inner_frames
    def evaluate(self, split: Literal["train", "eval"] = "eval") -> Evaluation:
        """Render the views of a split and compare them with their images; writes no file.

        Raises:
            DataError: the split has no views, or the images are gone.
        """
        from gsfw.commands.eval import evaluate_run
        from gsfw.core.datamanager import Split

        with ALONE:
            return evaluate_run(self._restored, Split(split))

    def export(
        self,
        path: str | Path,
        *,
        time: float = 0.0,
        format: str = "",
        options: Mapping[str, object] | None = None,
    ) -> Path:
        """Write splats or the whole model to a file, as ``Model.save``."""
        return self.model.save(path, time=time, format=format, options=options)

    @without_inner_frames
    @without_settings_as_arguments
    def resume(
        self,
        *,
        steps: int | None = None,
        settings: Mapping[str, object] | None = None,
        callbacks: Sequence[Callback] = (),
        progress: bool = True,
    ) -> Run:
        """Train on from the checkpoint, as ``gsfw resume``; returns the run with its new figures.

        Args:
            steps: new length of the run; ``None`` for its own.
            settings: other settings that may change on resuming, by dotted key.
            callbacks: watch the run, besides those of the settings.
            progress: false to print nothing.

        Raises:
            ConfigError: a setting cannot change, or ``steps`` are done already.
            DataError: there is no checkpoint, or the data set is gone.
            TrainingError: the GPU's memory is full, or steps are no longer finite.
        """
        from gsfw.commands.resume import check_changeable, resume_run

        changed = {**self._changed, **by_key({"steps": steps}, settings)}
        check_changeable(changed)
        command = ["resume", str(self.folder), *as_words(changed)]
        with calling(callbacks, progress) as caller:
            code = resume_run(self._found, changed, command, caller, clock.perf_counter())
        return _ended(code, Run(self.folder, data=self._data, device=self._device))

    def __reduce__(self) -> tuple[Callable[[], Run], tuple[()]]:
        """Cross to another process as its folder; the model is read there when it is used."""
        opened = partial(Run, self.folder, self.checkpoint, data=self._data, device=self._device)
        return opened, ()

    def __repr__(self) -> str:
        done = "finished" if self.is_finished else f"{self.steps} steps done"
        return f"<gsfw.Run {self.folder}: {self._record.method}, {done}>"

    def _repr_html_(self) -> str:
        """Figures and some held-out views, for notebooks."""
        from gsfw.commands.interface.run_in_notebook import run_html

        return run_html(self._record, lambda: self._restored.composition)


def _train(values: Mapping[str, object], caller: Caller) -> tuple[int, Path]:
    """Train a new run; the exit code, and its folder."""
    from gsfw.commands.train import announce
    from gsfw.core.progress import stage
    from gsfw.planning.asked import spelled_out
    from gsfw.plugins.settings import resolve

    began, registry = clock.perf_counter(), installed()
    given = spelled_out(layers_of(values))
    announce(given, registry, caller.console)
    with stage("loading torch and the method"):
        settings = resolve(registry, given)
    from gsfw.commands.interface.new_training import new_training
    from gsfw.commands.interface.team import check_started, joined

    config = settings.config
    check_started(config.processes)
    command = ["train", *as_words(values)]
    with joined(config.processes, config.shards, config.device) as team:
        new = new_training(settings, given, registry, command, began, team)
        caller.console.say(str(new))
        code, folder = new.train(caller, registry, team)
    return code, folder.path


def _ended(code: int, run: Run) -> Run:
    """The run, unless Ctrl-C has ended it in a program.

    Raises:
        KeyboardInterrupt: for that.
    """
    if code and not is_notebook():
        raise KeyboardInterrupt(
            f"{run.folder} has a checkpoint; continue with: gsfw.open({str(run.folder)!r}).resume()"
        )
    return run
