"""`gsfw edit FILE`: edits splats or a model, step by step, and writes another file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.interface.arguments import Options, parse, positional
from gsfw.commands.interface.format_options import read_with_format
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.editing.script import Step


@dataclass(kw_only=True)
class Crop:
    """Regions to keep."""

    box: str = ""
    """Keep centres inside a box, given by two corners: crop.box=-1,-1,-1,1,1,1"""
    sphere: str = ""
    """Keep centres inside a ball, x,y,z,radius: crop.sphere=0,0,0,1.5"""
    views: str = ""
    """Keep centres that lie within the images of this many cameras of the run: crop.views=3"""


@dataclass(kw_only=True)
class Cut:
    """Regions to leave out."""

    box: str = ""
    """Leave out centres inside a box: cut.box=-1,-1,-1,1,1,1"""
    sphere: str = ""
    """Leave out centres inside a ball: cut.sphere=0,0,0,0.2"""


@dataclass(kw_only=True)
class Prune:
    """Leave out Gaussians of little use."""

    opacity: str = ""
    """Leave out Gaussians with an opacity below this one, in [0, 1]: prune.opacity=0.02"""
    contribution: str = ""
    """Leave out this part of the Gaussians, those that add least to the views:
    prune.contribution=0.3"""
    floaters: str = ""
    """Leave out Gaussians whose distance to their neighbours (as a logarithm) is this many standard
    deviations above the median; 3 leaves out more than 5: prune.floaters=4"""
    views: str = ""
    """Leave out Gaussians that fewer of the run's training views see: prune.views=2"""


@dataclass(kw_only=True)
class Decimate:
    """Reduce the number of Gaussians."""

    count: str = ""
    """Reduce to at most this number of Gaussians: the least useful are left out, others are merged,
    and colours are refitted: decimate.count=50000"""
    mb: str = ""
    """The same, until the file has at most this size in MB (million bytes); give it as the last
    step: decimate.mb=5"""


@dataclass(kw_only=True)
class Color:
    """Change colours."""

    brightness: str = ""
    """Multiply colours: color.brightness=1.2"""
    contrast: str = ""
    """Multiply differences from middle grey: color.contrast=1.1"""
    saturation: str = ""
    """Multiply differences from grey; 0 is grey: color.saturation=0.8"""
    white: str = ""
    """White balance: this colour (red,green,blue in [0, 1]) becomes grey of the same brightness:
    color.white=0.9,0.85,0.7"""


