"""Browser: opens the page on this machine, without its secret in the list of processes."""

from __future__ import annotations

import os
import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.core.files.user_folder import cache_root

REDIRECT = """<!doctype html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={address}">
<title>gsfw</title>
<a href="{address}">gsfw</a>
"""


@contextmanager
def browser_on(address: str, folder: Path) -> Iterator[None]:
    """Open the page; what was needed for that is removed at the end of the context.

    The command line of a program is seen by every user of the machine. So the browser is given a
    file that leads to the address, and that nobody else may read.

    Args:
        address: of the page.
        folder: of the run that the page shows.
    """
    descriptor, name = _new_file(folder)
    try:
        with os.fdopen(descriptor, "w") as file:
            file.write(REDIRECT.format(address=address))
        webbrowser.open(Path(name).as_uri())
        yield
    finally:
        Path(name).unlink(missing_ok=True)


def _new_file(folder: Path) -> tuple[int, str]:
    """An open file with mode 0600, and its path.

    Browsers from a snap see another /tmp, and of the user's home only what is not hidden.
    """
    for place in (folder if _is_visible(folder) else None, cache_root()):
        try:
            if place is not None:
                place.mkdir(parents=True, exist_ok=True)
                return _made_in(place)
        except OSError:
            continue
    return _made_in(None)


def _made_in(place: Path | None) -> tuple[int, str]:
    return tempfile.mkstemp(prefix="gsfw-", suffix=".html", dir=place)


def _is_visible(folder: Path) -> bool:
    """True if a folder is in the user's home, and not below a hidden one there."""
    try:
        parts = folder.resolve().relative_to(Path.home().resolve()).parts
    except (ValueError, RuntimeError):  # It is elsewhere; this user has no home.
        return False
    return folder.is_dir() and not any(part.startswith(".") for part in parts[:1])
