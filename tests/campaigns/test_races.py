"""The campaign of races: its short form, and planted defects that it must find."""

from dataclasses import replace

import pytest
import races
from file_faults import compiler
from forked_commands import Ended, Server
from interrupted_work import WORKS, make_inputs
from races import Races, race_problems

DONE = Ended(0, 1.0, "done", "", 0)
REFUSED = replace(DONE, code=2, complained="\nerror: another gsfw is at work there.\n")


@pytest.mark.parametrize(
    ("ends", "found"),
    [
        ((DONE, DONE), ""),
        ((DONE, REFUSED), ""),
        ((REFUSED, REFUSED), "each is refused for the other"),
        ((DONE, replace(REFUSED, complained="")), "without a message"),
        ((DONE, replace(DONE, code=1)), "exit code 1"),
        ((DONE, replace(DONE, code=-9, hung=True)), "one hangs"),
        ((DONE, replace(DONE, complained="Traceback (most recent call last)")), "a traceback"),
    ],
)
def test_ends_that_break_the_promise_are_found(ends, found):
    problems = list(race_problems(ends))
    assert len(problems) == bool(found)
    assert found in "".join(problems)


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="needs Linux and a C compiler (cc)")
def test_races_end_well_and_other_outputs_are_found(tmp_path, monkeypatch):
    export = WORKS["export"][6]
    with Server(tmp_path / "one") as one, Server(tmp_path / "two") as two:
        make_inputs(one, tmp_path / "inputs")
        raced = Races((one, two), tmp_path, 1)
        for verb in ("train", "resume", "export"):
            raced.race(verb, 6)
        assert raced.tally.failures == []
        assert races.outcome(raced.tally).promises[0].holds

        def anew(place):
            run = str(tmp_path / "inputs" / "run")
            return ("export", run, f"out={place}/model.ply", "sh_degree=0")

        monkeypatch.setitem(WORKS, "export", (replace(export, goes_on=anew),))
        raced.race("export", 0)
    (failure,) = raced.tally.failures
    assert "model.ply differs" in failure
    assert not races.outcome(raced.tally).promises[0].holds
