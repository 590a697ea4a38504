"""Session: one call of `gsfw edit`: opens the input, applies the steps, and writes the file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from gsfw.commands.edit.output import Output
from gsfw.commands.edit.verb import EditOptions
from gsfw.commands.interface.arguments import changed_place
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.runs import RunArgument, find_run, restore_run
from gsfw.core.capabilities import check_fit
from gsfw.core.contributions import MEASURES
from gsfw.core.datamanager import Split, spread
from gsfw.core.errors import ConfigError, DataError, UserError
from gsfw.core.exchange import ExportSource, Holds, SplatFile, StoredModel
from gsfw.core.files.atomic import other_place, write_atomically
from gsfw.core.files.reading import bytes_of
from gsfw.core.maths.similarity import Similarity
from gsfw.core.progress import stage
from gsfw.core.words import size
from gsfw.editing.capture import Capture
from gsfw.editing.editable import Editable, EditableSplats
from gsfw.editing.editable_model import EditableModel
from gsfw.editing.operations.catalogue import OPERATIONS
from gsfw.editing.operations.edit import Surroundings
from gsfw.editing.script import Step, StepResult, apply, write_steps
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.exporters import check_sh_degree
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import RunSource, data_times, is_dynamic
from gsfw.plugins.settings import Layer
from gsfw.plugins.shorter_bands import without_bands
from gsfw.plugins.splat_instant import read_at
from gsfw.plugins.splat_run import run_of_splats

ELSEWHERE = "another place with out=FILE"
"""Remedy for a place that cannot be written to."""
INSTANTS = 33
"""Most times of the data at which the rows of a moving model are tested, spread evenly."""


@dataclass(frozen=True)
class Session:
    """One call of the verb."""

    options: EditOptions
    given: Mapping[str, str]
    """Options of the format by name, as text."""
    steps: Sequence[Step]
    found: RunArgument
    registry: Registry
    console: Console

    def run(self) -> dict[str, Any]:
        """Edit and write; return the document."""
        output, results = self._output, list[StepResult]()
        for step in self.steps:
            if step.name == "sh_degree":
                check_sh_degree(int(step.text), output.format, output.exporter)

        def done(result: StepResult) -> None:
            results.append(result)
            self.console.say(str(result))

        around = Surroundings(self._read, self._num_bytes)
        piece = apply(self.steps, self._open(), around, done)
        document: dict[str, Any] = {
            "input": self.found.name,
            "format": output.format,
            "written": None,
            "steps": [result.document() for result in results],
            "num_gaussians": len(piece),
            "bytes_before": self.found.num_bytes(self.registry),
        }
        if self.options.dry_run:
            self.console.say(f"{output.path} would hold {len(piece):,} Gaussians: nothing written")
            return document
        return document | self._write(piece, results)

    @cached_property
    def _output(self) -> Output:
        """The file to write."""
        is_run = self.found.splat_file is None and self.found.model_file is None
        is_open = not self.options.out and not self.options.format
        moves = is_run and is_open and is_dynamic(self._restored.composition)
        return Output.of(self.options, self.given, self.found, moves, self.registry)

    @cached_property
    def _restored(self) -> Restored:
        """The run; for a file of splats one around it."""
        return restore_run(self.found, self.registry, self._changed, self.options.step)

    @property
    def _changed(self) -> Layer | None:
        """Settings that differ from those of the run; ``None`` for none."""
        return changed_place(self.options.data, self.options.device)

    @cached_property
    def _capture(self) -> Capture:
        """The cameras that saw the input; for a file of splats the invented ones around it.

        Raises:
            ConfigError: its rasterizer cannot measure contributions, and a step needs them.
        """
        restored, found = self._restored if not self.options.views else None, self.found
        if restored is None:
            found = find_run(self.options.views, self.console.say, lead="views=RUN:")
            restored = restore_run(found, self.registry, self._changed)
        composition = restored.composition
        parts, settings = composition.parts, composition.plan.settings
        name = composition.settings.choices["rasterizer"].name
        needs = {step.name: MEASURES for step in self.steps if OPERATIONS[step.name].renders}
        check_fit(name, needs, rasterizer_capabilities(self.registry), parts.device.type)
        return Capture(
            cameras=parts.data.views(Split.TRAIN).cameras,
            world_from_scene=parts.data.scene.world_from_scene,
            rasterizer=parts.rasterizer,
            settings=settings,
            device=parts.device,
            source=found.name,
            invented=found.splat_file is not None,
        )

    def _open(self) -> Editable:
        """Open the input to be edited.

        Raises:
            ConfigError: options do not fit it.
        """
        options, name = self.options, self._output.path.name
        if self.found.splat_file is not None and options.step is not None:
            raise ConfigError(
                f"step={options.step}: {self.found.name} is a file of splats, and has no steps.",
                "Leave step out.",
            )
        if self._output.is_model and self.found.splat_file is None:
            if options.time or options.views:
                given = f"time={options.time:g}" if options.time else f"views={options.views}"
                raise ConfigError(
                    f"{given}: {name} holds the model at all times, with its cameras.",
                    "Leave it out, or write a file of splats: out=FILE.ply",
                )
            return self._open_model()
        if options.over_time == "all":
            raise ConfigError(
                f"over_time=all: {name} holds splats at one time.",
                "Write the model at all times: out=FILE.gsfw",
            )
        return self._open_splats()

    def _open_splats(self) -> EditableSplats:
        if self.found.splat_file is None:
            self._warn_of_rest()
            source = RunSource(self._restored, self.options.time)
            for note in source.view_notes():
                self.console.warn(note)
            content = source.splat_file()
        else:
            with stage(f"reading {self.found.splat_file.name}"):
                content = read_at(self.found.splat_file, self.options.time, self.registry)
        if content.num_dropped:
            self.console.warn(f"{content.num_dropped:,} splats were left out: they are not finite.")
        return EditableSplats(content, lambda: self._capture, Similarity())

    def _warn_of_rest(self) -> None:
        """Say that a format of motion gets the splats of a moving run at one time only."""
        output = self._output
        if output.exporter.holds is Holds.MOTION and is_dynamic(self._restored.composition):
            self.console.warn(
                f"{output.path.name} shows time {self.options.time:g} alone, at rest. For all "
                f"times: out=FILE.gsfw, then gsfw export FILE.gsfw format={output.format}"
            )

    def _open_model(self) -> EditableModel:
        composition = self._restored.composition
        times = data_times(composition) if is_dynamic(composition) else (0.0,)
        return EditableModel(
            model=composition.parts.model,
            method=composition.settings.method.name,
            given=self._capture,
            times=tuple(times[index] for index in spread(range(len(times)), INSTANTS)),
            at_all_times=self.options.over_time == "all",
            time=0.0,
            moved=Similarity(),
            up=composition.scene.up,
        )

    def _read(self, path: Path) -> SplatFile:
        with stage(f"reading {path.name}"):
            return find_importer(path, self.registry).read(path)

    def _content(self, piece: Editable) -> ExportSource:
        """The content of a file with what is edited."""
        content = piece.as_file()
        if content is None:
            return self._model(piece)
        return self._as_model(content) if self._output.is_model else content

    def _as_model(self, content: SplatFile) -> RunSource:
        """The model of 3DGS that splats fit into, with cameras around them."""
        beyond = int((~content.splats.held_by_float32()).sum())
        if beyond:
            raise ValueError(f"{_splats_have(beyond)} values beyond float32")
        path = self._output.path
        return RunSource(run_of_splats(content, path, self.registry, self._changed))

    def _model(self, piece: Editable) -> _EditedModel:
        source = RunSource(self._restored)
        stored = source.stored_model()
        scene = replace(stored.scene, world_from_scene=piece.world_from_scene(), up=piece.up)
        stored = replace(stored, scene=scene)
        degrees = [int(step.text) for step in self.steps if step.name == "sh_degree"]
        if degrees:
            stored = without_bands(stored, min(degrees), self.registry)
        return _EditedModel(stored, source)

    @contextmanager
    def _value_errors(self) -> Iterator[None]:
        """Turn an exporter's ValueError into a message for the user.

        Raises:
            DataError: in place of the exporter's ValueError.
        """
        output = self._output
        try:
            yield
        except UserError:
            raise
        except ValueError as error:
            raise DataError(
                f"{output.path}: format {output.format} cannot hold this: {error}.",
                "clean=all leaves out what no format can hold.",
            ) from error

    def _num_bytes(self, piece: Editable) -> int:
        """Size of the file that would be written."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self._output.path.name
            with self._value_errors():
                self._output.exporter.write(path, self._content(piece))
            return bytes_of(path)

    def _write(self, piece: Editable, results: Sequence[StepResult]) -> dict[str, Any]:
        """Write the file and its steps; return the rest of the document."""
        output = self._output
        name = output.path.name
        with other_place(ELSEWHERE), self._value_errors(), stage(f"writing {name}"):
            output.exporter.write(output.path, self._content(piece))
        with other_place(ELSEWHERE):
            write_atomically(output.steps, write_steps(results, self.found.name))
        after, before = bytes_of(output.path), self.found.num_bytes(self.registry)
        sizes = size(after) if before is None else f"{size(before)} -> {size(after)}"
        self.console.say(
            f"{len(piece):,} Gaussians, {sizes}: {output.path}\n"
            f"the steps, to repeat them: edits={output.steps}"
        )
        return {"written": str(output.path), "edits": str(output.steps), "bytes": after}


def _splats_have(count: int) -> str:
    """The subject and the verb of a sentence on ``count`` splats."""
    return "1 splat has" if count == 1 else f"{count:,} splats have"


@dataclass(frozen=True)
class _EditedModel(ExportSource):
    """A model in another world, whose parameters were changed in those of its run."""

    stored: StoredModel
    run: RunSource

    def stored_model(self) -> StoredModel:
        """The model."""
        return self.stored

    def contributions(self) -> Float[Tensor, " n"] | None:
        """Contributions of the edited rows to the training views, which moved with the world."""
        return self.run.contributions()
