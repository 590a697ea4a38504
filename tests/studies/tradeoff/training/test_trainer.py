"""Trials are made once, judged, and found again; the runs are those of fake_variants."""

import shutil
import sys
import time
from pathlib import Path

import pytest
from support import fake_variants
from support.fake_variants import KILLED

from gsfw.core.callback import Control
from gsfw.jobs.local import LocalExecutor
from gsfw.plugins.registry import installed
from gsfw.studies.result import ResultStore
from gsfw.studies.tradeoff.training.axes import Choice, Recipe
from gsfw.studies.tradeoff.training.base import find_base
from gsfw.studies.tradeoff.training.search import Trial
from gsfw.studies.tradeoff.training.trainer import PSNR, SSIM, Trainer, Workshop

CAP = Recipe((Choice("cap", "cap 1/2", part=0.5),))
LESS = Recipe((Choice("sh_degree", "sh_degree=1", {"sh_degree": 1}),))
SAME = Recipe((Choice("sh_degree", "sh_degree=3", {"sh_degree": 3}),))


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    command = (sys.executable, "-S", fake_variants.__file__)
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", command)


def trainer(folder: Path, deadline=None, seed=42) -> Trainer:
    base = find_base({"method": "3dgs", "seed": seed}, installed())
    store = ResultStore(folder / "results.json", "")
    shop = Workshop(installed(), folder, store, Control(), LocalExecutor(2), deadline=deadline)
    return Trainer(base, shop, lambda run, result: {PSNR: result.figures["psnr"], SSIM: 0.5})


def made(folder: Path) -> list[str]:
    return (folder / "runs" / "made.txt").read_text().split()


def test_what_is_limited_knows_the_baseline_of_its_length(tmp_path):
    work = trainer(tmp_path)
    baseline, capped = Trial(Recipe(), 200, 42), Trial(CAP, 200, 42)
    assert work.plan(capped) is None
    assert list(work.train([capped])) == []
    assert len(list(work.train([baseline, capped]))) == 1
    assert work.settings(capped)["strategy.budget"] == str(fake_variants.GAUSSIANS // 2)
    assert len(list(work.train([capped]))) == 1
    result = work.result(capped)
    assert result.figures["num_gaussians"] == 500
    assert work.outcome(capped).size == 500 * 59 * 4
    assert work.outcome(baseline).psnr == pytest.approx(23.3)


def test_trials_that_mean_the_same_are_made_once(tmp_path):
    work = trainer(tmp_path)
    trials = [Trial(Recipe(), 100, 42), Trial(SAME, 100, 42), Trial(LESS, 100, 42)]
    assert len(work.missing(trials)) == 2
    assert len(list(work.train(trials))) == 2
    assert len(made(tmp_path)) == 2
    assert work.result(trials[0]) == work.result(trials[1])
    assert work.outcome(trials[2]).psnr < work.outcome(trials[0]).psnr


def test_finished_runs_are_found_again_and_killed_ones_are_made_anew(tmp_path):
    trials = [Trial(Recipe(), 100, 42), Trial(Recipe(), 100, KILLED)]
    first, second = sorted(trainer(tmp_path).train(trials), key=lambda ended: ended.run.cell.seed)
    assert first.failure.error == "the run was ended from outside by SIGKILL."
    assert second.result is not None
    again = trainer(tmp_path)
    assert len(again.missing(trials)) == 1
    assert again.outcome(trials[0]) is not None
    assert again.outcome(trials[1]) is None
    (tmp_path / "runs" / "allowed").touch()
    assert len(list(again.train(trials))) == 1
    assert len(made(tmp_path)) == 2
    assert again.outcome(trials[1]) is not None


@pytest.mark.slow
def test_the_results_are_the_same_in_any_order(tmp_path):
    trials = [Trial(Recipe(), 100, 42), Trial(LESS, 100, 42), Trial(Recipe(), 200, 42)]
    outcomes = []
    for name, order in (("a", trials), ("b", trials[::-1])):
        work = trainer(tmp_path / name)
        list(work.train(order))
        outcomes.append([work.outcome(trial) for trial in trials])
    assert outcomes[0] == outcomes[1]


def test_nothing_is_started_that_would_not_end_in_time(tmp_path):
    work = trainer(tmp_path, deadline=time.monotonic() + 60)
    short, long = Trial(Recipe(), 100, 42), Trial(Recipe(), 100_000, 42)
    (ended,) = work.train([long, short])
    assert ended.run.steps == 100
    assert [run.steps for run in work.missing([long, short])] == [100_000]
    assert list(trainer(tmp_path, deadline=time.monotonic() - 1).train([long])) == []


def test_a_run_whose_folder_is_gone_is_made_again(tmp_path):
    trial = Trial(Recipe(), 100, 42)
    (ended,) = trainer(tmp_path).train([trial])
    shutil.rmtree(ended.run.folder.path)
    work = trainer(tmp_path)
    assert work.result(trial) is None
    assert len(list(work.train([trial]))) == 1
    assert work.result(trial) is not None


def test_a_run_that_was_made_and_not_judged_is_judged_when_it_is_asked_for(tmp_path, monkeypatch):
    trial = Trial(Recipe(), 100, 42)
    monkeypatch.setattr(Trainer, "_judged", lambda self, run: None)
    list(trainer(tmp_path).train([trial]))
    monkeypatch.undo()
    work = trainer(tmp_path)
    assert work.missing([trial]) == []
    assert work.outcome(trial).psnr == pytest.approx(22.3)
    assert (
        PSNR
        in ResultStore(tmp_path / "results.json", "").results[work.plan(trial).cell.key].figures
    )
