"""RunProcess: one training run in a process of its own, which no other run can disturb."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsfw.plugins.config_file import read_config
from gsfw.studies.planned_run import PlannedRun

COMMAND = (sys.executable, "-m", "gsfw")
"""The gsfw that this is, whatever PATH says."""

INTERRUPTED = 130
"""Exit code of a run that a signal has stopped; it has left a checkpoint."""

SIGNALLED = {129: "SIGHUP", 143: "SIGTERM"}
"""Exit codes of a run that a signal has ended before it could stop after a step."""

PATIENCE = 30.0
"""Seconds that a run is given to write its checkpoint when it has to stop."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    finished: bool
    seconds: float
    """Since its process was started."""
    resumed: bool
    """Whether it went on from a checkpoint, so that these are not all its seconds."""
    stopped: bool = False
    """Whether it was asked to end, and goes on from its checkpoint another time."""
    error: str = ""
    advice: str = ""
    resumable: bool = False
    """Whether it was cut off from outside, and may go on."""


class RunProcess:
    """``gsfw train`` or, where there is a checkpoint, ``gsfw resume``, as a process."""

    def __init__(
        self,
        run: PlannedRun,
        threads: int | None = None,
        lock: int | None = None,
    ) -> None:
        """Start it.

        Args:
            run: that is made, or goes on.
            threads: it may use; ``None`` leaves that to the libraries.
            lock: an open file that it holds as long as it lives.

        Raises:
            ConfigError: it would go on, and the settings beside its checkpoint are damaged.
        """
        self.run = run
        self._asked_to_stop = False
        self._started = time.monotonic()
        self.resumed = run.steps_done() is not None
        if self.resumed:
            arguments = ["resume", str(run.folder.path), *_moved_data(run)]
        else:
            shutil.rmtree(run.folder.path, ignore_errors=True)  # Nothing in it can go on.
            arguments = ["train", *run.arguments()]
        # Files and not pipes: a pipe that nobody reads stops who writes.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it has ended
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            [*COMMAND, *arguments, "json=true"],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._messages,
            env=_environment(threads),
            pass_fds=() if lock is None or os.name == "nt" else (lock,),
            # Ctrl-C is for the study, which then asks its runs to stop, each once.
            start_new_session=True,
        )

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._started

    def poll(self) -> Outcome | None:
        """How it ended; ``None`` while it is at work."""
        code = self._process.poll()
        if code is None:
            return None
        outcome = self._outcome(code)
        self._close()
        return outcome

    def _close(self) -> None:
        self._output.close()
        self._messages.close()

    def stop(self, once_more: bool = False) -> None:
        """Ask it to end with a checkpoint, which takes a moment; once more, to end at once."""
        if once_more or not self._asked_to_stop:
            self._asked_to_stop = True
            self._process.terminate()

    def wait(self) -> None:
        """Wait until it has ended; when it does not, end it."""
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close()

    def _outcome(self, code: int) -> Outcome:
        if code == 0 and self.run.is_finished():
            return Outcome(True, self.seconds, self.resumed)
        if self._asked_to_stop:
            return Outcome(False, self.seconds, self.resumed, stopped=True)
        document = self._document()
        error, advice = str(document.get("error", "")), str(document.get("advice", ""))
        cut_off = code < 0 or code == INTERRUPTED or code in SIGNALLED
        if code < 0 or code in SIGNALLED:
            name = SIGNALLED.get(code) or signal.Signals(-code).name
            error = f"the run was ended from outside by {name}."
            if name == "SIGKILL":
                advice = "The system may have run out of memory: fewer jobs, or downscale=2."
        elif code == INTERRUPTED:
            error = "the run was interrupted from outside."
        elif not error:
            lines = self._text(self._messages).strip().splitlines()
            error = lines[-1] if lines else f"the run ended with exit code {code}."
        return Outcome(False, self.seconds, self.resumed, False, error, advice, cut_off)

    def _document(self) -> Mapping[str, Any]:
        """What it wrote for programs; empty where it could not."""
        try:
            document = json.loads(self._text(self._output))
        except ValueError:
            return {}
        return document if isinstance(document, dict) else {}

    def _text(self, file: Any) -> str:  # noqa: ANN401 - a temporary file has no public type
        file.seek(0)
        return str(file.read().decode(errors="replace"))


def _moved_data(run: PlannedRun) -> list[str]:
    """Where a run's data is, if that is not where it was."""
    before = read_config(run.folder.config, everything=True).values.get("data")
    if run.data is None or str(run.data.resolve()) == before:
        return []
    return [f"data={run.data}"]


def _environment(threads: int | None) -> dict[str, str]:
    environment = dict(os.environ)
    if threads is not None:
        environment["OMP_NUM_THREADS"] = str(threads)
    return environment
