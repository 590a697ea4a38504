"""Completion in the shells themselves: what they offer after a command line."""

import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from support.interactive_shell import InteractiveShell

from gsfw.commands.interface.completion_scripts import SCRIPTS, completion_script
from gsfw.commands.interface.completion_table import START, completion_table
from gsfw.commands.main import main
from gsfw.plugins.registry import installed
from gsfw.scaffold.kinds import BASES


@cache
def table() -> list[str]:
    return completion_table(installed())


def shell_script(tmp_path: Path, shell: str) -> Path:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} on this machine; Debian's package is {shell}")
    path = tmp_path / f"_{shell}"
    path.write_text(completion_script(shell, table()))
    return path


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    (tmp_path / "runs" / "fox").mkdir(parents=True)
    (tmp_path / "runs" / "a b").mkdir()
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def bash(tmp_path):
    """Gives what bash would offer at the end of a line."""
    path = shell_script(tmp_path, "bash")

    def offered(line: str, before: str = "") -> list[str]:
        script = (
            f"source {path}; {before}\nCOMP_LINE=$1 COMP_POINT=${{#1}}\n_gsfw\n"
            'printf "%s\\n" "${COMPREPLY[@]}"'
        )
        result = subprocess.run(
            ["bash", "--norc", "-c", script, "bash", line],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert result.stderr == ""
        return [word for word in result.stdout.split("\n") if word]

    return offered


def test_verbs_and_their_keys_are_offered(bash):
    assert bash("gsfw trai") == ["train"]
    assert {"train", "runs", "completion", "--help"} <= set(bash("gsfw "))
    assert bash("gsfw eval spl") == ["split="]
    assert bash("gsfw new ra") == ["rasterizer"]
    assert bash("gsfw runs com") == ["compare"]
    assert bash("gsfw config sho") == ["show"]
    assert sorted(bash("gsfw new method mine like=")) == sorted(BASES), "what gsfw new takes"


def test_values_of_choices_and_names_of_parts_are_offered(bash):
    assert bash("gsfw eval split=") == ["eval", "train"]
    assert bash("gsfw runs state=f") == ["finished"]
    assert bash("gsfw train method=") == list(installed().slot("method"))
    assert bash("gsfw train method=3dgs strategy=mc") == ["mcmc"]
    assert bash("gsfw train json=") == ["true", "false"]
    assert bash("gsfw export latest format=pl") == ["ply"]
    assert {"fast", "paper"} <= set(bash("gsfw train method=3dgs preset="))
    assert bash("gsfw resume latest devi") == ["device="]


def test_keys_of_a_group_are_offered_once_its_dot_is_there(bash):
    assert bash("gsfw train method=3dgs opt") == ["optim."]
    assert "optim.means_lr=" in bash("gsfw train method=3dgs optim.")
    assert bash("gsfw train method=3dgs callbacks.tens") == ["callbacks.tensorboard."]
    assert bash("gsfw train method=3dgs view") == ["viewer=", "viewer."]


def test_keys_follow_the_chosen_parts(bash):
    assert bash("gsfw train method=3dgs strategy=mcmc strategy.cap") == ["strategy.cap_max="]
    assert bash("gsfw train method=3dgs strategy=adc strategy.cap") == []
    assert bash("gsfw train method=4dgs hexpl") == ["hexplane."]
    assert bash("gsfw train method=3dgs hexpl") == []


def test_keys_of_training_are_offered_for_training_that_follows_a_preparation(bash):
    assert bash("gsfw prepare photos minu") == []
    assert bash("gsfw prepare photos train=true minu") == ["minutes="]
    assert bash("gsfw prepare photos train=true strat") == ["strategy="]
    following = "gsfw prepare photos train=true method=3dgs strategy=mcmc "
    assert bash(f"{following}strategy.cap") == ["strategy.cap_max="]
    assert "fast" in bash(f"{following}preset=")
    assert bash("gsfw prepare photos train=true datam") == ["datamanager="]


def test_a_key_that_is_given_is_not_offered_again(bash):
    assert bash("gsfw train seed=1 see") == []


def test_runs_and_files_are_offered(bash):
    assert bash("gsfw eval ")[:2] == ["latest", "runs/"]
    assert sorted(bash("gsfw eval runs/")) == ["runs/a\\ b/", "runs/fox/"]
    assert bash("gsfw train data=run") == ["runs/"]


def test_an_unknown_verb_has_no_keys(bash):
    assert bash("gsfw nonsense ") == []
    assert bash("gsfw @ ") == []


def test_where_an_equals_sign_separates_no_words_the_key_is_kept(bash):
    assert bash("gsfw eval split=tr", "COMP_WORDBREAKS=' '") == ["split=train"]


def test_a_file_that_is_named_like_a_pattern_changes_no_words(bash, tmp_path):
    (tmp_path / "method=4dgs").touch()
    assert bash("gsfw train m* hexpl") == []
    assert "seed=" in bash("gsfw train * see")


def test_an_escaped_space_is_part_of_its_word(bash):
    assert bash("gsfw train data=runs/a\\ ") == ["runs/a\\ b/"]
    assert bash("gsfw eval runs/a\\ b/ spl") == ["split="]


def test_an_old_bash_is_told_so_and_loads_nothing(tmp_path):
    path = shell_script(tmp_path, "bash")
    path.write_text(path.read_text().replace("BASH_VERSINFO", "OLD_VERSION"))
    script = f"OLD_VERSION=(3 2); source {path}; complete -p gsfw"
    result = subprocess.run(
        ["bash", "--norc", "-c", script], capture_output=True, text=True, check=False
    )
    assert result.stderr.startswith("gsfw completion needs bash 4.3, and this is ")
    assert "or use zsh: gsfw completion zsh\n" in result.stderr
    assert result.stdout == ""


@pytest.fixture(params=["bash", "zsh", "fish"])
def interactive(request, tmp_path):
    """A shell on a terminal, in a folder with runs and files of awkward names."""
    for name in ("model.gsfw", "method=4dgs"):
        (tmp_path / name).touch()
    shell = InteractiveShell(request.param, shell_script(tmp_path, request.param), tmp_path)
    yield shell
    shell.close()


def test_tab_completes_in_every_shell(interactive):
    for typed, completed in (
        ("gsfw trai", "gsfw train "),
        ("gsfw runs com", "gsfw runs compare "),
        ("gsfw eval split=tr", "gsfw eval split=train "),
        ("gsfw train meth", "gsfw train method="),
        ("gsfw train method=4dg", "gsfw train method=4dgs "),
        ("gsfw train method=3dgs opti", "gsfw train method=3dgs optim."),
        ("gsfw train strategy=mcmc strategy.cap", "gsfw train strategy=mcmc strategy.cap_max="),
        ("gsfw train m* hexpl", "gsfw train m* hexpl"),
        ("gsfw eval la", "gsfw eval latest "),
        ("gsfw view mod", "gsfw view model.gsfw "),
        ("gsfw eval runs/f", "gsfw eval runs/fox/"),
        ("gsfw eval runs/a", "gsfw eval runs/a\\ b/"),
        ("gsfw train data=runs/a\\ ", "gsfw train data=runs/a\\ b/"),
        ("gsfw render latest channel=dep", "gsfw render latest channel=depth "),
        ("gsfw render latest channel=color,dep", "gsfw render latest channel=color,depth "),
    ):
        assert interactive.completed(typed) == completed


def test_the_table_knows_every_verb_and_every_setting(capsys):
    lines = [line.split("|") for line in table()]
    verbs = {word for context, word, _ in lines if context == START and word[0] != "-"}
    assert verbs == set(installed().slot("command"))
    assert {context.split()[0] for context, _, _ in lines} == {START, *verbs}
    assert main(["train", "method=3dgs", "--help"]) == 0
    text = capsys.readouterr().out
    helped = {line.split("=")[0] for line in text.splitlines() if "=" in line.split(" ")[0]}
    offered = {word.rstrip("=") for context, word, _ in lines if context.startswith("train")}
    assert helped - offered == set()


def test_a_verb_of_another_package_that_fails_costs_only_its_own_keys(monkeypatch):
    def fail(tokens):
        raise SystemExit(3)

    def other(slot, registry):
        found = load_all(slot, registry)
        return {**found, "theirs": fail} if slot == "command" else found

    from gsfw.commands.interface.completion_table import load_all

    monkeypatch.setattr("gsfw.commands.interface.completion_table.load_all", other)
    lines = completion_table(installed())
    assert "theirs|--help|" in lines
    assert "eval|split=|eval train" in lines


def test_the_verb_prints_a_script_and_names_the_shells(capsys):
    assert main(["completion", "bash"]) == 0
    assert capsys.readouterr().out.rstrip().endswith("complete -F _gsfw gsfw")
    assert main(["completion", "csh"]) == 2
    assert capsys.readouterr().err == (
        "error: gsfw completion: there is no script for 'csh'. Did you mean 'zsh'?\n"
        f"Shells: {', '.join(SCRIPTS)}.\n"
    )
