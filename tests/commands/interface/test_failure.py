"""Tests of gsfw.commands.interface.failure."""

import errno
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from gsfw.commands.interface.console import Console
from gsfw.commands.interface.failure import RecordedError, report, tracebacks_in
from gsfw.core.errors import ConfigError, DataError, OutputError, TrainingError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.discovery import PluginSource
from gsfw.plugins.registry import installed
from gsfw.plugins.specs import Spec, hookimpl


def test_a_users_mistake_is_its_message_and_advice(capsys):
    code = report(ConfigError("seed=x: wrong.", "Write seed=1."), Console(), debug=False)
    assert code == 2
    assert capsys.readouterr().err == "error: seed=x: wrong.\nWrite seed=1.\n"
    assert report(TrainingError("gone."), Console(), debug=False) == 1


def test_for_programs_the_error_is_the_document(capsys):
    report(ConfigError("seed=x: wrong.", "Write seed=1."), Console(json_only=True), debug=False)
    document = json.loads(capsys.readouterr().out)
    assert document == {"error": "seed=x: wrong.", "advice": "Write seed=1."}


def test_a_path_that_is_too_long_is_no_bug(capsys):
    error = OSError(errno.ENAMETOOLONG, "File name too long", "a" * 5000)
    assert report(error, Console(), debug=False) == 2
    assert capsys.readouterr().err == (
        f"error: {'a' * 80}...: the path (5,000 characters), or a name in it, is too long for this "
        "system.\n"
        "Check the quotes of the command, or give a shorter path.\n"
    )


def test_a_file_that_may_not_be_used_is_no_bug(capsys, tmp_path):
    error = PermissionError(errno.EACCES, "Permission denied", "photos/a.jpg")
    assert report(error, Console(), debug=False) == 2
    assert capsys.readouterr().err == (
        "error: photos/a.jpg cannot be used: Permission denied.\n"
        "Change its permissions, or those of the folders above it (ls -ld shows them).\n"
    )
    with pytest.raises(DataError, match="cannot be used"), tracebacks_in(RunFolder(tmp_path), bool):
        raise error


@pytest.mark.parametrize("encoding", ["ascii", "iso8859-1", "cp1252"])
def test_a_name_that_the_locale_cannot_encode_is_no_bug(capsys, monkeypatch, encoding):
    monkeypatch.setattr("sys.getfilesystemencoding", lambda: encoding)
    monkeypatch.setattr("os.fsencode", lambda name: name.encode(encoding))
    # The error of the last two names another encoding: latin-1 and charmap.
    with pytest.raises(UnicodeEncodeError) as caught:
        "images/\u0142.jpg".encode(encoding)
    error = caught.value
    assert report(error, Console(), debug=False) == 2
    assert capsys.readouterr().err == (
        "error: 'images/\\u0142.jpg' cannot be the name of a file: this locale encodes names as "
        f"{encoding}.\n"
        "Set PYTHONUTF8=1 for names in UTF-8, and give the same command again.\n"
    )


def test_a_file_that_is_too_large_for_its_disk_is_no_bug(capsys):
    assert report(OSError(errno.EFBIG, "File too large", "a.pt"), Console(), debug=False) == 2
    assert capsys.readouterr().err == (
        "error: a.pt is larger than its disk or a limit (ulimit -f) allows.\n"
        "Raise the limit, or choose another place with out=DIR.\n"
    )


