"""The campaign of wild trainings finds every class of defect, and passes what is sound."""

from pathlib import Path

import pytest
import torch
from support.made_once import MadeOnce
from training_runs import Ended, Verdict, judge, run_verb
from wild_captures import photographed
from wild_conditions import CONDITIONS
from wild_training import CAMPAIGN, WAYS, WildRun, arguments, run, runs, try_run

PLUGIN = Path(__file__).parents[1] / "support" / "sabotage.py"
SOUND = next(each for each in CONDITIONS if each.name == "nothing is wrong")


def test_every_condition_is_tried_with_every_way_that_can_show_it():
    tried = list(runs(CAMPAIGN.full, 0))
    assert len(set(tried)) == CAMPAIGN.full
    assert {each.condition for each in tried} == set(CONDITIONS)
    assert not any(each.condition.is_of_time and each.way.is_static for each in tried)
    assert next(iter(runs(CAMPAIGN.full + 1, 0))).seed == 0
    assert [*runs(CAMPAIGN.full + 1, 0)][-1].seed == 1


def test_names_of_conditions_are_unique():
    names = [each.name for each in CONDITIONS]
    assert len(names) == len(set(names))


def test_rates_are_those_of_the_method_by_a_factor(tmp_path):
    wild = next(each for each in CONDITIONS if each.name == "learning rates x100")
    words = arguments(WildRun(wild, WAYS[0], 0), tmp_path, tmp_path)
    assert "optim.scales_lr=0.5" in words
    usual = arguments(WildRun(SOUND, WAYS[0], 0), tmp_path, tmp_path)
    assert not any("optim" in word for word in usual)


def test_ends_that_nobody_has_foreseen_are_broken(tmp_path):
    def verdict(code, err=""):
        return judge(Ended(code, "", err), tmp_path / "run").verdict

    assert verdict(None) is verdict(-11) is verdict(7, "error: no") is Verdict.BROKEN
    assert verdict(1, "error: gsfw failed unexpectedly: x\n") is Verdict.BROKEN
    assert verdict(2, "Traceback (most recent call last):\nerror: x") is Verdict.BROKEN
    assert verdict(2) is verdict(0) is Verdict.BROKEN
    err = f"note: a\nerror: {tmp_path}/data: it is empty.\nFill it.\n"
    told = judge(Ended(2, "", err), tmp_path / "run")
    assert told.verdict is Verdict.TOLD
    assert told.reason == "data: it is empty. Fill it."


@pytest.fixture(scope="module")
def data(made_once: MadeOnce) -> Path:
    """A small capture on disk."""
    return made_once(photographed(moving=False).write, "wild")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "found"),
    [
        ("error", "failed unexpectedly: RuntimeError: nobody has foreseen this"),
        ("nan", "not finite"),
        ("hang", "it did not end in its time"),
        ("kill", "killed by signal 11"),
        ("exit", "exit code 7, and no message"),
    ],
)
def test_planted_defects_are_found(tmp_path, data, how, found):
    words = ["method=3dgs", "device=cpu", "steps=6", "report=false", f"data={data}"]
    words += ["strategy=sabotage", f"strategy.how={how}", f"out={tmp_path / 'run'}"]
    seconds, plugin = 8.0 if how == "hang" else 200.0, {"GSFW_PLUGIN_PATH": str(PLUGIN)}
    ended = run_verb(["train", *words], tmp_path, seconds, plugin)
    judged = judge(ended, tmp_path / "run")
    assert judged.verdict is Verdict.BROKEN
    assert found in judged.reason


@pytest.mark.slow
def test_a_sound_run_survives_and_files_with_nan_are_found(tmp_path):
    judged = try_run(WildRun(SOUND, WAYS[0], 0), tmp_path)
    assert judged.verdict is Verdict.SURVIVED, judged.reason
    (last, *_) = sorted((tmp_path / "run" / "checkpoints").glob("*.pt"), reverse=True)
    state = torch.load(last, weights_only=True)
    state["model"][next(iter(state["model"]))].view(-1)[0] = torch.nan
    torch.save(state, last)
    broken = judge(Ended(0), tmp_path / "run")
    assert broken.verdict is Verdict.BROKEN
    assert f"{last.name}: model." in broken.reason


@pytest.mark.slow
def test_the_short_form_holds():
    outcome = run(2, 0, lambda line: None)
    assert [each.holds for each in outcome.promises] == [True]
    assert outcome.promises[0].figure.startswith("2 runs: 2 trained")
    assert outcome.failures == []
