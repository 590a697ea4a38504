"""`gsfw export RUN`: a run's splats as a file that other tools open, in the world of the data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from gsfw.commands.arguments import read
from gsfw.commands.run_options import RunOptions

if TYPE_CHECKING:
    from gsfw.commands.run_argument import RunArgument
    from gsfw.core.splats import Splats
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.snapshot import Snapshot

TOO_COARSE = 0.1
"""Rounding of positions, relative to the median splat, above which a note says so."""


@dataclass(kw_only=True)
class ExportOptions(RunOptions):
    """Write a run's splats to a file, in the world of the data."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw export latest",
        "gsfw export runs/first format=ply step=5000 out=first.ply",
    )

    format: str = "ply"
    """Format of the file; gsfw plugins lists the exporters."""
    out: str = ""
    """File to write, or a folder for it. Empty: splats.ply in the run."""
    step: int | None = None
    """Which checkpoint, by its step. none: the last."""
    time: float = 0.0
    """When a model that moves is written, in [0, 1]; a static one ignores it."""


def run(arguments: list[str]) -> int:
    """Write the file, and say what is in it."""
    options = read("export", ExportOptions, arguments)

    from gsfw.commands.console import Console
    from gsfw.commands.run_argument import find_run
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import installed
    from gsfw.plugins.restore import restore

    if not 0 <= options.time <= 1:
        raise ConfigError(f"time={options.time:g}: expected a time in [0, 1].")
    registry = installed()
    registry.find("exporter", options.format)
    console, found = Console(options.json), find_run(options.run)
    restored = restore(found.folder, registry, _checkpoint(found, options.step), options.changed())
    last = found.checkpoint is None and options.step is None
    name = "splats" if last else f"splats_{restored.step:09d}"
    taken = _take(restored, options.time)
    path = _write(taken, options, found.folder.path, name)
    splats, notes = taken.content.splats, _notes(taken)
    for note in notes:
        console.warn(note)
    size = path.stat().st_size
    console.say(f"{len(splats):,} splats after {restored.step} steps, {size / 1e6:.1f} MB: {path}")
    console.result(
        {
            "run": str(found.folder.path),
            "step": restored.step,
            "format": options.format,
            "written": str(path),
            "num_gaussians": len(splats),
            "num_dropped": taken.num_dropped,
            "bytes": size,
            "notes": notes,
        }
    )
    return 0


def _checkpoint(found: RunArgument, step: int | None) -> Path | None:
    """The checkpoint that was asked for; ``None`` for the last.

    Raises:
        DataError: there is none after so many steps; lists those there are.
    """
    from gsfw.core.errors import DataError

    if step is None:
        return found.checkpoint
    path = found.folder.checkpoint(step)
    if not path.is_file():
        steps = sorted(int(p.stem.split("_")[1]) for p in path.parent.glob("step_*.pt"))
        raise DataError(
            f"{found.folder.path} has no checkpoint after {step} steps.",
            f"There are checkpoints after {', '.join(map(str, steps)) or 'no'} steps.",
        )
    return path


def _take(restored: Restored, time: float) -> Snapshot:
    """The model as it is at ``time``."""
    import torch

    from gsfw.plugins.snapshot import snapshot

    parts, settings = restored.composition.parts, restored.composition.plan.settings
    instant = torch.tensor(time, device=parts.device)
    return snapshot(parts.model, parts.data.scene, settings.antialias, instant)


def _write(taken: Snapshot, options: ExportOptions, folder: Path, name: str) -> Path:
    """Write the file; where it is.

    Raises:
        OutputError: it cannot be written.
        DataError: the format cannot hold these splats.
    """
    from gsfw.core.errors import DataError
    from gsfw.plugins.automatic import load
    from gsfw.plugins.registry import installed

    exporter = load("exporter", installed().find("exporter", options.format))()
    out = Path(options.out) if options.out else folder
    path = out / f"{name}{exporter.suffix}" if out.is_dir() else out
    try:
        exporter.write(path, taken.content)
    except ValueError as error:
        raise DataError(
            f"{path}: format {options.format} cannot hold this model: {error}."
        ) from error
    return path


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
