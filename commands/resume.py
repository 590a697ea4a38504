"""The verb ``resume``: continues a run from its checkpoint, with the bits of an unstopped run."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gsfw.commands.interface.arguments import FLAGS, Arguments, HelpRequested, full_key, parse
from gsfw.commands.interface.caller import Caller
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.page import paragraphs
from gsfw.commands.interface.team import (
    check_started,
    console_of,
    joined,
    run_workers,
    starts_workers,
    together,
    with_processes,
)
from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.atomic import other_place
from gsfw.core.progress import stage
from gsfw.core.words import shell_argument
from gsfw.plugins.registry import did_you_mean, installed

if TYPE_CHECKING:
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.core.loop.timekeeper import Timekeeper
    from gsfw.core.loop.trainer import Trainer
    from gsfw.core.team import Team
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.settings import Settings

CHANGEABLE = (
    "steps",
    "data",
    "device",
    "processes",
    "rasterizer",
    "checkpoint_every",
    "eval_every",
    "eval_views",
    "log_every",
    "cache_mb",
    "gpu_cache_mb",
    "check_memory",
    "graph",
    "validation",
    "max_skipped",
    "report",
    "callbacks",
)
"""Settings, and groups of settings, that may change on resuming; the others are fixed."""

COPY = "a copy of the run in a folder that you may write to"
"""Remedy where the run cannot be written to: it goes on in its own folder."""

HELP = f"""usage: gsfw resume RUN [key=value ...]

Continue a stopped run from its last checkpoint, or from the one that RUN names. On the CPU the
result has the same bits as that of an uninterrupted run.

RUN is the folder that gsfw train made, a checkpoint in it, or latest.

Keys that may change: {", ".join(CHANGEABLE)}.

