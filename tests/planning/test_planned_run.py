"""A planned run from the command line, on a machine whose clock is made up: no test waits."""

import json
from pathlib import Path

import pytest
import torch
import yaml
from support.small_scene import SMALL_SCENE
from support.states import assert_same_bits

from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.machine_clock import MachineClock, Work
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.timekeeper import Ending
from gsfw.core.loop.walk import Walk
from gsfw.core.stereo.surface import SurfacePoints
from gsfw.planning import trial
from gsfw.planning.measurement import Measurement
from gsfw.plugins import start
from gsfw.plugins.compose import Composition

# Whole trainings; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SMALL = ("device=cpu", *SMALL_SCENE, "report=false")
RUN = ("train", "method=3dgs", *SMALL)
ENDING = Ending(updates=5.0, seconds=1.0)
"""Less is reserved than for real runs, so that few steps are enough for a test."""


class Machine:
    """A machine on which only updates, and what a test adds, take time."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.update_seconds = 0.4
        self.slow_from: float | None = None
        self.tried: list[Composition] = []
        """Runs whose steps were measured, in order."""
        self.bounds: list[float] = []
        """Seconds after which each of these measurements was to end with its next step."""

    def update(self) -> None:
        """Pass the time of an update; twice as long once the machine is busy."""
        slow = self.slow_from is not None and self.seconds >= self.slow_from
        self.seconds += self.update_seconds * (2 if slow else 1)


@pytest.fixture
def machine(monkeypatch) -> Machine:
    made = Machine()

    def advance(self, steps_left):
        made.update()
        return usual(self, steps_left)

    usual = Walk.advance
    monkeypatch.setattr(Walk, "advance", advance)
    monkeypatch.setattr(MachineClock, "seconds", lambda self: made.seconds)
    monkeypatch.setattr(MachineClock, "work", lambda self: Work(made.seconds))
    for module in ("plan", "speed"):
        monkeypatch.setattr(f"gsfw.planning.{module}.ENDING", ENDING)
    usual_trial = trial.try_steps

    def measured(composition, seconds, most):
        made.tried.append(composition)
        made.bounds.append(most)
        before = made.seconds
        found = usual_trial(composition, 0.0)
        made.seconds = before + 1.0
        return replaced(found, step=made.update_seconds, view=0.05)

    monkeypatch.setattr("gsfw.planning.measurement.try_steps", measured)
    monkeypatch.setattr("gsfw.planning.measurement.seconds_to_load", lambda composition: 0.01)
    return made


def replaced(found: trial.Trial, **values) -> trial.Trial:
    return trial.Trial(**{**vars(found), **values})


def planned(folder: Path) -> dict:
    return json.loads(RunFolder(folder).plan.read_text())


def last_state(folder: Path) -> dict:
    """The last checkpoint, without what the clock says."""
    state = read_checkpoint(RunFolder(folder).latest_checkpoint())
    del state["train_seconds"]
    state["walk"] = {**state["walk"], "spent": 0.0, "view_seconds": 0.0, "goal": None}
    return state


def test_a_run_ends_in_its_time_and_repeats_from_its_file(machine, tmp_path, capsys):
    machine.slow_from = 30.0
    first, second = tmp_path / "first", tmp_path / "second"
    assert main([*RUN, "minutes=1", f"out={first}"]) == 0
    said = capsys.readouterr().out
    assert "ends in 1 min 0 s: about" in said
    assert "of memory and" in said
    record = planned(first)
    # What follows the last step is reserved, and takes no time on this machine.
    reserved = ENDING.updates * 2 * machine.update_seconds + ENDING.seconds
    assert record["seconds"] + reserved == pytest.approx(60.0, rel=0.1)
    assert record["pace"], "the machine got busy"

    config = yaml.safe_load((first / "config.yaml").read_text())
    assert config["pace"] == record["pace"]
    assert config["minutes"] == 1.0
    assert "minutes" not in config["given"]
    assert {"steps", "pace"} <= set(config["given"])
    assert set(config["planned"]) == {*record["decided"], "pace"}
    machine.slow_from, machine.update_seconds = None, 0.01
    assert main(["train", f"config={first / 'config.yaml'}", f"out={second}"]) == 0
    assert not RunFolder(second).plan.exists()
    assert_same_bits(last_state(first), last_state(second))


@pytest.mark.slow
def test_a_killed_run_goes_on_with_its_decisions_and_the_time_that_is_left(machine, tmp_path):
    cut, again = tmp_path / "cut", tmp_path / "again"
    machine.slow_from = 20.0
    with pytest.MonkeyPatch.context() as patch:
        usual = Walk.advance

        def killed(self, steps_left):
            if machine.seconds > 40:
                raise RuntimeError("the power is gone")
            return usual(self, steps_left)

        patch.setattr(Walk, "advance", killed)
        assert main([*RUN, "minutes=1.5", "checkpoint_every=10", f"out={cut}"]) == 1
    before = read_checkpoint(RunFolder(cut).latest_checkpoint())["walk"]
    assert before["pace"]
    machine.seconds = 0.0  # Another process, with a clock of its own.
    assert main(["resume", str(cut)]) == 0
    record = planned(cut)
    assert record["pace"][: len(before["pace"])] == before["pace"]
    assert before["spent"] < record["seconds"] <= 1.1 * 90
    assert main(["train", f"config={cut / 'config.yaml'}", f"out={again}"]) == 0
    assert_same_bits(last_state(cut), last_state(again))


@pytest.mark.slow
def test_a_planned_run_goes_on_for_more_steps_at_the_usual_pace(machine, tmp_path, capsys):
    assert main([*RUN, "minutes=1", f"out={tmp_path}"]) == 0
    before = planned(tmp_path)
    updates, steps = before["updates"], before["steps"]
    assert updates != steps
    assert main(["resume", str(tmp_path), f"steps={steps + 20}"]) == 0
    walk = read_checkpoint(RunFolder(tmp_path).latest_checkpoint())["walk"]
    assert walk["updates"] == pytest.approx(updates + 20, abs=2)
    config = yaml.safe_load((tmp_path / "config.yaml").read_text())
    assert (config["minutes"], config["steps"]) == (0.0, steps + 20)
    assert config["pace"] == walk["pace"]
    capsys.readouterr()
    assert main(["resume", str(tmp_path), f"steps={steps + 30}"]) == 0
    assert main(["train", f"config={tmp_path / 'config.yaml'}", "--dry-run"]) == 0


@pytest.mark.slow
def test_a_plan_looks_for_a_surface_once_and_measures_the_start_that_it_chose(
    machine, tmp_path, monkeypatch
):
    looked = []

    def made(*given):
        looked.append(given)
        places = torch.rand(40, 3, generator=torch.Generator().manual_seed(2)) - 0.5
        return SurfacePoints(places, places + 0.5, torch.ones(40), confirmed=1.0)

    monkeypatch.setattr(start, "dense_surface", made)
    assert main([*RUN, "init=dense", "minutes=1", f"out={tmp_path}"]) == 0
    assert len(looked) == 1
    rows = [run.parts.model.num_rows for run in machine.tried]
    assert rows == [40, 40], "not the points of the data"


@pytest.mark.slow
def test_a_plan_measures_the_image_size_that_it_chose(machine, tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.planning.choices.SHORTEST_SIDE", 8)
    assert main([*RUN, "minutes=1", f"out={tmp_path}"]) == 0
    record = planned(tmp_path)
    assert record["decided"]["downscale"] == 3
    widths = [run.parts.data.views(Split.TRAIN).cameras[0].width for run in machine.tried]
    assert widths == [32, 11]
    assert record["measured"]["downscale"] == 3


@pytest.mark.slow
def test_a_quality_ends_a_run_and_the_last_part_has_all_views(machine, tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.core.loop.goal.EVERY", 10)
    first, second = tmp_path / "first", tmp_path / "second"
    scene = ("datamanager.views=8", "until=5")
    assert main([*RUN, *scene, f"out={first}"]) == 0
    record = planned(first)
    assert record["reached"] == 10
    assert record["decided"]["held_back"] == 2
    assert record["pace"][0].startswith("10:")
    assert record["pace"][0].endswith(":all-views")
    assert record["updates"] == 10 + 50
    assert main(["train", f"config={first / 'config.yaml'}", f"out={second}"]) == 0
    assert_same_bits(last_state(first), last_state(second))


@pytest.mark.slow
def test_a_quality_that_is_never_reached_ends_in_the_bound(machine, tmp_path):
    assert main([*RUN, "until=90", "minutes=1", "datamanager.views=8", f"out={tmp_path}"]) == 0
    record = planned(tmp_path)
    assert record["reached"] is None
    assert record["seconds"] <= 66


def test_a_time_that_loading_takes_is_refused_with_one_that_is_enough(machine, tmp_path, capsys):
    assert main([*RUN, "minutes=0.05", f"out={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "minutes=0.05: that is 3 s, and loading, measuring and the work after" in said
    assert "Give minutes=" in said
    assert not (tmp_path / "run").exists()


def test_a_time_that_has_passed_is_refused_before_any_step(machine, tmp_path, capsys):
    machine.seconds = 6.0
    assert main([*RUN, "minutes=0.05", f"out={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "minutes=0.05: that is 3 s, and reading the data and building the model have" in said
    assert "have taken 6 s on this machine.\nGive minutes=0.4 or more." in said
    assert not machine.tried


@pytest.mark.slow
def test_a_time_that_passes_before_the_second_look_is_refused_with_one_that_is_enough(
    machine, tmp_path, monkeypatch, capsys
):
    usual = Measurement.composed

    def composed(self, settings):
        machine.seconds += 59.5 if machine.tried else 0.0
        return usual(self, settings)

    monkeypatch.setattr(Measurement, "composed", composed)
    assert main([*RUN, "minutes=1", f"out={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "minutes=1: that is 60 s, and reading the data and building the model have" in said
    assert said.endswith("have taken 60 s on this machine.\nGive minutes=4.1 or more.\n")
    assert len(machine.tried) == 1


@pytest.mark.slow
def test_the_first_look_at_large_images_is_one_at_small_ones(
    machine, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("gsfw.planning.measurement.TRIAL_PIXELS", 300)
    machine.update_seconds = 5.0
    assert main([*RUN, "downscale=1", "minutes=1", f"out={tmp_path / 'run'}"]) == 2
    assert "or smaller images: leave out downscale" in capsys.readouterr().err
    widths = [run.parts.data.views(Split.TRAIN).cameras[0].width for run in machine.tried]
    assert widths == [16]
    assert machine.bounds == [15.0]


def test_too_few_views_to_hold_back_are_refused(machine, tmp_path, capsys):
    few = ("until=30", "datamanager.views=3")
    assert main([*RUN, *few, f"out={tmp_path / 'run'}"]) == 2
    assert "3 are too few: expected at least 4" in capsys.readouterr().err
    assert not machine.tried, "before anything is measured"


def test_parts_that_do_not_fit_the_steps_of_the_second_look_say_what_the_time_leaves(
    machine, tmp_path, capsys, monkeypatch
):
    usual = Measurement.composed

    def composed(self, settings):
        if machine.tried:
            raise ConfigError("refine_start has to be below refine_stop.", "Give another one.")
        return usual(self, settings)

    monkeypatch.setattr(Measurement, "composed", composed)
    assert main([*RUN, "minutes=1", f"out={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "minutes=1 leaves" in said
    assert "Give more minutes" in said


def test_views_that_are_alone_at_their_time_cannot_judge_a_run(machine, tmp_path, capsys):
    moving = ("datamanager.moving=true", "datamanager.views=12", "datamanager.times=12")
    assert main(["train", *SMALL, "method=spacetime", *moving, "until=20", f"out={tmp_path}"]) == 2
    said = capsys.readouterr().err
    assert "until=20: no training view can be held back" in said
    assert not machine.tried, "before anything is measured"
    assert "minutes=5" in said


@pytest.mark.slow
def test_a_dry_run_says_the_plan_and_leaves_nothing(machine, tmp_path, capsys):
    assert main([*RUN, "minutes=2", "--dry-run", f"out={tmp_path / 'run'}"]) in (0, 1)
    assert "ends in 2 min 0 s: about" in capsys.readouterr().out
    assert not (tmp_path / "run").exists()


def test_a_time_cannot_change_when_a_run_goes_on(machine, tmp_path, capsys):
    assert main([*RUN, "steps=4", f"out={tmp_path}"]) == 0
    assert main(["resume", str(tmp_path), "minutes=3"]) == 2
    assert "minutes cannot change when a run is resumed" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    "choice",
    [
        "method=3dgs strategy=mcmc",
        "method=4dgs",
        "method=4d-rotor",
        "method=spacetime",
        "method=dynamic3dgs",
    ],
)
def test_every_method_walks_through_its_whole_schedule(machine, tmp_path, choice):
    machine.slow_from = 30.0
    words = choice.split()
    if words[0] != "method=3dgs":
        words += ["datamanager.moving=true", "datamanager.views=12", "datamanager.times=4"]
    assert main(["train", *SMALL, *words, "minutes=1", f"out={tmp_path}"]) == 0
    record = planned(tmp_path)
    summary = json.loads(RunFolder(tmp_path).summary.read_text())
    assert summary["steps"] == record["decided"]["steps"]
    assert summary["skipped_steps"] == 0
    assert record["seconds"] <= 66
