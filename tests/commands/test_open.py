"""`gsfw open` is `gsfw view`, of the latest run if none is named."""

import pytest

from gsfw.commands.main import main


@pytest.fixture
def shown(monkeypatch):
    """Runs and port that the viewer is started with."""
    calls: list[tuple[tuple[str, ...], int]] = []

    def show(verb, options):
        calls.append((options.runs, options.port))
        return 0

    monkeypatch.setattr("gsfw.commands.view.show", show)
    return calls


def test_the_latest_run_is_opened_unless_another_is_named(shown):
    for arguments in ([], ["port=8123"], ["latest"], ["runs/a", "runs/b"], ["runs=a.ply"]):
        assert main(["open", *arguments]) == 0
    assert shown == [
        (("latest",), 0), (("latest",), 8123), (("latest",), 0), (("runs/a", "runs/b"), 0),
        (("a.ply",), 0),
    ]  # fmt: skip


def test_its_help_names_it_and_says_that_the_run_may_be_left_out(capsys):
    assert main(["open", "--help"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("usage: gsfw open [RUN|FILE ...] [key=value ...]")
    assert "Left out: the latest run." in said
    assert "port=0" in said


def test_its_mistakes_name_it(capsys, shown):
    assert main(["open", "prot=8123"]) == 2
    assert capsys.readouterr().err.startswith("error: gsfw open: unknown key 'prot'.")
    assert shown == []
