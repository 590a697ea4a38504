"""Tests of gsfw.commands.plugins."""

import json

from gsfw.commands.main import main


def test_everything_is_listed_with_who_brings_it(capsys):
    assert main(["plugins"]) == 0
    lines = [line.split(maxsplit=5) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["slot", "name", "from", "API", "state", "description"]
    found = {(line[0], line[1]): line[2:] for line in lines[1:] if len(line) == 6}
    assert found["method", "3dgs"][:3] == ["gsfw", "0.1.0", "ok"]
    assert found["strategy", "mcmc"][-1].endswith("(Kheradmand et al. 2024)")


def test_one_slot_can_be_asked_for(capsys):
    assert main(["plugins", "slot=strategy", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {item["slot"] for item in document["plugins"]} == {"strategy"}
    own = [item["name"] for item in document["plugins"] if item["distribution"] == "gsfw"]
    assert own == ["adc", "error", "mcmc", "none"]


def test_an_unknown_slot_suggests_the_nearest(capsys):
    assert main(["plugins", "slot=strat"]) == 2
    assert capsys.readouterr().err == (
        "error: slot=strat: there is no such slot. Did you mean 'strategy'?\n"
        "Slots: method, rasterizer, datamanager, strategy, sampler, operators, exporter, "
        "importer, metric, callback, command.\n"
    )
