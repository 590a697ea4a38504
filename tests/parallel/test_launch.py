"""Messages and exit codes of the command that has started processes."""

import os

import pytest
from torch.distributed.elastic.multiprocessing.errors import ProcessFailure

from gsfw.parallel.launch import _report

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")

RESUME = "Go on from the last checkpoint with gsfw resume RUN.\n"
STUCK = "had not ended 30 seconds after another one failed, and was ended\n"
KILLED = "was ended by SIGKILL (memory may have run out)\n"


def failures(*found):
    """Failures of processes by rank: exit codes (0: none), and seconds after the first one."""
    made = {}
    for rank, (code, seconds) in enumerate(found):
        if code:
            made[rank] = ProcessFailure(rank, 1000 + rank, code, "/nowhere")
            made[rank].timestamp = 1_700_000_000 + seconds
    return made


@pytest.mark.parametrize(
    ("found", "code", "said"),
    [
        # A killed process, with and without the end of the first one by torch.
        ([(1, 0), (-9, 0)], 1, f"error: process 1 {KILLED}"),
        ([(143, 1), (-9, 0)], 1, f"error: process 1 {KILLED}"),
        ([(-9, 0), (1, 3)], 1, f"error: process 0 {KILLED}{RESUME}"),
        ([(1, 0), (-9, 30)], 1, f"error: process 1 {STUCK}"),
        ([(-9, 30), (1, 0)], 1, f"error: process 0 {STUCK}{RESUME}"),
        ([(1, 0), (-11, 30)], 1, "error: process 1 was ended by SIGSEGV\n"),
        ([(2, 0), (-15, 1)], 2, ""),
        # A signal for all of them.
        ([(143, 0), (143, 0)], 143, ""),
        ([(143, 0), (-15, 0)], 143, ""),
        ([(0, 0), (1, 0)], 1, ""),
    ],
)  # fmt: skip
def test_the_first_cause_is_told_and_gives_the_exit_code(found, code, said, capsys):
    assert _report(failures(*found)) == code
    assert capsys.readouterr().err == said
