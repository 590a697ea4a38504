"""Process: runs a command within a time, and keeps what it printed."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gpu_package import ROOT

KILL_SECONDS = 5.0
"""Seconds that a process may take to die."""


@dataclass(frozen=True)
class Ended:
    """The end of a command."""

    output: str
    """Standard output."""
    seconds: float
    problem: str
    """Reason that there is no result; empty when it ended well."""


class Process:
    """A command that runs beside this one, with files for what it prints."""

    def __init__(
        self, name: str, command: list[str], environment: Mapping[str, str], folder: Path
    ) -> None:
        self._output, self._errors = folder / f"{name}.out", folder / f"{name}.log"
        self._started = time.monotonic()
        with self._output.open("wb") as output, self._errors.open("wb") as errors:
            self._process = subprocess.Popen(
                command,
                stdout=output,
                stderr=errors,
                stdin=subprocess.DEVNULL,
                cwd=ROOT,
                env=dict(environment),
                start_new_session=True,  # So that its children can be ended with it.
            )

    @property
    def seconds(self) -> float:
        """Duration since the start of the process."""
        return time.monotonic() - self._started

    def wait(self, seconds: float) -> Ended:
        """Wait that long at most, then end it and its children."""
        problem = ""
        try:
            code = self._process.wait(max(seconds, 0.0))
            if code:
                problem = f"it ended with code {code}: {self._last_words()}"
        except subprocess.TimeoutExpired:
            problem = f"it had not ended after {self.seconds:.0f} s"
            self._end()
        output = self._output.read_text(encoding="utf-8", errors="replace")
        return Ended(output, self.seconds, problem)

    def _end(self) -> None:
        for how in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(self._process.pid, how)
                self._process.wait(KILL_SECONDS)
                return
            except ProcessLookupError:
                return
            except subprocess.TimeoutExpired:
                continue

    def _last_words(self) -> str:
        """The last line that says something."""
        for file in (self._errors, self._output):
            text = file.read_text(encoding="utf-8", errors="replace")
            lines = [line.strip() for line in text.splitlines() if line.strip()]
            if lines:
                return lines[-1][:300]
        return "it said nothing"
