"""Programs in forks of one process, which has loaded what all of them need."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]

FORKS = """
import gc, json, os, sys

gc.disable()
exec(sys.argv[1])
gc.freeze()  # Collections of forks pass over what is loaded.
gc.enable()
codes = {}
for name, program in json.loads(sys.argv[2]).items():
    files = [open(os.path.join(sys.argv[3], name + end), "w") for end in (".out", ".err")]
    child = os.fork()
    if child == 0:
        for number, file in enumerate(files, 1):
            os.dup2(file.fileno(), number)
        exec(program)
        sys.exit()
    codes[name] = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
print(json.dumps(codes))
"""
"""Runs each program, one after another."""


def ended_forks(
    prelude: str, programs: Mapping[str, str], folder: Path
) -> dict[str, subprocess.CompletedProcess[str]]:
    """Programs as fresh interpreters would have ended; skips the test where there is no fork.

    Loading torch takes seconds: here all programs share them.

    Args:
        prelude: runs before the forks, and starts no thread.
        programs: source by name, which is a name of files, too.
        folder: takes what they print.
    """
    if not hasattr(os, "fork"):
        pytest.skip("this system has no fork")
    paths = [str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])]
    one_thread = {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-c", FORKS, prelude, json.dumps(programs), str(folder)]
    done = subprocess.run(
        command, env=os.environ | one_thread, capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = {}
    for name, code in json.loads(done.stdout).items():
        said = [(folder / f"{name}.{end}").read_text(encoding="utf-8") for end in ("out", "err")]
        found[name] = subprocess.CompletedProcess([name], code, *said)
    return found
