"""Tests of gsfw.callbacks.notebook_line and gsfw.core.notebook, with a stand-in of IPython."""

import sys
from types import SimpleNamespace

import pytest

from gsfw.callbacks import notebook_line
from gsfw.callbacks.live_line import Figures
from gsfw.callbacks.notebook_line import NotebookLine
from gsfw.callbacks.progress import Progress
from gsfw.core.notebook import is_notebook
from gsfw.core.progress import tracked


class Page:
    """What a notebook has been told to show, in the protocol of IPython's displays."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def display(self, content, display_id):
        assert display_id is True
        self.update(content)
        return self

    def update(self, content):
        self.shown.append(content._repr_html_())


@pytest.fixture
def page(monkeypatch) -> Page:
    found = Page()
    shell = SimpleNamespace(kernel=object())
    module = SimpleNamespace(
        get_ipython=lambda: shell, display=SimpleNamespace(display=found.display)
    )
    monkeypatch.setitem(sys.modules, "IPython", module)
    monkeypatch.setattr(notebook_line, "SECONDS", 0.0)
    return found


def test_a_terminal_is_no_notebook_not_even_that_of_ipython(monkeypatch):
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert not is_notebook()
    for shell in (None, SimpleNamespace()):
        module = SimpleNamespace(get_ipython=lambda shell=shell: shell)
        monkeypatch.setitem(sys.modules, "IPython", module)
        assert not is_notebook()


def test_the_line_shows_figures_and_stages_and_is_empty_at_the_end(page):
    assert is_notebook()
    figures = Figures(step=0, steps=200)
    line = NotebookLine(figures)
    figures.step = 50
    line.refresh()
    assert '<progress value="50" max="200"></progress>' in page.shown[-1]
    assert "25%   50/200  --:-- left" in page.shown[-1]
    assert repr(line) == "25%   50/200  --:-- left"
    with line.stage("evaluating <views>", 8) as advance:
        advance(3)
    assert page.shown[-1].endswith("<br>evaluating &lt;views&gt;: 3 of 8")
    line.close()
    assert page.shown[-1] == "<span></span>"
    assert repr(line) == ""


def test_the_line_is_not_refreshed_more_often_than_people_read(page, monkeypatch):
    monkeypatch.setattr(notebook_line, "SECONDS", 1e6)
    line = NotebookLine(Figures(0, 10))
    for _ in range(100):
        line.refresh()
    assert len(page.shown) == 1


def test_progress_in_a_notebook_is_its_line_and_nothing_on_standard_error(page, tmp_path, capsys):
    from gsfw.core.callback import Control, RunInfo

    run = RunInfo(tmp_path, "3dgs", "toy", steps=2, first_step=0, settings={}, protocol={})
    progress = Progress(seconds=0.0)
    progress.on_start(run, Control())
    progress.on_tick(1, Control())
    assert '<progress value="1" max="2">' in page.shown[-1]
    list(tracked([1, 2], "writing", 2))
    assert "writing: 2 of 2" in page.shown[-1]
    progress.on_end(2, {})
    assert page.shown[-1] == "<span></span>"
    assert capsys.readouterr() == ("", "")
