"""Tests of gsfw.commands.main, in processes of their own: start-up, exit codes, streams."""

import errno
import json
import os
import signal
import subprocess
import sys

from gsfw.commands import main as main_module
from gsfw.commands.main import main


def gsfw(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gsfw", *arguments],
        capture_output=True, text=True, check=False, env=os.environ | environment,
    )  # fmt: skip


LIGHT = [
    ([], 0),
    (["--help"], 0),
    (["--version"], 0),
    (["trian"], 2),
    (["train"], 2),
    (["train", "--help"], 0),
    (["train", "method=3dgz"], 2),
    (["train", "method=3dgs", "strategy=mcmcm"], 2),
    (["eval", "--help"], 0),
    (["resume"], 2),
    (["plugins"], 0),
]


def test_modules_of_the_current_folder_take_no_place_of_installed_ones(tmp_path):
    (tmp_path / "pluggy.py").write_text("raise SystemExit('a module of the current folder')")
    done = subprocess.run(
        [sys.executable, "-m", "gsfw", "plugins", "slot=sampler"],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert "uniform" in done.stdout, done.stderr


def test_commands_that_need_no_torch_do_not_import_it():
    script = (
        "import sys\nfrom gsfw.commands.main import main\n"
        f"for arguments in {[arguments for arguments, _ in LIGHT]}:\n"
        "    code = main(arguments)\n"
        "    heavy = sorted({'torch', 'numpy', 'scipy'} & set(sys.modules))\n"
        "    print('FOUND', code, *heavy, file=sys.stderr)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    found = [line for line in result.stderr.splitlines() if line.startswith("FOUND")]
    assert found == [f"FOUND {code}" for _, code in LIGHT]


def test_help_lists_every_verb_in_a_line_and_two_examples():
    result = gsfw("--help")
    assert result.returncode == 0
    for verb in ("train", "resume", "eval", "render", "export", "info", "plugins", "doctor"):
        assert f"\n  {verb} " in result.stdout
    assert result.stdout.count("\n  gsfw train ") == 2
    assert gsfw().stdout == result.stdout


def test_help_on_a_verb_is_asked_for_before_it_or_after_it(capsys):
    def said(*arguments: str, stream: str = "out") -> str:
        main(list(arguments))
        return getattr(capsys.readouterr(), stream)

    asked = said("eval", "--help")
    assert asked.startswith("usage: gsfw eval RUN")
    assert said("help", "eval") == asked
    assert said("--help", "eval") == asked
    assert json.loads(said("help", "json=true", "eval"))["help"] + "\n" == asked
    assert said("help", "help") == said("--help", "--version") == said()
    assert "Did you mean 'eval'?" in said("help", "evla", stream="err")


def test_the_version_is_that_of_the_package():
    assert gsfw("--version").stdout == "gsfw 0.1.0\n"


def test_an_unknown_verb_suggests_the_nearest():
    result = gsfw("trian", "method=3dgs")
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == (
        "error: gsfw has no verb 'trian'. Did you mean 'train'?\n"
        "Verbs: bench, blocks, check, completion, config, convert, doctor, edit, eval, export, "
        "info, new, open, partition, plugins, prepare, render, report, resume, runs, stress, "
        "study, tradeoff, train, view. See gsfw --help.\n"
    )


def test_errors_are_a_document_too_where_json_is_asked_for():
    result = gsfw("train", "method=3dgz", "json=true")
    assert result.returncode == 2
    document = json.loads(result.stdout)
    assert document["error"] == "no method '3dgz'. Did you mean '3dgs'?"
    assert document["advice"].startswith("Installed: 3dgs")


def test_a_reader_that_stops_reading_is_no_error():
    process = subprocess.Popen(
        [sys.executable, "-m", "gsfw", "plugins"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    errors = process.stderr.read()
    process.stderr.close()
    assert (process.wait(), errors) == (0, b"")


def failing_verb(error: BaseException):
    def verb(tokens: list[str]) -> int:
        raise error

    return lambda name, registry: verb


def test_an_unexpected_error_is_one_sentence_and_exit_code_1(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(main_module, "_find_verb", failing_verb(ZeroDivisionError("by zero")))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["train"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: gsfw failed unexpectedly: ZeroDivisionError: by zero\n")
    assert "Traceback" not in said
    assert main(["train", "--debug"]) == 1
    assert "Traceback (most recent call last)" in capsys.readouterr().err


def test_a_current_folder_that_was_removed_is_told(capsys, monkeypatch):
    def gone():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))

    with monkeypatch.context() as patch:
        patch.setattr(os, "getcwd", gone)
        assert main(["train"]) == 2
    assert capsys.readouterr().err == (
        "error: the current folder cannot be found any more (No such file or directory).\n"
        "Change to a folder that exists, such as: cd ~\n"
    )


def test_ctrl_c_has_its_own_exit_code(capsys, monkeypatch):
    monkeypatch.setattr(main_module, "_find_verb", failing_verb(KeyboardInterrupt()))
    assert main(["train"]) == 130
    assert capsys.readouterr().err == "\ninterrupted\n"


def test_a_verb_that_is_terminated_removes_what_is_temporary(tmp_path):
    script = (
        "import sys, tempfile, time\n"
        "from gsfw.commands import main\n"
        "def verb(tokens):\n"
        "    held = tempfile.TemporaryDirectory(dir=tokens[0])\n"
        "    print('there', flush=True)\n"
        "    time.sleep(60)\n"
        "main._find_verb = lambda name, registry: verb\n"
        "sys.exit(main.main(['eval', sys.argv[1]]))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        assert len(list(tmp_path.iterdir())) == 1
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 128 + signal.SIGTERM
    assert not list(tmp_path.iterdir())
