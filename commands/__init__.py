"""The verbs of the command line, a file or a folder each."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_commands() -> list[Spec]:
    """The built-in verbs."""
    return [
        Spec("prepare", "make a data set of photos or video", "gsfw.commands.prepare:run"),
        Spec(
            "partition",
            "cut a data set that is too large for one training into blocks",
            "gsfw.commands.partition:run",
        ),
        Spec(
            "blocks", "train the blocks of a partition, and merge them", "gsfw.commands.blocks:run"
        ),
        Spec("train", "train a method on a data set", "gsfw.commands.train:run"),
        Spec("resume", "go on with a run that was stopped", "gsfw.commands.resume:run"),
        Spec("eval", "measure a run on its held-out views", "gsfw.commands.eval:run"),
        Spec("render", "render images of a run", "gsfw.commands.render:run"),
        Spec("report", "write one page of a run, or of several", "gsfw.commands.report:run"),
        Spec("view", "look at a trained model in the browser", "gsfw.commands.view:run"),
        Spec("open", "show the latest run in the browser", "gsfw.commands.open:run"),
        Spec("export", "write a run's splats to a file", "gsfw.commands.export:run"),
        Spec(
            "convert",
            "convert splats to another file format, and measure the loss",
            "gsfw.commands.convert:run",
        ),
        Spec("edit", "crop, move, prune, reduce or recolour splats", "gsfw.commands.edit.verb:run"),
        Spec("info", "describe a splat file, a run or a data set", "gsfw.commands.info:run"),
        Spec("runs", "list, compare and remove runs", "gsfw.commands.runs:run"),
        Spec("check", "say whether a data set will train well", "gsfw.commands.check:run"),
        Spec("study", "make a table of runs, and keep what is finished", "gsfw.commands.study:run"),
        Spec(
            "tradeoff",
            "measure what a finished model, or its training, can give up",
            "gsfw.commands.tradeoff.verb:run",
        ),
        Spec(
            "stress",
            "hold backends and methods to a catalogue of extremes",
            "gsfw.commands.stress:run",
        ),
        Spec("bench", "measure how fast drawing and training are here", "gsfw.commands.bench:run"),
        Spec("completion", "complete command lines in a shell", "gsfw.commands.completion:run"),
        Spec(
            "new", "write a package with a part of your own, to be changed", "gsfw.commands.new:run"
        ),
        Spec("plugins", "list what is installed, slot by slot", "gsfw.commands.plugins:run"),
        Spec("config", "show every setting, and where it came from", "gsfw.commands.config:run"),
        Spec("doctor", "check what works on this machine, and why not", "gsfw.commands.doctor:run"),
    ]
