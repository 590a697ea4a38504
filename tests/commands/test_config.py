"""Tests of gsfw.commands.config."""

import json

from gsfw.commands.main import main


def test_every_value_is_shown_with_its_source(capsys):
    assert main(["config", "show", "method=3dgs", "strategy=mcmc", "seed=3"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[:3] == ["setting source", "method=3dgs command line", "strategy=mcmc command line"]
    assert "seed=3 command line" in lines
    assert "datamanager=synthetic chosen automatically: no data= is given" in lines
    assert "sampler=uniform chosen automatically: the default of gsfw" in lines
    assert "steps=1000 recommended by datamanager synthetic" in lines
    assert "checkpoint_every=167 method default x 0.0333 (steps=1000)" in lines


def test_for_programs_it_is_a_mapping(capsys):
    assert main(["config", "show", "method=3dgs", "steps=7000", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["steps"] == {"value": 7000, "source": "command line"}
    assert document["checkpoint_every"] == {
        "value": 1167, "source": "method default x 0.233 (steps=7000)",
    }  # fmt: skip


def test_what_to_do_has_to_be_said(capsys):
    assert main(["config"]) == 2
    assert capsys.readouterr().err == (
        "error: gsfw config: no action is given.\nWrite gsfw config show method=NAME.\n"
    )
    assert main(["config", "shw"]) == 2
    assert capsys.readouterr().err.startswith("error: gsfw config: no action 'shw'.\n")
    assert main(["config", "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: gsfw config show method=NAME")
