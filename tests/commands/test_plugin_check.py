"""Tests of gsfw.commands.plugin_check: `gsfw plugins check NAME`."""

import json

import pytest
from support.plugin_files import hook

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


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, where modules are imported from."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path / "imported"))
    (tmp_path / "imported").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([".foo"], "no part of a plugin '.foo' is registered"),
        (["wrong_syntax_of_plugin"], "'wrong_syntax_of_plugin' cannot be imported: SyntaxError"),
        (["lacks_a_module"], "cannot be imported: ModuleNotFoundError: No module named 'gone_mod"),
        (["psnr", "settings=foo"], "settings=foo: expected keys with values"),
        (["only_here"], "name it: GSFW_PLUGIN_PATH=only_here.py gsfw plugins check only_here"),
        (["only_here.py"], "name it: GSFW_PLUGIN_PATH=only_here.py gsfw plugins check only_here"),
    ],
)
def test_names_that_are_no_plugins_end_with_the_cause_and_the_remedy(
    folder, capsys, words, message
):
    (folder / "imported" / "wrong_syntax_of_plugin.py").write_text("def\n")
    (folder / "imported" / "lacks_a_module.py").write_text("import gone_module\n")
    (folder / "only_here.py").write_text("")
    assert main(["plugins", "check", *words]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "unexpected" not in said


def test_a_plugin_of_the_path_is_checked_as_an_installed_one(plugin_path, tmp_path, capsys):
    body = "from gsfw.api import Spec, hookimpl\n\n"
    body += hook("gsfw_requires_api", "return '>=1.0,<2'")
    spec = "Spec('of-the-path', '', 'gsfw.samplers.uniform:UniformConfig')"
    body += hook("gsfw_samplers", f"return [{spec}]")
    file = tmp_path / "checked_plugin.py"
    file.write_text(body)
    plugin_path(file)
    only = "only=registration-is-light,states-its-api-range"
    assert main(["plugins", "check", "of-the-path", only]) == 0
    assert "2 kept, 0 broken, 0 not applicable" in capsys.readouterr().out


def test_a_module_of_the_path_that_fails_is_not_advised_to_be_named(plugin_path, folder, capsys):
    (folder / "fails_on_the_path.py").write_text("def\n")
    plugin_path(folder / "fails_on_the_path.py")
    assert main(["plugins", "check", "fails_on_the_path"]) == 2
    said = capsys.readouterr().err
    assert "SyntaxError" in said
    assert "name it" not in said
