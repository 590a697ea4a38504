"""Standard streams that nobody reads, that are full, or that were closed from the start."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

WORK = """
import sys
from pathlib import Path
from gsfw.commands.interface.streams import lasting_streams

with lasting_streams():
    sys.stdin.readline()
    for number in range(3):
        print(number, file=sys.STREAM, flush=True)
    Path("done").touch()
"""
SIGNALLED = """
import os, signal, sys
from gsfw.commands import main

main._run = lambda tokens, console: os.kill(os.getpid(), signal.SIGTERM)
sys.exit(main.main(["info"]))
"""


def gsfw(*words: str, **streams: object) -> subprocess.CompletedProcess[str]:
    """Run a command line."""
    return subprocess.run([sys.executable, "-m", "gsfw", *words], text=True, check=False, **streams)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("unbuffered", ["", "1"])  # Images of containers often set it.
def test_work_goes_on_when_the_reader_of_a_pipe_has_gone(tmp_path, stream, unbuffered):
    process = subprocess.Popen(
        [sys.executable, "-c", WORK.replace("STREAM", stream)],
        stdin=subprocess.PIPE,
        cwd=tmp_path,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        **{stream: subprocess.PIPE},
    )
    getattr(process, stream).close()
    process.stdin.close()
    assert process.wait() == 0
    assert (tmp_path / "done").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
def test_work_goes_on_where_messages_go_to_a_full_disk(tmp_path):
    code = WORK.replace("STREAM", "stderr")
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-c", code]
        subprocess.run(command, stdin=subprocess.DEVNULL, cwd=tmp_path, stderr=full, check=True)
    assert (tmp_path / "done").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
@pytest.mark.parametrize("words", [("runs", "json=true"), ("--help",)])
def test_a_result_that_a_full_disk_loses_is_one_message(tmp_path, words):
    with open("/dev/full", "w") as full:
        done = gsfw(*words, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert done.stderr.startswith("error: the disk is full")
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="streams of POSIX")
@pytest.mark.parametrize(("encoding", "smile"), [("ascii", "\\U0001f600"), ("utf-8", "\U0001f600")])
def test_characters_that_a_stream_cannot_encode_are_escapes(encoding, smile):
    code = (
        "from gsfw.commands.interface.streams import lasting_streams\n"
        "with lasting_streams(): print('\\U0001f600', '\\udcff')"
    )
    said = subprocess.check_output(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONIOENCODING": encoding}
    )
    assert said.decode(encoding).split() == [smile, "\\udcff"]


def test_streams_that_were_closed_from_the_start_are_no_error(tmp_path):
    def close() -> None:
        for number in range(3):
            os.close(number)

    assert gsfw("runs", cwd=tmp_path, preexec_fn=close).returncode == 0
    assert gsfw("nothing", cwd=tmp_path, preexec_fn=close).returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_command_that_a_signal_ends_says_so():
    command = [sys.executable, "-c", SIGNALLED]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "\nended by SIGTERM\n")
