"""`gsfw export RUN`: writes the splats of a run for other tools, or its model as one file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import RunOptions
from gsfw.commands.interface.export_options import PLY
from gsfw.commands.interface.export_times import ALL, parse_times
from gsfw.commands.interface.format_options import read_with_format
from gsfw.core.files.reading import bytes_of, names_folder
from gsfw.core.progress import stage, tracked
from gsfw.core.ranges import number
from gsfw.core.words import shell_argument, size

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.core.exchange import Exporter, SplatFile
    from gsfw.plugins.restore import Restored

MOST_COMPARED = 200_000
"""Splats of which a file is compared with the model: some seconds on two cores."""


@dataclass(kw_only=True)
class ExportOptions(RunOptions):
    """Write a run's splats, in the world of the data, or its whole model to a file."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw export latest",
        "gsfw export runs/first step=5000 out=first.ply",
        "gsfw export format=ply --help",
        "gsfw export runs/moving times=50 out=sequence",
        "gsfw export runs/moving format=gsfw out=moving.gsfw",
        "gsfw export runs/moving format=tracks times=all",
    )

    format: str = ""
    """Format of the file: ply, gsfw (the whole model, rendered anywhere without its data set),
    or another of the exporters that gsfw plugins lists. Empty: by the suffix of out, or ply. Some
    formats have options, format.KEY=VALUE: format=NAME --help lists them."""
    out: str = ""
    """File to write, or a folder for it. Empty: splats.ply or model.gsfw in the run; for a
    sequence, the folder splats in the run."""
    step: int | None = None
    """Step of the checkpoint. none: the last."""
    time: float = number(0.0, at_least=0, at_most=1)
    """Time of a moving model, in [0, 1]; a static one ignores it."""
    keep: float = number(1.0, above=0, at_most=1)
    """Fraction of the Gaussians to write, in (0, 1]: those that add most to the training views.
    gsfw tradeoff RUN measures the loss."""
    budget: str = ""
    """Maximum number of Gaussians to write, such as 200000, or megabytes of them as they are drawn,
    such as 20MB: levels of detail chosen for the training views. Empty: all."""
    sh_degree: int | None = None
    """Highest degree of view dependence (SH) to write, 0 to 4. none: the highest of the format."""
    times: str = ""
    """Write a numbered sequence of files instead of one: their number, evenly from time 0 to 1; or
    all, for the times of the data."""
    finetune: int = number(0, at_least=0)
    """Steps of further training, which fit the model to the rounding of
    format.precision=compressed."""


