"""`gsfw view RUN|FILE`: a page in the browser that shows a trained model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from gsfw.commands.interface.arguments import Options, read, words

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.viewer.server import ViewerServer
    from gsfw.viewer.viewed_model import ViewedModel


@dataclass(kw_only=True)
class ViewOptions(Options):
    """Look at a trained model in the browser, or at two beside one another."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw view latest",
        "gsfw view runs/first runs/second",
        "gsfw view splats.ply port=8123",
        "gsfw train method=3dgs data=fox viewer=true",
    )

    runs: tuple[str, ...] = words("RUN|FILE ...")
    """One or two: a run folder, a checkpoint, latest, a model file (.gsfw), or a splat file (.ply)
    of any tool."""
    data: str = ""
    """Place of the data set. Empty: its place in training."""
    device: str = ""
    """Device: auto, cpu, cuda or cuda:N. Empty: that of the training; auto for a file."""
    port: int = 0
    """Port of the page; 0: the first free one from 8080."""
    browser: bool = False
    """Open the page in this machine's browser."""


def run(arguments: list[str]) -> int:
    """Open the models, and serve their page until Ctrl-C."""
    options = read("view", ViewOptions, arguments)
    _check(options)
    from gsfw.viewer.server import check_installed

    check_installed()
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.viewer.page import Pages
    from gsfw.viewer.server import ViewerServer
    from gsfw.viewer.session import Session, serve

    console = Console(options.json)
    models = tuple(_open(text, options, console) for text in options.runs)
    session = Session(models, _folder(options.runs[0]))
    server = ViewerServer(options.port)
    pages = Pages(session)
    try:
        server.start(session, pages)
        _announce(server, options, console)
        serve(session, lambda: False)
    except KeyboardInterrupt:
        console.say("closed")
    finally:
        pages.close()
        server.close()
        for model in models:
            if model.data is not None:
                model.data.close()
    return 0


def _check(options: ViewOptions) -> None:
    """Refuse what cannot be meant, before anything is loaded."""
    from gsfw.core.errors import ConfigError

    if len(options.runs) > 2:
        raise ConfigError(
            f"gsfw view: {len(options.runs)} models are given, and a page shows one or two.",
            "Give two to compare.",
        )
    if not 0 <= options.port <= 65535:
        raise ConfigError(f"port={options.port}: expected a number from 0 to 65535.")


def _folder(text: str) -> Path:
    """Folder of the files that pages order: the run, or that of the file."""
    from gsfw.commands.interface.runs import find_run

    path = Path(text)
    if path.is_file() and path.suffix != ".pt":
        return path.resolve().parent
    return find_run(text, lambda line: None).folder.path


def _open(text: str, options: ViewOptions, console: Console) -> ViewedModel:
    """Open a run, a model file or a splat file."""
    from gsfw.commands.interface.runs import MODEL_SUFFIX, find_run, open_run
    from gsfw.plugins.registry import installed
    from gsfw.viewer.opening import of_restored, of_splat_file

    path = Path(text)
    if path.is_file() and path.suffix not in (".pt", MODEL_SUFFIX):
        return of_splat_file(path, options.device, installed())
    found = find_run(text, console.say)
    given = {key: value for key in ("data", "device") if (value := getattr(options, key))}
    from gsfw.plugins.settings import COMMAND_LINE, Layer

    changed = Layer(COMMAND_LINE, given) if given else None
    return of_restored(found.name, open_run(found, installed(), changed))


def _announce(server: ViewerServer, options: ViewOptions, console: Console) -> None:
    """Print the address, and how to reach it from elsewhere."""
    console.say(f"the page is at {server.address}")
    console.say(f"from another machine, first: {server.ssh_line}")
    console.say("Ctrl-C ends it")
    console.result({"address": server.address, "port": server.port, "ssh": server.ssh_line})
    if options.browser:
        import webbrowser

        webbrowser.open(server.address)
