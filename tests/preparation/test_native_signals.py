"""Signals after COLMAP was loaded, in a process of their own: it is loaded only once."""

import subprocess
import sys

import pytest

LOADED = """
import os, signal, sys
from gsfw.preparation import native_signals

class Signal:
    def find_spec(self, name, path=None, target=None):
        if name == "pycolmap._core":
            os.kill(os.getpid(), signal.SIGINT)

if sys.argv[1] == "during":
    sys.meta_path.insert(0, Signal())
try:
    native_signals.load_colmap()
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM))
except KeyboardInterrupt:
    print("pycolmap" in sys.modules, "interrupted")
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""
ENDED = """
import os, signal, sys
from gsfw.preparation.native_signals import load_colmap

signal.signal(signal.SIGTERM, lambda *_: sys.exit("cleaned up"))
load_colmap()
os.kill(os.getpid(), signal.SIGTERM)
"""


def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(("moment", "said"), [("during", "True interrupted\nTrue\n")])
def test_ctrl_c_waits_until_colmap_is_loaded(moment, said):
    assert run(LOADED, moment).stdout == said


def test_sigterm_still_lets_python_clean_up():
    ended = run(ENDED)
    assert (ended.returncode, ended.stderr) == (1, "cleaned up\n")
