"""`gsfw convert IN OUT`: splats from one file format to another, and what is lost on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.interface.arguments import Options, positional
from gsfw.commands.interface.format_options import read_with_format
from gsfw.core.files.reading import bytes_of, followed, names_folder
from gsfw.core.progress import stage
from gsfw.core.ranges import number
from gsfw.core.words import size

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.core.exchange import Exporter, ExportSource, SplatFile
    from gsfw.plugins.registry import Registry
    from gsfw.plugins.restore import Restored

MOST = 1_500_000
"""Splats that are compared by default: about a minute on two cores."""


@dataclass(kw_only=True)
class ConvertOptions(Options):
    """Convert splats from one file format to another, and measure what is lost."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw convert splats.ply splats.spz",
        "gsfw convert splats.ply splats.spz format.version=4 sh_degree=2",
        "gsfw convert runs/moving half.compressed.ply time=0.5 json=true",
    )

    source: str = positional("IN")
    """A splat file of any format, or its folder; a model file (.gsfw), a run folder, a checkpoint,
    or latest."""
    out: str = positional("OUT")
    """File to write, whose suffix chooses the format; or, with format=NAME, a folder for it."""
    format: str = ""
    """Format of OUT: one of the exporters that gsfw plugins lists. Empty: by the suffix of OUT.
    Some formats have options, format.KEY=VALUE: format=NAME --help lists them."""
    time: float = number(0.0, at_least=0, at_most=1)
    """Time of a moving model or file, in [0, 1]; splats at rest ignore it."""
    sh_degree: int | None = None
    """Highest degree of view dependence (SH) to write, 0 to 4. none: the highest of the format."""
    check: Literal["auto", "true", "false"] = "auto"
    """Read OUT back, and compare images of both from all around IN (PSNR); motion is compared with
    its model in training views. auto: only up to 1.5 million splats; more take over a minute."""


