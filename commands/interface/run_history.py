"""Run history: where this user's runs are, one line of a file for each that was started."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from pathlib import Path

from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.user_folder import state_root

FOLDER = "GSFW_STATE_DIR"
"""Environment variable: folder of the file; none: nothing is remembered."""
NONE = "none"
FILE = "runs.jsonl"
MOST_BYTES = 200_000
"""Bytes of the end of the file that are read: more than a thousand runs."""


def history_file() -> Path | None:
    """The file; ``None`` if nothing is remembered."""
    chosen = os.environ.get(FOLDER, "")
    if chosen == NONE:
        return None
    root = Path(chosen).expanduser() if chosen else state_root()
    return None if root is None else root / FILE


def remember_run(folder: Path) -> None:
    """Add a run that starts now, or goes on; nothing where the file cannot be written to.

    A line is appended in one call, so that processes do not write into each other's lines.
    """
    file = history_file()
    if file is None:
        return
    line = json.dumps({"run": str(folder.resolve()), "start": time.time()}) + "\n"
    with suppress(OSError):  # A read-only home costs a run nothing.
        file.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            os.write(handle, line.encode())
        finally:
            os.close(handle)


def remembered_runs() -> dict[Path, float]:
    """Last start, in seconds since 1970, of each remembered run, whether or not it is still there.

    Lines that cannot be read (of a full disk, or from a network disk's race) are left out.
    """
    file, starts = history_file(), dict[Path, float]()
    if file is None:
        return starts
    for line in _end_of(file).splitlines():
        try:
            document = parsed_json(line)
            path, start = Path(document["run"]), float(document["start"])
        except (ValueError, TypeError, KeyError):
            continue
        starts[path] = max(start, starts.get(path, start))
    return starts


def _end_of(file: Path) -> str:
    """The last lines of a file; empty if it cannot be read."""
    try:
        with file.open("rb") as opened:
            opened.seek(max(0, file.stat().st_size - MOST_BYTES))
            return opened.read().decode(errors="replace")
    except OSError:
        return ""
