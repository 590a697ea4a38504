"""Tests of gsfw.commands.new."""

import json

import pytest

from gsfw.commands.main import main
from gsfw.scaffold.kinds import KINDS


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_without_arguments_all_kinds_are_listed(capsys):
    assert main(["new"]) == 0
    output = capsys.readouterr().out
    assert [line.split()[0] for line in output.splitlines()[1:11]] == list(KINDS)


def test_a_package_is_written_and_the_next_commands_are_printed(tmp_path, capsys):
    assert main(["new", "strategy", "my-strategy"]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [
        "edit  my-strategy/my_strategy/strategy.py",
        "",
        "  pip install -e ./my-strategy",
        "  gsfw train method=3dgs strategy=my-strategy",
        "  pytest my-strategy",
    ]
    found = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    assert found >= {
        "my-strategy/pyproject.toml",
        "my-strategy/.github/workflows/tests.yml",
        "my-strategy/my_strategy/__init__.py",
        "my-strategy/tests/test_my_strategy.py",
    }


def test_a_method_can_be_like_another_one(tmp_path, capsys):
    assert main(["new", "method", "mine", "like=4dgs", "out=work/mine", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["edit"] == "work/mine/mine/method.py"
    text = (tmp_path / document["edit"]).read_text()
    assert "class MineConfig(DeformationConfig)" in text


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["metod", "x"], "there is no kind 'metod'. Did you mean 'method'?\nKinds: method, "),
        (["metric"], "NAME is missing.\nWrite, for instance, gsfw new metric my-metric."),
        (["sampler", "x", "like=3dgs"], "only a method can derive from another.\nLeave it out."),
        (["method", "x", "like=4dg"], "no method can derive from it. Did you mean '4dgs'?"),
    ],
)
def test_wrong_arguments_are_named_with_the_remedy(given, message, capsys):
    assert main(["new", *given]) == 2
    assert message in capsys.readouterr().err


def test_an_existing_folder_is_left_alone(capsys):
    assert main(["new", "metric", "mine"]) == 0
    assert main(["new", "metric", "mine"]) == 2
    assert "mine exists already.\nRemove it, or" in capsys.readouterr().err
