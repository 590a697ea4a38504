"""`gsfw view RUN|FILE`: a page in the browser that shows a trained model."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gsfw.commands.interface.arguments import (
    DetailOptions,
    changed_place,
    positionals,
    read_options,
)
from gsfw.core.ranges import number

if TYPE_CHECKING:
    import socket

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.viewer.server import ViewerServer
    from gsfw.viewer.viewed_model import ViewedModel


@dataclass(kw_only=True)
class ViewOptions(DetailOptions):
    """Show a trained model in the browser, or two side by side."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw view latest",
        "gsfw view runs/first runs/second",
        "gsfw view splats.ply port=8123",
        "gsfw train method=3dgs data=fox viewer=true",
    )

    runs: tuple[str, ...] = positionals("RUN|FILE ...")
    """One or two: a run folder, a checkpoint, latest, a model file (.gsfw), or a splat file of any
    format (gsfw plugins slot=importer)."""
    data: str = ""
    """Place of the data set, if it was moved. Empty: that of the training."""
    device: str = ""
    """Device: auto, cpu, cuda or cuda:N. Empty: that of the training; auto for a file."""
    port: int = number(0, at_least=0, at_most=65535)
    """Port of the page; 0: the first free one from 8080."""
    browser: bool = False
    """Open the page in this machine's browser."""


def run(arguments: list[str]) -> int:
    """Open the models, and serve their page until Ctrl-C."""
    return show("view", read_options("view", ViewOptions, arguments))


def show(verb: str, options: ViewOptions) -> int:
    """Open the models, and serve their page until Ctrl-C.

    Args:
        verb: the verb that was given, for messages.
        options: its options.

    Raises:
        ConfigError: an option cannot be meant, a run is not found, or the viewer is not installed.
    """
    _check(verb, options)
    from gsfw.viewer.server import bound, check_installed

    check_installed()
    with bound(options.port) as listening:  # Before minutes of loading: the port may be taken.
        from gsfw.commands.interface.console import Console
        from gsfw.commands.interface.progress import load_torch

        load_torch()
        console = Console(options.json)
        found = [_find(text, options.data, console) for text in options.runs]
        with ExitStack() as opened:
            models = tuple(_open(run, options, console) for run in found)
            for model in models:
                opened.callback(model.data.close)
            _serve(listening, models, found[0], options, console)
    return 0


def _serve(
    listening: socket.socket,
    models: tuple[ViewedModel, ...],
    first: RunArgument,
    options: ViewOptions,
    console: Console,
) -> None:
    """Serve the page until Ctrl-C."""
    from gsfw.viewer.browser import browser_on
    from gsfw.viewer.page import Pages
    from gsfw.viewer.server import ViewerServer
    from gsfw.viewer.session import Session, serve

    session = Session(models, first.folder.path, str(first.checkpoint or first.name))
    with ExitStack() as running:
        server = ViewerServer(listening)
        running.callback(server.close)
        pages = Pages(session)
        running.callback(pages.close)
        running.callback(session.service.close)
        try:
            server.start(session, pages)
            _announce(server, console)
            if options.browser:
                running.enter_context(browser_on(server.address, first.folder.path))
            serve(session, lambda: False)
        except KeyboardInterrupt:
            console.say("closed")


def _check(verb: str, options: ViewOptions) -> None:
    """Refuse what cannot be meant, before anything is loaded."""
    options.drawn()
    from gsfw.core.errors import ConfigError

    if len(options.runs) > 2:
        raise ConfigError(
            f"gsfw {verb}: {len(options.runs)} models are given, and a page shows one or two.",
            "Give two to compare.",
        )


def _find(text: str, data: str, console: Console) -> RunArgument:
    """The run or file of an argument; of a run whose data set is gone its splats."""
    from gsfw.commands.interface.runs import find_run
    from gsfw.commands.interface.splats_alone import or_splats_alone

    found = find_run(text, console.say, splats=True)
    return or_splats_alone(found, data, None, console.warn)


def _open(found: RunArgument, options: ViewOptions, console: Console) -> ViewedModel:
    """Open a run, a model file or a splat file."""
    from gsfw.commands.interface.runs import restore_run, warn_of_file
    from gsfw.plugins.registry import installed
    from gsfw.viewer.viewed_model import ViewedModel

    changed = changed_place(options.data, options.device)
    restored = restore_run(found, installed(), changed, detail=options.drawn())
    composition = restored.composition
    warn_of_file(found, composition, console)
    is_run = found.model_file is None and found.splat_file is None
    subject = f"{composition.settings.method.name} on {composition.scene.name}" if is_run else ""
    return ViewedModel.of(found.name, restored, found.splat_file is None, subject)


def _announce(server: ViewerServer, console: Console) -> None:
    """Print the address, and how to reach it from elsewhere."""
    console.say(f"the page is at {server.address}")
    console.say(f"from another machine, first: {server.ssh_line}")
    console.say("Ctrl-C ends it")
    console.result({"address": server.address, "port": server.port, "ssh": server.ssh_line})
