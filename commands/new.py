"""`gsfw new KIND NAME`: writes a package that brings a part, and works as it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from gsfw.commands.interface.arguments import Options, positional, read_options
from gsfw.commands.interface.console import Console
from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import did_you_mean, installed
from gsfw.scaffold.kinds import BASES, KINDS
from gsfw.scaffold.names import check_name
from gsfw.scaffold.package import kind_with_name, package_files, write_package

if TYPE_CHECKING:
    from gsfw.scaffold.names import PartName


@dataclass(kw_only=True)
class NewOptions(Options):
    """Write a Python package with a method, or another part, of your own.

    You can install, use and test it at once, and then change it. Without KIND, the kinds of parts
    are listed.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw new",
        "gsfw new method my-method",
        "gsfw new method my-method like=3dgs",
        "gsfw new method my-motion like=moving",
        "gsfw new rasterizer my-rasterizer out=work/my-rasterizer",
    )

    kind: str = positional("KIND", default="")
    """Kind of the part: method, strategy, rasterizer, datamanager, ..."""
    name: str = positional("NAME", default="")
    """Name of the part and of the package: small letters, digits and dashes."""
    like: str = ""
    """Method that the new one derives from, such as 3dgs; moving: one for moving scenes, with a
    motion of its own. Empty: one with a model of its own."""
    out: str = ""
    """Folder of the package. Empty: NAME, here."""


def run(arguments: list[str]) -> int:
    """Write the package, and print what to do with it."""
    options = read_options("new", NewOptions, arguments)
    console = Console(options.json)
    if not options.kind:
        return _list_kinds(console)
    _check(options)
    name = check_name(options.name, options.kind, installed())
    files = package_files(options.kind, name, options.like)
    folder = Path(options.out or name.dashed)
    write_package(folder, files)
    _tell(console, options, name, folder, files)
    return 0


def _list_kinds(console: Console) -> int:
    rows = [(name, kind.summary) for name, kind in KINDS.items()]
    console.table(["kind", "the part that is written, to be changed"], rows)
    console.say("")
    console.say(f"gsfw new KIND NAME writes a package. Methods for like=: {', '.join(BASES)}.")
    console.result({"kinds": dict(rows), "like": list(BASES)})
    return 0


def _check(options: NewOptions) -> None:
    """Check the options.

    Raises:
        ConfigError: there is no such kind, no name, or no such method to derive from.
    """
    kind, like = options.kind, options.like
    if kind not in KINDS:
        raise ConfigError(
            f"gsfw new: there is no kind {kind!r}.{did_you_mean(kind, KINDS)}",
            f"Kinds: {', '.join(KINDS)}.",
        )
    if not options.name:
        raise ConfigError(
            "gsfw new: NAME is missing.", f"Write, for instance, gsfw new {kind} my-{kind}."
        )
    if like and kind != "method":
        raise ConfigError(f"like={like}: only a method can derive from another.", "Leave it out.")
    if like and like not in BASES:
        raise ConfigError(
            f"like={like}: no method can derive from it.{did_you_mean(like, BASES)}",
            f"Methods that one can derive from: {', '.join(BASES)}.",
        )


def _tell(
    console: Console, options: NewOptions, name: PartName, folder: Path, files: dict[str, str]
) -> None:
    """Print the place of the code, and the commands to go on with."""
    kind = kind_with_name(KINDS[options.kind], name)
    place = folder if folder.is_absolute() else f"./{folder.as_posix()}"
    edit = folder / name.module / f"{kind.module}.py"
    lines = sum(len(text.splitlines()) for text in files.values())
    commands = [f"pip install -e {place}", kind.command, f"pytest {folder}"]
    console.say(f"wrote {folder}: {lines} lines in {len(files)} files")
    console.say(f"edit  {edit}")
    console.say("")
    for command in commands:
        console.say(f"  {command}")
    console.result(
        {
            "folder": str(folder),
            "files": sorted(files),
            "lines": lines,
            "edit": str(edit),
            "commands": commands,
        }
    )
