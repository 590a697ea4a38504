"""`gsfw open` is `gsfw view`, of the latest run if none is named."""

import pytest

from gsfw.commands.main import main


@pytest.fixture
def viewed(monkeypatch):
    """What the viewer is started with."""
    calls: list[list[str]] = []
    monkeypatch.setattr("gsfw.commands.view.run", lambda tokens: calls.append(tokens) or 0)
    return calls


def test_the_latest_run_is_opened_unless_another_is_named(viewed):
    for arguments in ([], ["port=8123"], ["latest"], ["runs/a", "runs/b"], ["runs=a.ply"]):
        assert main(["open", *arguments]) == 0
    assert viewed == [
        ["latest"], ["latest", "port=8123"], ["latest"], ["runs/a", "runs/b"], ["runs=a.ply"],
    ]  # fmt: skip


def test_its_help_is_that_of_view(capsys):
    assert main(["open", "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: gsfw view RUN")