examples:
  gsfw resume latest
  gsfw resume runs/first steps=40000"""


def run(tokens: list[str]) -> int:
    """Continue a run; it is held from the reading of its checkpoint on."""
    began = time.perf_counter()
    arguments = with_processes(parse(tokens))
    if arguments.flag("help"):
        raise HelpRequested(paragraphs(HELP))
    changed = _changed(arguments)
    console = console_of(arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.runs import find_run
    from gsfw.commands.interface.training import run_training

    found = find_run(arguments.words[0], console.say)
    command = ["resume", *tokens]
    processes, *_ = _asked(found, changed)
    if starts_workers(processes):
        return run_workers(command, processes)
    return resume_run(found, changed, command, Caller(console, run_training), began)


def resume_run(
    found: RunArgument,
    changed: Mapping[str, Any],
    command: Sequence[str],
    caller: Caller,
    began: float,
) -> int:
    """Continue a run, and hold its folder meanwhile; return the exit code.

    Args:
        found: the run, or a checkpoint of it.
        changed: settings that change; checked by ``check_changeable``.
        command: the command line.
        caller: program that trains.
        began: start of the command, as of ``time.perf_counter``.

    Raises:
        ConfigError: it is no run, or a setting is wrong.
        DataError: it cannot be restored.
        OutputError: its folder cannot be written to.
    """
    if found.model_file is not None:
        raise ConfigError(
            f"{found.name} cannot be resumed: a model file has no optimizer and no images.",
            "Give the folder of the run that it was exported from.",
        )
    processes, shards, device = _asked(found, changed)
    check_started(processes)
    with other_place(COPY), joined(processes, shards, device) as team:
        return resume_together(found, changed, command, caller, began, team)


def resume_together(
    found: RunArgument,
    changed: Mapping[str, Any],
    command: Sequence[str],
    caller: Caller,
    began: float,
    team: Team,
) -> int:
    """Continue a run with a team of processes, as ``resume_run`` does."""
    from gsfw.commands.interface.new_run import OTHERS
    from gsfw.commands.interface.run_history import remember_run
    from gsfw.commands.interface.training import describe, follow
    from gsfw.core.files.folder_lock import only_one
    from gsfw.planning.record import read_plan, recorded

    console = caller.console
    with ExitStack() as stack:
        if team.leads:
            stack.enter_context(only_one(found.folder.path, OTHERS, "Wait for it, or end it."))
        with stage(f"opening {found.name}"):
            restored = together(team, lambda: _opened(found, changed, team))
        if _is_finished(restored, console):
            return 0
        for change in restored.changes():
            console.warn(
                f"{change}: the result may differ in its last bits from an unstopped run's."
            )
        trainer, keeper = _trainer(restored, changed, caller, began, team)
        if not team.leads:
            return follow(trainer)
        composition, folder = restored.composition, restored.folder
        if changed:
            _write_settings(composition.settings, trainer, command)
        remember_run(folder.path)
        console.say(f"{describe(composition)}\ncontinuing after step {restored.step}")
        if keeper is not None:
            plan = read_plan(folder)
            stack.enter_context(recorded(trainer, composition.settings, command, plan))
        return caller.run(trainer, console)


def _trainer(
    restored: Restored, changed: Mapping[str, Any], caller: Caller, began: float, team: Team
) -> tuple[Trainer, Timekeeper | None]:
    """The trainer of a restored run, and what keeps it in its time, if it has one."""
    from gsfw.core.loop.checkpoint_file import fitting_state
    from gsfw.core.loop.machine_clock import MachineClock
    from gsfw.planning.plan import resumed_timekeeper
    from gsfw.plugins.loading import check_callbacks

    settings = restored.composition.settings
    keeper, callbacks = None, []
    if team.leads:
        check_callbacks(settings.config.callbacks, installed())
        callbacks = caller.callbacks_of(settings, installed())
        if "steps" not in changed:
            keeper = resumed_timekeeper(restored, MachineClock(began))
    trainer = restored.composition.trainer(restored.folder, callbacks, restored.step, keeper)
    with fitting_state(str(restored.folder.path)):
        trainer.load_state_dict(restored.state)
    if "steps" in changed:
        trainer.walk.unhurried()
    return trainer, keeper


def _opened(found: RunArgument, changed: Mapping[str, Any], team: Team) -> Restored:
    """The run with its checkpoint, for a team of processes."""
    from gsfw.core.loop.checkpoint_file import MODEL_ALONE
    from gsfw.plugins.restore import restore
    from gsfw.plugins.settings import COMMAND_LINE, Layer

    layer = Layer(COMMAND_LINE, changed)
    restored = restore(found.folder, installed(), found.checkpoint, layer)
    if MODEL_ALONE in restored.state:
        raise DataError(
            f"{found.checkpoint} has the model alone: no checkpoint could hold the state of its "
            "run, and training cannot continue from it.",
            f"Continue from the latest checkpoint: gsfw resume {shell_argument(found.folder.path)}",
        )
    return replace(restored, composition=restored.composition.shared_by(team))


def _write_settings(settings: Settings, trainer: Trainer, command: Sequence[str]) -> None:
    """Write the changed settings of a run into its folder."""
    from gsfw.core.files.atomic import write_atomically
    from gsfw.plugins.config_file import write_config

    settings = replace(settings, config=replace(settings.config, pace=trainer.walk.pace.texts))
    write_atomically(trainer.folder.config, write_config(settings, command).encode())


def _asked(found: RunArgument, changed: Mapping[str, Any]) -> tuple[int, int, str]:
    """Processes, shards and device of the continued run; checked with the other settings."""
    from gsfw.plugins.config_file import read_config

    recorded: Mapping[str, Any] = {}
    if found.folder.config.is_file():
        recorded = read_config(found.folder.config, everything=True).values
    settings = {"processes": 0, "shards": 0, "device": AUTO, **recorded, **changed}
    processes, shards = (
        int(text) if text.isdigit() else 0
        for text in (str(settings["processes"]), str(settings["shards"]))
    )
    return processes, shards, str(settings["device"])


def _changed(arguments: Arguments) -> Mapping[str, str]:
    """The given settings.

    Raises:
        ConfigError: RUN is missing, or a setting cannot change.
    """
    if len(arguments.words) != 1:
        problem = "RUN is missing" if not arguments.words else "more than one RUN is given"
        raise ConfigError(f"gsfw resume: {problem}.", "See gsfw resume --help.")
    changed = {full_key(key): text for key, text in arguments.values.items() if key not in FLAGS}
    check_changeable(changed)
    return changed


def check_changeable(changed: Iterable[str]) -> None:
    """Check that settings may change on resuming.

    Raises:
        ConfigError: one may not; names those that may.
    """
    for key in changed:
        if key.partition(".")[0] not in CHANGEABLE:
            raise ConfigError(
                f"{key} cannot change when a run is resumed.{did_you_mean(key, CHANGEABLE)}",
                f"Keys that may: {', '.join(CHANGEABLE)}.",
            )


def _is_finished(restored: Restored, console: Console) -> bool:
    """True if no step is left; prints that."""
    steps, done = restored.composition.plan.steps, restored.step
    if done > steps:
        raise ConfigError(
            f"steps={steps}: the run has done {done} steps already.",
            "Give a larger number, or an earlier checkpoint.",
        )
    if done < steps or not restored.folder.is_finished:
        return False
    run = restored.folder.path
    console.say(
        f"{run} is finished: it has done all of its {steps} steps. "
        f"To train longer: gsfw resume {shell_argument(run)} steps=N"
    )
    console.result({"run": str(run), "completed": True, "steps": done})
    return True
