"""Feature search: signals while its processes are started."""

import signal
import subprocess
import sys

import pytest

from gsfw.preparation.feature_search import _deaf_to_interrupts

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "pthread_sigmask"), reason="Windows blocks no signals"
)
BLOCKED = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"


def interrupted_while_processes_start() -> str:
    with _deaf_to_interrupts():
        signal.raise_signal(signal.SIGINT)
        said = subprocess.check_output([sys.executable, "-S", "-c", BLOCKED], text=True)
        assert said == "True\n"
    return said


def test_ctrl_c_while_processes_start_comes_afterwards_and_to_this_process_alone():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        interrupted_while_processes_start()
    assert signal.getsignal(signal.SIGINT) is before
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
