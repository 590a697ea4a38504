"""Tests of gsfw.commands.plugin_check: `gsfw plugins check NAME`."""

import json

import pytest

from gsfw.commands.main import main
from gsfw.testing import Promise, checks, require


def test_a_line_for_each_promise_and_the_totals(capsys):
    assert main(["plugins", "check", "psnr"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("metric 'psnr' (gsfw ")
    assert any(line.startswith("  kept            honours-valid (") for line in lines)
    assert any("settings-round-trip" in line and "has no settings" in line for line in lines)
    assert lines[-1].endswith("kept, 0 broken, 4 not applicable")


@pytest.fixture
def impossible(monkeypatch):
    """A promise that no part keeps."""

    def function(subject):
        require(False, "It is\nnot so.", "Change everything.")

    promise = Promise("is-impossible", "It is impossible.", function)
    monkeypatch.setattr(checks, "EVERYWHERE", (promise,))


@pytest.mark.usefixtures("impossible")
def test_a_broken_promise_is_one_line_and_exit_code_1(capsys):
    assert main(["plugins", "check", "psnr", "slot=metric", "only=is-impossible"]) == 1
    out = capsys.readouterr().out
    assert "): is-impossible: It is not so. Change everything.\n" in out


@pytest.mark.usefixtures("impossible")
def test_the_document_has_every_promise(capsys):
    assert main(["plugins", "check", "psnr", "only=is-impossible", "json=true"]) == 1
    (item,) = json.loads(capsys.readouterr().out)["promises"]
    assert item["verdict"] == "broken"
    assert item["change"] == "Change everything."


def test_unknown_names_are_refused(capsys):
    assert main(["plugins", "check", "psnr", "only=honour-valid"]) == 2
    assert "Did you mean 'honours-valid'?" in capsys.readouterr().err
    assert main(["plugins", "check", "there-is-none"]) == 2
    assert "no part of a plugin 'there-is-none' is registered" in capsys.readouterr().err
