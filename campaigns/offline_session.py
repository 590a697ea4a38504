"""Offline session: a program that makes uses of the command line, one after another.

Its argument is a file with a JSON list of uses, each a list of words. It prints a line for each:
``{"use": ..., "code": ..., "said": ...}``. A page that a verb serves is asked for once, and then
the verb is interrupted, as by Ctrl-C.
"""

from __future__ import annotations

import io
import json
import os
import re
import signal
import sys
import threading
import time
import urllib.request
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

PAGE = re.compile(r"the page is at (http://\S+)")
PATIENCE = 120.0
"""Seconds until a page has to be served."""
SERVING = ("view", "open")
"""Verbs that go on until they are interrupted."""


def main(path: Path) -> int:
    """Make all uses of a file; 0, whatever they return."""
    from gsfw.commands.main import main as gsfw

    for words in json.loads(path.read_text()):
        said, visited = io.StringIO(), [words[0] not in SERVING]
        visitor = threading.Thread(target=_visit, args=(said, visited), daemon=True)
        with redirect_stdout(said), redirect_stderr(said):
            if not visited[0]:
                visitor.start()
            try:
                code = gsfw(words)
            except SystemExit as left:
                code = left.code if isinstance(left.code, int) else 1
        if visited[0] is False:
            code = 1
        line = {"use": words, "code": code, "said": said.getvalue()[-2000:]}
        sys.stdout.write(f"{json.dumps(line)}\n")
        sys.stdout.flush()
    return 0


def _visit(said: io.StringIO, visited: list[bool]) -> None:
    """Ask for the page of a verb once it is served, and then interrupt the verb."""
    end = time.monotonic() + PATIENCE
    while (found := PAGE.search(said.getvalue())) is None and time.monotonic() < end:
        time.sleep(0.05)
    if found is not None:
        with urllib.request.urlopen(found[1], timeout=30) as answer:
            visited[0] = b"<html" in answer.read()
    os.kill(os.getpid(), signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