@dataclass(kw_only=True)
class EditOptions(Options):
    """Edit splats or a model step by step, in the order of the command line, into a new file.

    Lengths and places are in the units of the world of the data, as it is after the steps before;
    angles are in degrees. A step may be given several times. The input is never changed.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw edit in.ply crop.box=-1,-1,-1,1,1,1 rotate=x,90 prune.opacity=0.02 out=small.ply",
        "gsfw edit runs/first align=cameras,z floor=0 true_size=0,0,0,0,0,1,2.5 out=room.ply",
        "gsfw edit runs/first clean=all prune.views=2 decimate.mb=5 out=first.ply",
        "gsfw edit runs/moving crop.sphere=0,0,0,2 over_time=all out=moving.gsfw",
        "gsfw edit in.ply scale=2 out=small.gsfw format.precision=compressed",
        "gsfw edit other.ply edits=small.ply.edits.json dry_run=true",
    )

    file: str = positional("FILE")
    """A file of splats, a run folder, a checkpoint, a model file (.gsfw), or latest."""
    out: str = ""
    """File to write; .gsfw for the model at all times. Empty: FILE.edited with the suffix of the
    format, beside the file; for a run, edited.ply in it, or edited.gsfw if the model moves."""
    format: str = ""
    """Format of the file: one of the exporters that gsfw plugins lists. Empty: by the suffix of
    out. Some formats have options, format.KEY=VALUE: format=NAME --help lists them."""
    move: str = ""
    """Move by x,y,z: move=0,0,1"""
    rotate: str = ""
    """Rotate about an axis through the origin, by degrees, right-handed: rotate=x,90, or
    rotate=1,1,0,45 for another axis."""
    scale: str = ""
    """Multiply all lengths, from the origin: scale=2"""
    true_size: str = ""
    """Scale so that two points of the world get a given distance, x,y,z,x,y,z,distance:
    true_size=0,0,0,0,0,1,2.5"""
    align: str = ""
    """Turn the scene upright: the upward direction, as cameras or the floor show it, becomes an
    axis: align=cameras,z or align=floor,-y"""
    floor: str = ""
    """Find the floor, and move it to this height along the upward axis: floor=0"""
    merge: str = ""
    """Add the splats of another file of the same world: merge=other.ply"""
    clean: str = ""
    """Leave out faulty Gaussians: clean=all, or some of not_finite, invisible, degenerate and
    needles, separated by commas: clean=invisible,needles"""
    sh_degree: str = ""
    """Leave out view dependence above this degree, 0 to 4: sh_degree=1"""
    crop: Crop = field(default_factory=Crop)
    cut: Cut = field(default_factory=Cut)
    prune: Prune = field(default_factory=Prune)
    decimate: Decimate = field(default_factory=Decimate)
    color: Color = field(default_factory=Color)
    edits: str = ""
    """Repeat the steps of an earlier edit, at this place in the order: edits=OUT.edits.json"""
    views: str = ""
    """A run whose cameras saw the splats of FILE, in the same world. Empty: the cameras of the run
    itself; for a file of splats, 24 invented ones around it."""
    time: float = number(0.0, at_least=0, at_most=1)
    """Time of a moving model or file, in [0, 1], if out holds splats at one time."""
    over_time: Literal["any", "all"] = "any"
    """For moving models: a region holds a Gaussian that is inside it at any time at which it can be
    seen, or at all of them."""
    step: int | None = None
    """Step of the run's checkpoint. none: the last."""
    data: str = ""
    """Place of the run's data set, if it was moved. Empty: that of the training; a model file needs
    none."""
    device: str = ""
    """Device: auto, cpu, cuda or cuda:N. Empty: that of the training; auto for a file."""
    dry_run: bool = False
    """Print the counts, and write nothing."""


def run(arguments: list[str]) -> int:
    """Apply the steps, print what each did, and write the file."""
    options, given = read_with_format("edit", EditOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.edit.session import Session
    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run
    from gsfw.commands.interface.splats_alone import or_splats_alone
    from gsfw.plugins.registry import installed

    console, registry = Console(options.json), installed()
    steps = _steps(arguments)
    _check(options, steps)
    found = find_run(options.file, console.say, splats=True, lead="FILE is")
    found = or_splats_alone(found, options.data, options.step, console.warn)
    console.result(Session(options, given, steps, found, registry, console).run())
    return 0


def _steps(arguments: list[str]) -> list[Step]:
    """The steps in their order.

    Raises:
        ConfigError: a value is wrong.
        DataError: a file of steps cannot be used.
    """
    from gsfw.editing.operations.catalogue import OPERATIONS
    from gsfw.editing.script import Step, read_steps

    steps: list[Step] = []
    for key, text in parse(arguments).pairs:
        if key in OPERATIONS:
            steps.append(Step.of(key, text))
        elif key == "edits" and text:
            steps += read_steps(Path(text))
    return steps


def _check(options: EditOptions, steps: list[Step]) -> None:
    """Check the options before anything is opened.

    Raises:
        ConfigError: there is nothing to do.
    """
    from gsfw.core.errors import ConfigError

    if not steps and not (options.out or options.format):
        raise ConfigError(
            f"gsfw edit {options.file}: there is nothing to do.",
            "Give steps, such as crop.sphere=0,0,0,1, or out=FILE to convert; all steps: "
            "gsfw edit --help",
        )
