"""Processes whose parent is ended by force."""

import subprocess
import sys


def test_a_process_ends_when_its_parent_was_ended_by_force(tmp_path):
    """Such a parent cannot say so: without a look at it, its processes would wait for ever."""
    parent = tmp_path / "parent.py"
    parent.write_text(
        "import multiprocessing, os, time\n"
        "from gsfw.preparation.parent_process import end_with_parent\n"
        "def wait():\n"
        "    end_with_parent()\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)\n"
        "if __name__ == '__main__':\n"
        "    multiprocessing.get_context('spawn').Process(target=wait).start()\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, str(parent)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        process.kill()
        # Its output ends when the last process that holds it has ended.
        assert process.communicate(timeout=30)[0] == b""
