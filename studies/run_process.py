"""RunProcess: one training run in a process of its own."""

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

from gsfw.core.cores import cores
from gsfw.plugins.config_file import read_config
from gsfw.studies.planned_run import PlannedRun

COMMAND = (sys.executable, "-m", "gsfw")
"""This gsfw, whatever PATH says."""

INTERRUPTED = 130
"""Exit code of a run that was stopped by a signal and has written a checkpoint."""

SIGNALLED = {129: "SIGHUP", 143: "SIGTERM"}
"""Exit codes of a run that was ended by a signal before it could stop after a step."""

PATIENCE = 30.0
"""Seconds for writing a checkpoint after a request to stop."""


@dataclass(frozen=True)
class Outcome:
    """The end of a run's process."""

    finished: bool
    seconds: float
    """Since the process was started."""
    resumed: bool
    """True if the run went on from a checkpoint, so that these are not all its seconds."""
    stopped: bool = False
    """True if it was asked to end; it goes on from its checkpoint another time."""
    error: str = ""
    advice: str = ""
    resumable: bool = False
    """True if it was cut off from outside and can go on."""


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
            run: to make or to continue.
            threads: that the process may use; ``None`` leaves that to the libraries.
            lock: an open file that the process holds as long as it lives.

        Raises:
            ConfigError: the settings beside the run's checkpoint are damaged.
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
        # Files and not pipes: a full pipe that nobody reads blocks its writer.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it has ended
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            [*COMMAND, *arguments, "json=true"],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._messages,
            env=_environment(threads),
            pass_fds=() if lock is None or os.name == "nt" else (lock,),
            # Ctrl-C goes to the study alone, which then asks its runs to stop, each once.
            start_new_session=True,
        )

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._started

    def poll(self) -> Outcome | None:
        """The outcome; ``None`` while the process runs."""
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
        """Ask the process to end with a checkpoint; once more, to end at once."""
        if once_more or not self._asked_to_stop:
            self._asked_to_stop = True
            self._process.terminate()

    def wait(self) -> None:
        """Wait until the process has ended; kill it after ``PATIENCE`` seconds."""
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
        """The run's JSON document; empty where it has written none."""
        try:
            document = json.loads(self._text(self._output))
        except ValueError:
            return {}
        return document if isinstance(document, dict) else {}

    def _text(self, file: Any) -> str:  # noqa: ANN401 - a temporary file has no public type
        file.seek(0)
        return str(file.read().decode(errors="replace"))


def _moved_data(run: PlannedRun) -> list[str]:
    """The argument that names a run's data where it has moved."""
    before = read_config(run.folder.config, everything=True).values.get("data")
    if run.data is None or str(run.data.resolve()) == before:
        return []
    return [f"data={run.data}"]


def _environment(threads: int | None) -> dict[str, str]:
    environment = dict(os.environ)
    if threads is not None:
        environment["OMP_NUM_THREADS"] = str(threads)
    return environment


def threads_per_run(jobs: int) -> int | None:
    """Threads of each of several runs at a time; ``None`` leaves a single one as it is."""
    if jobs == 1:
        return None
    text = os.environ.get("OMP_NUM_THREADS", "")
    available = int(text) if text.isdecimal() and int(text) > 0 else cores()
    return max(1, available // jobs)
