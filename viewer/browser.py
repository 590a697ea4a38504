"""Browser: opens the page on this machine, without its secret in the list of processes."""

from __future__ import annotations

import os
import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

REDIRECT = """<!doctype html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={address}">
<title>gsfw</title>
<a href="{address}">gsfw</a>
"""


@contextmanager
def browser_on(address: str) -> Iterator[None]:
    """Open the page; what was needed for that is removed at the end of the context.

    The command line of a program is seen by every user of the machine. So the browser is given a
    file that leads to the address, and that nobody else may read.
    """
    descriptor, name = tempfile.mkstemp(prefix="gsfw-", suffix=".html")  # With mode 0600.
    try:
        with os.fdopen(descriptor, "w") as file:
            file.write(REDIRECT.format(address=address))
        webbrowser.open(Path(name).as_uri())
        yield
    finally:
        Path(name).unlink(missing_ok=True)