def run(arguments: list[str]) -> int:
    """Convert, and print counts, sizes and the loss."""
    options, given = read_with_format("convert", ConvertOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run
    from gsfw.core.files.atomic import other_place
    from gsfw.plugins.exporters import check_sh_degree, check_suffix, make_exporter
    from gsfw.plugins.registry import installed

    registry, console = installed(), Console(options.json)
    form = options.format or _format_of(options.out, registry)
    exporter = make_exporter(form, registry, given)
    if exporter.is_folder or not names_folder(options.out):
        check_suffix(Path(options.out), form, exporter, registry)
    found = find_run(options.source, console.say, splats=True, lead="IN is")
    _check_fit(options, form, exporter, found)
    check_sh_degree(options.sh_degree, form, exporter)
    path = _target(options, exporter, found)
    with other_place("another place for OUT"):
        document = _Conversion(options, form, exporter, found, path, registry, console).write()
    console.result(document)
    return 0


def _check_fit(options: ConvertOptions, form: str, exporter: Exporter, found: RunArgument) -> None:
    """Check that the options fit what is written.

    Raises:
        ConfigError: one is for splats at one time, and the format holds more.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.core.exchange import Holds

    is_whole = found.splat_file is None or exporter.holds is Holds.MODEL
    if (
        exporter.holds is not Holds.SPLATS
        and is_whole
        and (options.time or options.sh_degree is not None)
    ):
        raise ConfigError(
            f"format {form} holds {exporter.holds.value}: time and sh_degree are for splats at one "
            "time.",
            "Leave them out, or choose another format, such as ply.",
        )


def _format_of(target: str, registry: Registry) -> str:
    """The format that writes files with the suffix of OUT.

    Raises:
        ConfigError: there is none; lists the suffixes.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.exporters import format_of, writable_suffixes

    out, is_folder = Path(target), names_folder(target)
    form = None if is_folder else format_of(out, registry)
    if form is None:
        cause = f"no format ends in {out.suffix.lower()!r}" if out.suffix else "it has no suffix"
        cause = "it is a folder" if is_folder else cause
        raise ConfigError(
            f"{out}: the format of OUT is not known, since {cause}.",
            f"Suffixes that can be written: {writable_suffixes(registry)}. Or give the format: "
            "format=ply",
        )
    return form


def _target(options: ConvertOptions, exporter: Exporter, found: RunArgument) -> Path:
    """The path of OUT; nothing of IN is at it.

    Raises:
        ConfigError: OUT is IN, or a part of it.
    """
    from gsfw.core.errors import ConfigError

    out, source = Path(options.out), found.splat_file or found.model_file or found.folder.path
    if names_folder(options.out) and not exporter.is_folder:
        out = out / f"{source.name.partition('.')[0]}{exporter.suffix}"
    place, origin = followed(out), followed(source)
    is_input = out.exists() and out.samefile(source)
    is_part = found.splat_file is not None and origin in place.parents
    has_input = exporter.is_folder and place in origin.parents
    if is_input or is_part or has_input:
        what = "are the same" if is_input else "lie in one another"
        raise ConfigError(
            f"IN and OUT {what}: {source} would be overwritten by {out}.", "Give OUT another name."
        )
    return out


@dataclass(frozen=True)
class _Input:
    """The content of IN."""

    source: ExportSource
    """Content for the exporter."""
    splats: SplatFile | None = None
    """Its splats at one time; ``None`` if the format holds more."""
    restored: Restored | None = None
    """The run or model that it is taken from; ``None`` for a file of splats."""

    def view_notes(self) -> list[str]:
        """Warnings on what files of splats lack of the model of IN."""
        from gsfw.plugins.run_source import RunSource

        return [] if self.restored is None else RunSource(self.restored).view_notes()


@dataclass(frozen=True)
class _Conversion:
    """One call of the verb."""

    options: ConvertOptions
    form: str
    exporter: Exporter
    found: RunArgument
    path: Path
    registry: Registry
    console: Console

    def write(self) -> dict[str, Any]:
        """Write OUT, say what is in it, and return the document."""
        from gsfw.commands.interface.exported_splats import rounding_note
        from gsfw.plugins.exporters import readable_value_errors

        taken = self._input()
        source, invisible = taken.source, 0
        if taken.splats is not None:
            source, invisible = self._smaller(taken.splats)
        with readable_value_errors(self.path, self.form), stage(f"writing {self.path.name}"):
            self.exporter.write(self.path, source)
        document: dict[str, Any] = {
            "source": self.options.source,
            "written": str(self.path),
            "format": self.form,
            "bytes_before": self.found.num_bytes(self.registry),
            "bytes": bytes_of(self.path),
        }
        if taken.splats is None:
            return document | self._whole(taken, self._sizes(document))
        count = len(source.splat_file().splats)
        dropped = taken.splats.num_dropped
        notes = rounding_note(source.splat_file().splats)
        notes += taken.view_notes()
        document |= {"num_gaussians": count, "num_dropped": dropped, "num_invisible": invisible}
        self.console.say(f"{count:,} splats of {self.options.source} to {self._sizes(document)}")
        self._say_left_out(dropped, invisible)
        document |= self._loss(taken.splats, notes)
        for note in notes:
            self.console.warn(note)
        return {**document, "notes": notes}

    def _whole(self, taken: _Input, sizes: str) -> dict[str, Any]:
        """Say what a format has that holds more than splats at one time, and the loss."""
        from gsfw.core.exchange import Holds

        moved = f"{self.options.source} to {sizes}"
        if self.exporter.holds is Holds.DEPTHS:
            self.console.say(f"{moved}: the surface that views show")
            return {"notes": []}
        what, document, notes = self._about(taken)
        if self.exporter.holds is not Holds.MODEL:
            notes = [*notes, *taken.view_notes()]
        self.console.say(f"{what}, of {moved}")
        if taken.restored is None:
            self._say_left_out(document["num_dropped"], 0)
        for note in notes:
            self.console.warn(note)
        return document | {"notes": notes}

    def _about(self, taken: _Input) -> tuple[str, dict[str, Any], list[str]]:
        """The content of a format of motion, of tracks or of a model: words, data, warnings."""
        from gsfw.commands.interface.exported_motion import about_motion
        from gsfw.core.exchange import Holds
        from gsfw.plugins.run_source import RunSource

        source, holds = taken.source, self.exporter.holds
        if taken.restored is None:
            content = source.motion_file().content
            count = len(content.splats)
            document = {"num_gaussians": count, "num_dropped": content.num_dropped}
            return f"{count:,} moving splats", document, []
        if holds is Holds.MODEL:
            model = source.stored_model()
            what = f"method {model.method} with {model.rows:,} Gaussians"
            return what, {"num_gaussians": model.rows}, []
        assert isinstance(source, RunSource)
        rows = taken.restored.composition.parts.model.num_rows
        if holds is Holds.MOTION:
            compare = bool(source.fits) and self._is_compared(rows)
            return about_motion(taken.restored, source, compare)
        times = len(source.times)
        what = f"paths of {rows:,} Gaussians at {times} times"
        return what, {"num_gaussians": rows, "num_times": times}, []

    def _input(self) -> _Input:
        """Read IN.

        Raises:
            DataError: it is damaged, or of no format that can be read.
            ConfigError: a time is given, it moves, and the format holds all times.
        """
        from gsfw.commands.interface.runs import restore_run
        from gsfw.core.exchange import Holds
        from gsfw.plugins.initial_splats import find_importer
        from gsfw.plugins.run_source import RunSource, data_times
        from gsfw.plugins.splat_instant import check_export_time, read_at

        holds, file = self.exporter.holds, self.found.splat_file
        if file is not None and holds not in (Holds.MODEL, Holds.DEPTHS):
            with stage(f"reading {file.name}"):
                if holds is Holds.MOTION:
                    moving = find_importer(file, self.registry).read_motion(file)
                    if not moving.is_still:
                        check_export_time(self.options.time, self.form, self.exporter)
                    return _Input(moving, moving.content if moving.is_still else None)
                content = read_at(file, self.options.time, self.registry)
            return _Input(content, content)
        restored = restore_run(self.found, self.registry)
        source = RunSource(restored, self.options.time, data_times(restored.composition))
        if holds is not Holds.SPLATS:
            return _Input(source, restored=restored)
        return _Input(source, source.splat_file(), restored)

    def _smaller(self, content: SplatFile) -> tuple[SplatFile, int]:
        """The splats to be written, and the number of invisible ones that are not."""
        from gsfw.formats.visible_splats import without_invisible

        degree = self.options.sh_degree
        if degree is not None:
            content = replace(content, splats=content.splats.up_to(degree))
        return without_invisible(content)

    def _sizes(self, document: Mapping[str, Any]) -> str:
        """OUT with its size: "b.ply, 2.0 MB (4.1 times smaller)"."""
        before, after = document["bytes_before"], document["bytes"]
        text = f"{self.path}, {size(after)}"
        if not before or not after:
            return text
        ratio = max(before / after, after / before)
        if ratio < 1.05:
            return f"{text} (as before)"
        return f"{text} ({ratio:.1f} times {'smaller' if after < before else 'larger'})"

    def _say_left_out(self, dropped: int, invisible: int) -> None:
        parts = [f"{dropped:,} that are not finite"] * bool(dropped)
        parts += [f"{invisible:,} too faint to be seen"] * bool(invisible)
        if parts:
            self.console.say(f"left out: {', '.join(parts)}")

    def _is_compared(self, count: int) -> bool:
        """True to compare images of so many splats; says so if they are too many."""
        if self.options.check == "auto" and count > MOST:
            self.console.say(
                f"not compared: images of {count:,} splats would take over a minute; check=true "
                "makes them"
            )
            return False
        return self.options.check != "false"

    def _loss(self, before: SplatFile, notes: list[str]) -> dict[str, Any]:
        """Compare OUT with IN; say the PSNR, or why there is none, and note what is gone."""
        from gsfw.commands.interface.exported_splats import UNKNOWN, file_loss, is_comparable

        if self.options.check == "false":
            return UNKNOWN
        if not is_comparable(self.path, self.exporter, self.registry):
            self.console.say(f"not compared: nothing here reads format {self.form}")
            return UNKNOWN
        if not self._is_compared(len(before.splats)):
            return UNKNOWN
        loss = file_loss(self.path, self.form, before, self.registry)
        if loss.degree_line:
            self.console.say(loss.degree_line)
        notes += loss.notes
        self.console.say(f"PSNR against IN {loss}")
        return loss.document()
