"""The verbs of the command line, a file or a folder each."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_commands() -> list[Spec]:
    """The built-in verbs."""
    return [
        Spec("prepare", "make a data set from photos or videos", "gsfw.commands.prepare:run"),
        Spec(
            "partition",
            "cut a data set that is too large for one training into blocks",
            "gsfw.commands.partition:run",
        ),
        Spec(
            "blocks", "train the blocks of a partition, and merge them", "gsfw.commands.blocks:run"
        ),
        Spec("train", "train a method on a data set", "gsfw.commands.train:run"),
        Spec("resume", "continue a run that was stopped", "gsfw.commands.resume:run"),
        Spec("eval", "measure a run on its held-out views", "gsfw.commands.eval:run"),
        Spec("render", "render images and films of a run", "gsfw.commands.render:run"),
        Spec("report", "write an HTML report of one or more runs", "gsfw.commands.report:run"),
        Spec("view", "show a trained model in the browser", "gsfw.commands.view:run"),
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
        Spec("check", "check a data set before training", "gsfw.commands.check:run"),
        Spec("study", "train a table of runs, and compare them", "gsfw.commands.study:run"),
        Spec(
            "tradeoff",
            "measure what quality costs in size and time",
            "gsfw.commands.tradeoff.verb:run",
        ),
        Spec("stress", "test backends and methods with extreme cases", "gsfw.commands.stress:run"),
        Spec("bench", "measure rendering and training speed", "gsfw.commands.bench:run"),
        Spec("completion", "print a script for shell completion", "gsfw.commands.completion:run"),
        Spec("new", "write a plugin package to start from", "gsfw.commands.new:run"),
        Spec("plugins", "list installed parts and plugins, by slot", "gsfw.commands.plugins:run"),
        Spec("config", "show every setting, and where it came from", "gsfw.commands.config:run"),
        Spec("doctor", "check the installation of gsfw", "gsfw.commands.doctor:run"),
    ]
