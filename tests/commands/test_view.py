"""The verb ``view``: what it opens, and what it refuses, before a page is served."""

import subprocess
import sys

import pytest

from gsfw.commands.main import main


def test_help_imports_neither_torch_nor_viser():
    code = (
        "import sys\nfrom gsfw.commands.main import main\nmain(['view', '--help'])\n"
        "print(*(name for name in ('torch', 'viser', 'numpy') if name in sys.modules), 'end')"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.splitlines()[-1] == " end".strip()
    assert "Show a trained model" in result.stdout
    assert "splat file of any format (gsfw plugins slot=importer)" in result.stdout


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("view",), "RUN|FILE ... is missing"),
        (("view", "a", "b", "c"), "shows one or two"),
        (("view", "nowhere"), "there is no run or splat file nowhere"),
        (("view", "nowhere", "port=70000"), "from 0 to 65535"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_words(words, told, capsys):
    assert main(list(words)) == 2
    assert told in capsys.readouterr().err


def test_without_viser_the_remedy_is_said(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name, package=None: None)
    assert main(["view", str(tmp_path)]) == 2
    assert "pip install 'gsfw[viewer]'" in capsys.readouterr().err


def test_a_file_that_holds_no_splats_is_refused(tmp_path, capsys):
    path = tmp_path / "notes.txt"
    path.write_text("nothing")
    assert main(["view", str(path)]) == 2
    assert "is not a splat file" in capsys.readouterr().err
