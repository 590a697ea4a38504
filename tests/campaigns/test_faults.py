"""Short forms of the campaigns of interruptions, failing disks and power losses.

Each has planted defects of the kinds that it must find.
"""

import random
import signal
from dataclasses import replace

import failing_disks
import interruptions
import pytest
from disk_states import Operation
from failing_disks import Disks, Trial, ending_problems
from file_faults import Calls, Fault, Kind, compiler, fails_with
from final_outputs import differences, negative_times
from forked_commands import Ended, Server
from interrupted_work import SCENE, WORKS, Work, make_inputs, training
from interruptions import Trials, signal_problems
from power_loss import Loss, check_states

from gsfw.core.loop.run_folder import RunFolder

needs_compiler = pytest.mark.skipif(compiler() is None, reason="needs Linux and a C compiler (cc)")
QUICK = ("steps=8", "checkpoint_every=4", "eval_every=0", "report=false")
TRAIN = training(*QUICK)
EXPORT = WORKS["export"][6]


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return tmp_path_factory.mktemp("faults")


@pytest.fixture(scope="module")
def server(base):
    with Server(base / "server") as server:
        make_inputs(server, base / "inputs")
        yield server


@pytest.mark.slow
@needs_compiler
def test_killed_and_interrupted_commands_go_on(server, base, monkeypatch):
    monkeypatch.setitem(WORKS, "export", (EXPORT,))
    monkeypatch.setitem(WORKS, "train", (TRAIN,))
    trials = Trials(server, base, 5)
    trials.killed("train", 0)
    trials.killed("export", 1)
    trials.killed("export", 2)
    trials.interrupted("train", 0, signal.SIGHUP)
    trials.with_clock("export", interruptions.DAY)
    assert trials.tally.failures == []
    assert trials.tally.total(*interruptions.KILLS) >= 3
    assert len(interruptions.outcome(trials.tally).promises) == 3


@pytest.mark.slow
@needs_compiler
def test_a_command_that_goes_on_otherwise_is_found(server, base, monkeypatch):
    def anew(place):
        return ("export", str(base / "inputs" / "run"), f"out={place}/model.ply", "sh_degree=0")

    monkeypatch.setitem(WORKS, "export", (replace(EXPORT, goes_on=anew),))
    trials = Trials(server, base, 6)
    trials.killed("export", 0)
    assert any("model.ply differs" in each for each in trials.tally.failures)
    assert not interruptions.outcome(trials.tally).promises[0].holds


@pytest.mark.slow
@needs_compiler
def test_disks_fail_in_words_and_damage_nothing(server, base):
    disks = Disks(server, base, 7)
    for fault in (
        fails_with("ENOSPC", 1, (Calls.WRITE,), lasting=True),
        fails_with("EIO", 1, (Calls.FSYNC,)),
        fails_with("EROFS", 1, (Calls.RENAME,)),
        fails_with("EINTR", 1, (Calls.WRITE,)),
        Fault(Kind.SHORT, Calls.WRITE, at=1),
    ):
        disks.attempt("export", Trial(EXPORT, "a fault", fault))
    disks.attempt("train", Trial(TRAIN, "stale", fails_with("ESTALE", 150, (*Calls,), True)))
    assert disks.tally.failures == []
    assert disks.ends["one sentence, exit code 2"] >= 3
    assert len(failing_disks.outcome(disks).promises) == 2


@pytest.mark.slow
@needs_compiler
def test_a_damaged_checkpoint_and_a_cut_file_of_before_are_found(server, base, tmp_path):
    disks = Disks(server, tmp_path, 8)
    disks.work_place.inputs = base / "inputs"
    run = RunFolder(disks.work_place.place)
    run.checkpoints.mkdir(parents=True)
    run.checkpoint(3).write_bytes(b"half")
    assert any("damaged: " in each for each in disks._damage(TRAIN))
    disks.work_place.known(EXPORT)
    (run.path / "model.ply").write_bytes(b"half of a new file")
    assert any("neither there nor replaced" in each for each in disks._damage(EXPORT))


