"""`gsfw export RUN`: a run's splats as files that other tools open, or its model as one file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.arguments import read
from gsfw.commands.run_options import RunOptions

if TYPE_CHECKING:
    from gsfw.commands.console import Console
    from gsfw.commands.run_argument import RunArgument
    from gsfw.core.exchange import Exporter, ModelExporter, TrackExporter
    from gsfw.core.splats import Splats
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.snapshot import Snapshot

TOO_COARSE = 0.1
"""Rounding of positions, relative to the median splat, above which a note says so."""


@dataclass(kw_only=True)
class ExportOptions(RunOptions):
    """Write a run's splats to a file, in the world of the data, or its whole model."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw export latest",
        "gsfw export runs/first format=ply step=5000 out=first.ply",
        "gsfw export runs/moving times=50 out=sequence",
        "gsfw export runs/moving format=gsfw out=moving.gsfw",
        "gsfw export runs/moving format=tracks times=all",
    )

    format: str = "ply"
    """Format of the file: ply, gsfw (the whole model, to be drawn anywhere without its data set),
    or another of the exporters that gsfw plugins lists."""
    out: str = ""
    """File to write, or a folder for it. Empty: splats.ply or model.gsfw in the run; the folder
    splats in it for a sequence."""
    step: int | None = None
    """Which checkpoint, by its step. none: the last."""
    time: float = 0.0
    """When a model that moves is written, in [0, 1]; a static one ignores it."""
    keep: float = 1.0
    """Part of the Gaussians that is written, in (0, 1]: those that add most to the training views.
    What that costs: gsfw tradeoff RUN."""
    sh_degree: int | None = None
    """Degree of view dependence above which nothing is written. none: all of it."""
    times: str = ""
    """A numbered sequence of files instead of one: how many, evenly from time 0 to 1, or all, for
    the times of the data."""


def run(arguments: list[str]) -> int:
    """Write the file, or the files, and say what is in them."""
    options = read("export", ExportOptions, arguments)

    from gsfw.commands.console import Console
    from gsfw.commands.open_run import open_run
    from gsfw.commands.run_argument import find_run
    from gsfw.core.exchange import ModelExporter, TrackExporter
    from gsfw.plugins.loading import load
    from gsfw.plugins.registry import installed

    _check(options)
    registry = installed()
    exporter = load("exporter", registry.find("exporter", options.format))()
    console, found = Console(options.json), find_run(options.run)
    _check_cut(options, exporter)
    restored = open_run(found, registry, options.changed(), options.step)
    if isinstance(exporter, ModelExporter):
        document = _export_model(restored, options, exporter, found, console)
    elif isinstance(exporter, TrackExporter):
        document = _export_tracks(restored, options, exporter, found, console)
    elif options.times:
        document = _export_sequence(restored, options, exporter, found, console)
    else:
        document = _export_splats(restored, options, exporter, found, console)
    document |= _corrections(restored, document["written"], found, console)
    about = {"run": found.name, "step": restored.step, "format": options.format}
    console.result({**about, **document})
    return 0


def _check(options: ExportOptions) -> None:
    """Refuse times that contradict each other, before anything is loaded."""
    from gsfw.core.errors import ConfigError

    if not 0 <= options.time <= 1:
        raise ConfigError(f"time={options.time:g}: expected a time in [0, 1].")
    if options.times and options.time:
        raise ConfigError(
            f"time={options.time:g} and times={options.times} are both given.",
            "Give time for one file, or times for a sequence.",
        )