def test_an_unexpected_error_is_one_sentence_and_a_file(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert report(ZeroDivisionError("by zero\nmore"), Console(), debug=False) == 1
    (path,) = tmp_path.iterdir()
    assert capsys.readouterr().err == (
        "error: gsfw failed unexpectedly: ZeroDivisionError: by zero\n"
        f"The traceback is in {path}; debug=true shows it here. This is a bug of gsfw.\n"
    )
    assert "ZeroDivisionError: by zero" in path.read_text()


def test_the_traceback_of_a_run_is_in_its_log(capsys, tmp_path):
    folder = RunFolder(tmp_path)
    with pytest.raises(RecordedError) as caught, tracebacks_in(folder, lambda: True):
        raise ZeroDivisionError("by zero")
    assert "ZeroDivisionError: by zero" in folder.log.read_text()
    assert report(caught.value, Console(), debug=True) == 1
    said = capsys.readouterr().err
    assert "error: gsfw failed unexpectedly: ZeroDivisionError: by zero" in said
    assert f"The traceback is in {folder.log}. This" in said
    assert "Traceback (most recent call last)" in said


def out_of_torch():
    torch.empty(1 << 50, dtype=torch.uint8)  # A petabyte.


def out_of_numpy():
    np.empty(1 << 50, dtype=np.uint8)


def out_of_system():
    raise OSError(errno.ENOMEM, "Cannot allocate memory")


@pytest.mark.parametrize("allocate", [out_of_torch, out_of_numpy, out_of_system])
def test_full_memory_is_a_sentence_with_a_remedy_and_no_bug(capsys, tmp_path, allocate):
    with (
        pytest.raises(RecordedError) as caught,
        tracebacks_in(RunFolder(tmp_path), lambda: True),
    ):
        allocate()
    assert report(caught.value, Console(), debug=False) == 1
    assert capsys.readouterr().err == (
        "error: there is no memory left, on this machine or below the limit of this process.\n"
        "Shrink the images (downscale=2), keep fewer of them decoded (cache_mb=200), or limit the "
        "number of Gaussians (strategy=mcmc strategy.cap_max=200000). A scene that fits nowhere is "
        "trained in blocks: gsfw partition DATA out=DIR.\n"
    )


class Failing:
    @hookimpl
    def gsfw_samplers(self):
        return [Spec("failing", "", f"{__name__}:Failing")]

    def observe(self):
        raise KeyError("losses")

    def build(self):
        raise ModuleNotFoundError("No module named 'lacking'", name="lacking.part")


@pytest.fixture
def failing_plugin():
    discovery = installed()._discovery
    discovery.add(Failing(), PluginSource("failing", "gsfw-failing", "0.3"))
    yield
    discovery.remove("failing")


def test_an_error_in_the_code_of_a_plugin_names_the_code_and_its_package(
    capsys, tmp_path, monkeypatch, failing_plugin
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(KeyError) as caught:
        Failing().observe()
    report(caught.value, Console(), debug=False)
    said = capsys.readouterr().err
    assert re.match(
        r"error: (Failing\.)?observe of gsfw-failing 0\.3 \(test_failure\.py, line \d+\) failed "
        r"unexpectedly: KeyError: 'losses'\n",
        said,
    )
    assert "This is a bug of gsfw-failing, or it was made for another gsfw." in said


def test_a_module_that_a_plugin_lacks_is_to_be_installed(
    capsys, tmp_path, monkeypatch, failing_plugin
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(ModuleNotFoundError) as caught:
        Failing().build()
    report(caught.value, Console(), debug=False)
    said = capsys.readouterr().err
    assert "Install lacking (pip install lacking), which gsfw-failing needs." in said
    assert "bug of" not in said


def test_an_error_after_a_plugin_has_answered_names_the_plugins(
    capsys, tmp_path, monkeypatch, failing_plugin
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    report(ZeroDivisionError("by zero"), Console(), debug=False)
    assert "a bug of gsfw or of a plugin: gsfw-failing 0.3." in capsys.readouterr().err


def test_a_run_that_will_be_removed_keeps_no_log(tmp_path):
    with pytest.raises(ZeroDivisionError), tracebacks_in(RunFolder(tmp_path), lambda: False):
        raise ZeroDivisionError
    assert list(Path(tmp_path).iterdir()) == []


def test_a_users_mistake_is_not_logged(tmp_path):
    with pytest.raises(ConfigError), tracebacks_in(RunFolder(tmp_path), lambda: False):
        raise ConfigError("seed=x: wrong.")


def test_an_unexpected_error_has_no_file_where_the_temporary_folder_is_full(capsys, monkeypatch):
    def full(**settings):
        raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr("tempfile.mkstemp", full)
    assert report(RuntimeError("no"), Console(), debug=False) == 1
    assert "debug=true shows the traceback." in capsys.readouterr().err


def test_a_connection_that_fails_is_not_called_a_disk(capsys):
    assert report(OSError(errno.ETIMEDOUT, "timed out"), Console(), debug=False) == 1
    assert "the disk" not in capsys.readouterr().err


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC, errno.ESTALE])
def test_a_disk_that_fails_anywhere_is_one_sentence(capsys, number):
    error = OSError(number, os.strerror(number), "images/a.png")
    assert report(error, Console(), debug=False) == 2
    said = capsys.readouterr().err
    assert said.count("error: ") == 1
    assert said.startswith("error: the disk ")
    assert "images/a.png" in said


def test_a_disk_that_fails_during_a_run_leaves_no_traceback(tmp_path):
    folder = RunFolder(tmp_path)

    def fail() -> None:
        with tracebacks_in(folder, lambda: True):
            raise OSError(errno.EIO, "Input/output error")

    with pytest.raises(OutputError, match=f"the disk of {tmp_path} fails"):
        fail()
    assert not folder.log.exists()
