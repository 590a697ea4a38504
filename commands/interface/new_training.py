"""New training: a run is checked, planned and composed, then trained in a folder of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gsfw.commands.interface.caller import Caller
from gsfw.commands.interface.new_run import check_free, default_folder, new_run_folder
from gsfw.commands.interface.run_history import remember_run
from gsfw.commands.interface.team import tell_launcher
from gsfw.commands.interface.training import describe, follow
from gsfw.core.files.atomic import write_atomically
from gsfw.core.loop.machine_clock import MachineClock
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.team import ALONE, Team
from gsfw.planning.announcement import announcement
from gsfw.planning.asked import asked_of
from gsfw.planning.costs import memory_note
from gsfw.planning.plan import Plan, make_plan
from gsfw.planning.record import plan_document, recorded
from gsfw.plugins.compose import Composition, check, compose
from gsfw.plugins.config_file import write_config
from gsfw.plugins.loading import check_callbacks
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Layer, Settings


@dataclass(frozen=True)
class NewTraining:
    """A run that can begin; nothing is written yet."""

    composition: Composition
    plan: Plan | None
    """The plan of a run that has to end in a time, or at a quality; ``None`` for other runs."""
    path: Path
    """Path of its folder; where the user chose none, it may get a number."""
    command: tuple[str, ...]
    """The command line, or the one that does the same."""

    def __str__(self) -> str:
        """The lines that the user sees before the first step."""
        described = describe(self.composition)
        return described if self.plan is None else f"{described}\n{announcement(self.plan)}"

    def train(
        self, caller: Caller, registry: Registry, team: Team = ALONE
    ) -> tuple[int, RunFolder]:
        """Train it with a team of processes; the exit code, and the folder.

        Raises:
            OutputError: the folder cannot be created, or another run has it.
            TrainingError: the GPU's memory is full, or steps are no longer finite.
        """
        settings = self.composition.settings
        if not team.leads:
            path = team.gathered(self.path)[0]
            return follow(self.composition.trainer(RunFolder(path))), RunFolder(path)
        with new_run_folder(self.path, is_chosen=bool(settings.config.out)) as new:
            tell_launcher(new.folder.path)
            write_atomically(new.folder.config, write_config(settings, self.command).encode())
            remember_run(new.folder.path)
            callbacks = caller.callbacks_of(settings, registry)
            keeper = None if self.plan is None else self.plan.timekeeper
            trainer = self.composition.trainer(new.folder, callbacks, timekeeper=keeper)
            team.gathered(new.folder.path)
            new.steps_done = lambda: trainer.step
            if self.plan is None:
                return caller.run(trainer, caller.console), new.folder
            with recorded(trainer, settings, self.command, plan_document(self.plan)):
                return caller.run(trainer, caller.console), new.folder


def new_training(
    settings: Settings,
    layers: Sequence[Layer],
    registry: Registry,
    command: Sequence[str],
    began: float,
    team: Team = ALONE,
) -> NewTraining:
    """Check, plan and compose a run.

    Args:
        settings: of the run.
        layers: values that the user gave, from which they were resolved.
        registry: the installed parts.
        command: the command line.
        began: start of the command, as of ``time.perf_counter``.
        team: processes that train.

    Raises:
        ConfigError: the parts do not fit together, or the time is too short.
        DataError: the data set cannot be used.
        OutputError: the folder is in use, or cannot be written to.
    """
    check(settings, registry)
    check_callbacks(settings.config.callbacks, registry)
    out = settings.config.out
    if team.leads:
        check_free(out)
    asked, plan = asked_of(settings, layers), None
    if asked is not None:
        plan = make_plan(asked, layers, registry, MachineClock(began))
    composition = compose(settings, registry) if plan is None else plan.composition
    remarks = (*composition.remarks, *memory_note(composition))
    composition = replace(composition, remarks=remarks).shared_by(team)
    method = composition.settings.method.name
    path = Path(out) if out else default_folder(composition.scene.name, method)
    return NewTraining(composition, plan, path, tuple(command))