def run(arguments: list[str]) -> int:
    """Write the file or the files, and print their content."""
    options, given = read_with_format("export", ExportOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.detail import Detail
    from gsfw.commands.interface.export_options import (
        check_format,
        check_options,
        format_of_file,
        is_in_splats,
    )
    from gsfw.commands.interface.exported_model import check_finetune
    from gsfw.commands.interface.runs import find_run, restore_run
    from gsfw.commands.interface.splats_alone import or_splats_alone
    from gsfw.core.files.atomic import other_place
    from gsfw.plugins.exporters import check_sh_degree, check_suffix, make_exporter
    from gsfw.plugins.registry import installed

    check_options(options)
    registry = installed()
    options = replace(options, format=format_of_file(options, registry))
    exporter = make_exporter(options.format, registry, given)
    is_target = exporter.is_folder or not names_folder(options.out)
    if options.out and not options.times and is_target:
        check_suffix(Path(options.out), options.format, exporter, registry)
    check_format(options, exporter)
    check_sh_degree(options.sh_degree, options.format, exporter)
    console = Console(options.json)
    found = find_run(options.run, console.say)
    if is_in_splats(options, exporter):
        found = or_splats_alone(found, options.data, options.step, console.warn)
    check_finetune(options.finetune, found, exporter)
    detail = Detail.parse(options.budget, 0.0, "")
    restored = restore_run(found, registry, options.changed(), options.step, detail)
    place = "DIR" if exporter.is_folder or options.times else "FILE"
    with other_place(f"another place with out={place}"):
        document = _Export(options, exporter, found, restored, console).write()
        document |= _corrections(restored, document["written"], found, console)
    step = restored.step if found.splat_file is None else None
    about = {"run": found.name, "step": step, "format": options.format}
    console.result({**about, **document})
    return 0


@dataclass(frozen=True)
class _Export:
    """One call of the verb."""

    options: ExportOptions
    exporter: Exporter
    found: RunArgument
    restored: Restored
    console: Console

    def write(self) -> dict[str, Any]:
        """Write the content of the format; return the document."""
        from gsfw.core.exchange import Holds
        from gsfw.plugins.run_source import RunSource
        from gsfw.plugins.snapshot import NOTES

        if self.exporter.holds is Holds.MODEL:
            return self._model()
        if self.exporter.holds is Holds.DEPTHS:
            return self._surface()
        source = RunSource(self.restored, self.options.time)
        # A cut of a tree stands for the model in all views.
        cut = [NOTES["depends_on_view"]] if self.options.budget else []
        view_notes = [note for note in source.view_notes() if note not in cut]
        for note in view_notes:
            self.console.warn(note)
        if self.exporter.holds is Holds.TRACKS:
            document = self._tracks()
        elif self.exporter.holds is Holds.MOTION:
            document = self._motion()
        else:
            document = self._sequence() if self.options.times else self._splats()
        return document | {"notes": [*view_notes, *document.get("notes", [])]}

    def _splats(self) -> dict[str, Any]:
        """The model at one time, as one file."""
        from gsfw.commands.interface.exported_splats import splat_notes
        from gsfw.formats.visible_splats import without_invisible
        from gsfw.plugins.exporters import readable_value_errors
        from gsfw.plugins.run_source import RunSource
        from gsfw.studies.tradeoff.cut import cut

        options = self.options
        edit = cut(self.restored, options.keep, options.sh_degree)
        taken = RunSource(self.restored, options.time, edit=edit).splat_file()
        content, invisible = without_invisible(taken)
        path = self._path("splats")
        with readable_value_errors(path, options.format), stage(f"writing {path.name}"):
            self.exporter.write(path, content)
        splats, notes = content.splats, splat_notes(taken)
        left_out = f" ({invisible:,} too faint to be seen are left out)" if invisible else ""
        count = self._say(f"{len(splats):,} splats{left_out}", path)
        loss = self._loss(path, taken, notes)
        for note in notes:
            self.console.warn(note)
        return {
            "written": str(path),
            "num_gaussians": len(splats),
            "num_dropped": taken.num_dropped,
            "num_invisible": invisible,
            "bytes": count,
            **loss,
            "notes": notes,
        }

    def _loss(self, path: Path, taken: SplatFile, notes: list[str]) -> dict[str, Any]:
        """Compare a file with the model, where that takes seconds; say and note what it lost."""
        from gsfw.commands.interface.exported_splats import UNKNOWN, file_loss, is_comparable
        from gsfw.plugins.registry import installed

        form, registry = self.options.format, installed()
        if form == PLY or not len(taken.splats) or not is_comparable(path, self.exporter, registry):
            return UNKNOWN  # A PLY has the values as they are.
        if len(taken.splats) > MOST_COMPARED:
            again = f"gsfw convert {shell_argument(self.found.name)} FILE format={form} check=true"
            self.console.say(
                f"format {form} may round values; {again} writes another file and compares it"
            )
            return UNKNOWN
        loss = file_loss(path, form, taken, registry)
        is_cut = self.options.keep != 1 or self.options.sh_degree is not None
        model = "the model after keep= and sh_degree=" if is_cut else "the model"
        lines = filter(None, (loss.degree_line, f"PSNR against {model} {loss}"))
        self.console.say("\n".join(lines))
        notes += loss.notes
        return loss.document()

    def _sequence(self) -> dict[str, Any]:
        """The model at many times, as one file each."""
        from gsfw.formats.splat_sequence import SplatSequence
        from gsfw.plugins.exporters import readable_value_errors
        from gsfw.plugins.run_source import RunSource

        composition, step = self.restored.composition, self.restored.step
        times = parse_times(self.options.times, composition)
        out = self.options.out
        folder = Path(out) if out else self.found.folder.path / self._name("splats")
        source = RunSource(self.restored)
        sequence = SplatSequence(self.exporter, times, composition.scene.time_range, folder)
        about = {"method": composition.settings.method.name, "step": step}
        with readable_value_errors(folder, self.options.format):
            written = sequence.write(lambda time: source.at(time).splat_file(), about)
            files = list(tracked(written, "writing splats", len(times)))
        count = sum(bytes_of(path) for path in files)
        self.console.say(
            f"{len(files)} files after {step} steps, {size(count)}: {folder}\n"
            f"times of the files: {sequence.index}"
        )
        return {"written": [*map(str, files)], "index": str(sequence.index), "bytes": count}

    def _model(self) -> dict[str, Any]:
        """The model at all times, as one file."""
        from gsfw.commands.interface.exported_model import check_model, exported_model
        from gsfw.plugins.exporters import readable_value_errors

        check_model(self.found, self.exporter)
        path = self._path("model")
        with readable_value_errors(path, self.options.format):
            found = exported_model(self.restored, self.exporter, self.options.finetune)
            with stage(f"writing {path.name}"):
                self.exporter.write(path, found.source)
        count = self._say(f"method {found.model.method} with {found.model.rows:,} Gaussians", path)
        for line in found.lines():
            self.console.say(line)
        return {"written": str(path), "bytes": count, **found.document()}

    def _motion(self) -> dict[str, Any]:
        """The splats at all times, as one file or folder."""
        from gsfw.commands.interface.exported_motion import about_motion
        from gsfw.plugins.exporters import readable_value_errors
        from gsfw.plugins.run_source import RunSource

        path, source = self._path("scene"), RunSource(self.restored)
        with readable_value_errors(path, self.options.format), stage(f"writing {path.name}"):
            self.exporter.write(path, source)
        what, document, notes = about_motion(self.restored, source)
        count = self._say(what, path)
        for note in notes:
            self.console.warn(note)
        return {"written": str(path), "bytes": count, "notes": notes, **document}

    def _surface(self) -> dict[str, Any]:
        """The surface that views show at one time, as one file."""
        from gsfw.plugins.exporters import readable_value_errors
        from gsfw.plugins.run_source import RunSource

        path, source = self._path("surface"), RunSource(self.restored, self.options.time)
        with readable_value_errors(path, self.options.format):
            self.exporter.write(path, source)
        return {"written": str(path), "bytes": self._say("the surface that views show", path)}

    def _tracks(self) -> dict[str, Any]:
        """The paths of all Gaussians, as one file."""
        from gsfw.core.errors import ConfigError
        from gsfw.plugins.exporters import readable_value_errors
        from gsfw.plugins.run_source import RunSource, is_dynamic

        composition = self.restored.composition
        if not is_dynamic(composition):
            raise ConfigError(
                f"format={self.options.format}: {self.found.name} does not move.",
                "Its Gaussians as one file: format=ply",
            )
        times = parse_times(self.options.times or ALL, composition)
        content = RunSource(self.restored, times=times).track_file()
        path = self._path("tracks")
        with readable_value_errors(path, self.options.format), stage(f"writing {path.name}"):
            self.exporter.write(path, content)
        rows = content.tracks.opacities.shape[1]
        count = self._say(f"paths of {rows:,} Gaussians at {len(times)} times", path)
        about = {"num_gaussians": rows, "num_times": len(times)}
        return {"written": str(path), **about, "bytes": count}

    def _name(self, content: str) -> str:
        """Default name of a file, without suffix."""
        if self.found.model_file is not None:
            return self.found.model_file.stem
        last = self.found.checkpoint is None and self.options.step is None
        return content if last else f"{content}_{self.restored.step:09d}"

    def _path(self, content: str) -> Path:
        """Path of the file, or of the folder that a format is."""
        given = self.options.out
        out = Path(given) if given else self.found.folder.path
        if self.exporter.is_folder:
            return out if given else out / self._name(self.options.format)
        name = f"{self._name(content)}{self.exporter.suffix}"
        return out / name if not given or names_folder(given) else out

    def _say(self, content: str, path: Path) -> int:
        """Print the content and the path of a file or folder; return its size in bytes."""
        count, steps = bytes_of(path), f" after {self.restored.step} steps"
        after = "" if self.found.splat_file is not None else steps
        self.console.say(f"{content}{after}, {size(count)}: {path}")
        return count


def _corrections(
    restored: Restored, written: str | list[str], found: RunArgument, console: Console
) -> dict[str, Any]:
    """Write learnt exposures and cameras beside a file outside of the run folder."""
    from gsfw.formats.corrections import write_corrections

    first = written if isinstance(written, str) else written[0]
    folder = Path(first).absolute().parent
    if found.model_file is not None or folder.is_relative_to(found.folder.path.absolute()):
        return {}
    paths = write_corrections(restored.composition.parts, folder)
    for path in paths:
        console.say(f"learnt of the capture: {path}")
    return {"corrections": [str(path) for path in paths]} if paths else {}