@pytest.mark.slow
@needs_compiler
def test_a_training_survives_power_losses_and_would_not_without_each_fsync(
    server, tmp_path, monkeypatch
):
    loss = Loss(server, tmp_path, TRAIN)
    monkeypatch.setattr("power_loss.RESUMED_EVERY", 10**9)
    found = check_states(loss.operations, loss.root, 70, random.Random(1), loss.check)
    assert found.failures == []
    folder = str(loss.run / "checkpoints")

    def without(is_left_out):
        kept = [
            item for item in loss.operations if not (item.kind == "fsync" and is_left_out(item))
        ]
        return check_states(kept, loss.root, 70, random.Random(1), loss.check).failures

    def of_the_folder(item: Operation) -> bool:
        return item.path == folder

    def of_the_files(item: Operation) -> bool:
        return item.path.startswith(f"{folder}/")

    assert any("was reported, found" in each for each in without(of_the_folder))
    assert any("a damaged checkpoint" in each for each in without(of_the_files))


def ended(code, said="", complained="", hung=False):
    return Ended(code, 1.0, said, complained, 10, hung)


@pytest.mark.parametrize(
    ("end", "problem"),
    [
        (ended(2, complained="Traceback (most recent call last):\nerror: x"), "traceback"),
        (ended(-9, hung=True), "it hangs"),
        (ended(1, complained="error: gsfw failed unexpectedly: OSError"), "no message for users"),
        (ended(2, complained="error: a\nerror: b"), "not one sentence"),
        (ended(-11), "exit code -11"),
    ],
)
def test_each_bad_end_on_a_failing_disk_is_found(end, problem):
    assert any(problem in each for each in ending_problems(end))


def test_good_ends_on_a_failing_disk_are_not(tmp_path):
    assert list(ending_problems(ended(2, complained="error: the disk is full: x.\nFree it."))) == []
    assert list(ending_problems(ended(0, complained="warning: no report"))) == []
    assert list(ending_problems(ended(1, said="[1/2] a: failed: the disk is full"))) == []


@pytest.mark.parametrize(
    ("end", "problem"),
    [
        (ended(130, said="x", complained="Traceback"), "traceback"),
        (ended(-15, said="preparing"), "exit code -15"),
        (ended(143, said="preparing"), "no checkpoint is said to be written"),
    ],
)
def test_each_bad_end_after_a_signal_is_found(end, problem, tmp_path):
    (tmp_path / "metrics.jsonl").touch()
    assert any(problem in each for each in signal_problems("train", end, tmp_path))
    good = ended(130, said="stopped after 3 of 24 steps", complained="stopping after this step")
    assert list(signal_problems("train", good, tmp_path)) == []


def test_of_earlier_checkpoints_only_those_that_both_have_are_compared():
    second = {"a/checkpoints/step_020.pt": 0, "a/checkpoints/step_024.pt": 1}
    first = {"a/checkpoints/step_018.pt": 0, "a/checkpoints/step_024.pt": 1}
    assert not list(differences(first, second))
    assert not list(differences(first, {**first, **second}))
    assert list(differences(first, {"a/checkpoints/step_024.pt": 1}))
    assert list(differences(first, {**second, "a/checkpoints/step_018.pt": 1}))
    assert list(differences(first, {**second, "a/checkpoints/step_024.pt": 2}))
    assert list(differences(first, {"a/checkpoints/step_018.pt": 0}))
    assert list(differences(first, {**second, "a/checkpoints/step_030.pt": 1}))
    assert list(differences(first, {**second, "b/checkpoints/step_018.pt": 1}))


def test_differences_name_the_file_and_the_place(tmp_path):
    first = {"a.json": {"psnr": [1.0, 2.0]}, "b.ply": "1", "c": "1"}
    second = {"a.json": {"psnr": [1.0, 3.0]}, "b.ply": "1", ".c.part": "1"}
    assert list(differences(first, second)) == [
        ".c.part is left behind",
        "a.json differs at .psnr.1: 2.0 is 3.0",
        "c is missing",
    ]
    (tmp_path / "metrics.json").write_text('{"train_seconds": -1, "x_ms": 2, "loss": -3}')
    assert list(negative_times(tmp_path)) == ["metrics.json: train_seconds"]


def test_works_name_their_place_and_the_length_of_a_training(tmp_path):
    command = TRAIN.command(tmp_path / "a", tmp_path / "b")
    assert command.words == ("train", *SCENE, *QUICK, f"out={tmp_path / 'a'}")
    assert TRAIN.going_on(tmp_path / "a", tmp_path).words == command.words
    RunFolder(tmp_path / "a").write_checkpoint(3, {})
    assert TRAIN.going_on(tmp_path / "a", tmp_path).words == ("resume", str(tmp_path / "a"))
    work = Work("x", ("export", "{inputs}/run"))
    assert work.going_on(tmp_path, tmp_path / "in").words == ("export", f"{tmp_path}/in/run")