def _check_cut(options: ExportOptions, exporter: object) -> None:
    """Refuse to cut down what is not one set of splats.

    Raises:
        ConfigError: a number is out of range, or the format holds something else.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.core.exchange import Exporter

    if not 0 < options.keep <= 1:
        raise ConfigError(f"keep={options.keep:g}: expected a part above 0, and at most 1.")
    if options.sh_degree is not None and options.sh_degree < 0:
        raise ConfigError(f"sh_degree={options.sh_degree}: expected 0 or more.")
    if (options.keep < 1 or options.sh_degree is not None) and (
        options.times or not isinstance(exporter, Exporter)
    ):
        what = f"times={options.times}" if options.times else f"format={options.format}"
        raise ConfigError(
            f"{what}: keep and sh_degree cut down one set of splats.",
            "Give them with format=ply, and without times.",
        )


def _name(restored: Restored, options: ExportOptions, found: RunArgument) -> str:
    """What files are called that are given no name."""
    if found.model_file is not None:
        return found.model_file.stem
    last = found.checkpoint is None and options.step is None
    return "splats" if last else f"splats_{restored.step:09d}"


def _export_splats(
    restored: Restored,
    options: ExportOptions,
    exporter: Exporter,
    found: RunArgument,
    console: Console,
) -> dict[str, Any]:
    """The model at one time, as one file; what is in it."""
    taken = _take(restored, options)
    path = _place(options, found.folder.path, _name(restored, options, found), exporter.suffix)
    with _what_it_holds(path, options.format):
        exporter.write(path, taken.content)
    splats, notes = taken.content.splats, _notes(taken)
    for note in notes:
        console.warn(note)
    size = path.stat().st_size
    console.say(f"{len(splats):,} splats after {restored.step} steps, {size / 1e6:.1f} MB: {path}")
    return {
        "written": str(path),
        "num_gaussians": len(splats),
        "num_dropped": taken.num_dropped,
        "bytes": size,
        "notes": notes,
    }


def _export_sequence(
    restored: Restored,
    options: ExportOptions,
    exporter: Exporter,
    found: RunArgument,
    console: Console,
) -> dict[str, Any]:
    """The model at many times, as one file each; what is in them."""
    from gsfw.commands.export_sequence import SplatSequence, parse_times
    from gsfw.commands.progress import with_progress

    times = parse_times(options.times, restored.composition)
    name = _name(restored, options, found)
    folder = Path(options.out) if options.out else found.folder.path / name
    sequence = SplatSequence(restored, exporter, times, folder)
    with _what_it_holds(folder, options.format):
        files = with_progress(sequence.write(), len(times), "splats")
    size = sum(path.stat().st_size for path in files)
    console.say(
        f"{len(files)} files after {restored.step} steps, {size / 1e6:.1f} MB: {folder}\n"
        f"when each of them is: {sequence.index}"
    )
    return {"written": [str(path) for path in files], "index": str(sequence.index), "bytes": size}


def _export_model(
    restored: Restored,
    options: ExportOptions,
    exporter: ModelExporter,
    found: RunArgument,
    console: Console,
) -> dict[str, Any]:
    """The model at all times, as one file; what is in it."""
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.rebuild import stored_model

    if options.times or options.time:
        raise ConfigError(
            f"format={options.format} holds the model at all times: leave out time and times.",
            "For what it looks like at one of them: format=ply time=0.5",
        )
    if found.model_file is not None:
        raise ConfigError(f"{found.name} is a model file already.", "Copy it.")
    name = _name(restored, options, found).replace("splats", "model")
    path = _place(options, found.folder.path, name, exporter.suffix)
    with _what_it_holds(path, options.format):
        model = stored_model(restored)
        exporter.write(path, model)
    size = path.stat().st_size
    console.say(
        f"method {model.method} with {model.rows:,} Gaussians after {model.step} steps, "
        f"{size / 1e6:.1f} MB: {path}"
    )
    return {"written": str(path), "num_gaussians": model.rows, "bytes": size}


def _export_tracks(
    restored: Restored,
    options: ExportOptions,
    exporter: TrackExporter,
    found: RunArgument,
    console: Console,
) -> dict[str, Any]:
    """The paths of all Gaussians, as one file; what is in it."""
    from gsfw.commands.export_sequence import parse_times
    from gsfw.commands.export_tracks import take_tracks

    content = take_tracks(restored, parse_times(options.times or "all", restored.composition))
    name = _name(restored, options, found).replace("splats", "tracks")
    path = _place(options, found.folder.path, name, exporter.suffix)
    exporter.write(path, content)
    times, rows = content.tracks.opacities.shape
    size = path.stat().st_size
    console.say(
        f"paths of {rows:,} Gaussians at {times} times after {restored.step} steps, "
        f"{size / 1e6:.1f} MB: {path}"
    )
    return {"written": str(path), "num_gaussians": rows, "num_times": times, "bytes": size}


def _corrections(
    restored: Restored, written: str | list[str], found: RunArgument, console: Console
) -> dict[str, Any]:
    """Beside a file outside the run: what was learnt of the capture, which a run has already."""
    from gsfw.commands.corrections import write_corrections

    first = written if isinstance(written, str) else written[0]
    folder = Path(first).absolute().parent
    if found.model_file is not None or folder.is_relative_to(found.folder.path.absolute()):
        return {}
    paths = write_corrections(restored.composition.parts, folder)
    for path in paths:
        console.say(f"learnt of the capture: {path}")
    return {"corrections": [str(path) for path in paths]} if paths else {}


def _place(options: ExportOptions, folder: Path, name: str, suffix: str) -> Path:
    """The file to write."""
    out = Path(options.out) if options.out else folder
    return out / f"{name}{suffix}" if out.is_dir() else out


@contextmanager
def _what_it_holds(path: Path, form: str) -> Iterator[None]:
    """Tell the user what a format cannot hold.

    Raises:
        DataError: in place of the exporter's ValueError.
    """
    from gsfw.core.errors import DataError, UserError

    try:
        yield
    except UserError:
        raise
    except ValueError as error:
        raise DataError(f"{path}: format {form} cannot hold this model: {error}.") from error


def _take(restored: Restored, options: ExportOptions) -> Snapshot:
    """The model as it is at a time, without what is not asked for."""
    import torch

    from gsfw.commands.export_cut import cut
    from gsfw.plugins.snapshot import snapshot

    parts, settings = restored.composition.parts, restored.composition.plan.settings
    instant = torch.tensor(options.time, device=parts.device)
    edit = cut(restored, options.keep, options.sh_degree)
    return snapshot(parts.model, parts.data.scene, settings.antialias, instant, edit)


def _notes(taken: Snapshot) -> list[str]:
    """What the user should know of the file, in sentences."""
    left_out = [f"{taken.num_dropped} splats were left out: they are not finite."]
    return left_out * bool(taken.num_dropped) + _rounding_note(taken.content.splats)


def _rounding_note(splats: Splats) -> list[str]:
    """What float32 does to coordinates far from the origin of the world."""
    import numpy as np

    if not len(splats) or splats.scales is None:
        return []
    farthest = float(splats.means.abs().max())
    rounding = float(np.spacing(np.float32(farthest)))
    size = float(splats.scales.median())
    if rounding <= TOO_COARSE * size:
        return []
    return [
        f"coordinates reach {farthest:g}, where float32 numbers are {rounding:.2g} apart, and the "
        f"median splat is {size:.2g} in size: the file looks coarser than the model. Move the "
        "data set nearer to its origin."
    ]
