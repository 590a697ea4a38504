"""JobProcess: one job in a process of its own, on the machine that this program runs on."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from gsfw.core.loop.run_folder import RunFolder
from gsfw.jobs.job import Call, Job
from gsfw.jobs.outcome import Outcome

COMMAND = (sys.executable, "-m", "gsfw")
"""This gsfw, whatever PATH says."""

CALL = (sys.executable, "-m", "gsfw.jobs.call")
"""Makes a call that a file holds."""

INTERRUPTED = 130
"""Exit code of a run that was stopped by a signal and has written a checkpoint."""

SIGNALLED = {129: "SIGHUP", 143: "SIGTERM"}
"""Exit codes of a run that was ended by a signal before it could stop after a step."""

PATIENCE = 30.0
"""Seconds for writing a checkpoint after a request to stop."""


def is_resumable(job: Job) -> bool:
    """True if a job can go on from a checkpoint."""
    if job.folder is None or not job.resume:
        return False
    folder = RunFolder(job.folder)
    return folder.latest_checkpoint() is not None and folder.config.is_file()


class JobProcess:
    """A job as a process: ``python -m gsfw`` with its arguments, or with those to resume."""

    def __init__(
        self,
        job: Job,
        threads: int | None = None,
        lock: int | None = None,
        before: tuple[str, ...] = (),
    ) -> None:
        """Start it.

        Args:
            job: to do or to continue.
            threads: that the process may use; ``None`` leaves that to the libraries.
            lock: an open file that the process holds as long as it lives.
            before: a command line that runs the process's own, given after it.
        """
        self.job = job
        self._asked_to_stop = False
        self._started = time.monotonic()
        self.resumed = is_resumable(job)
        if job.folder is not None and not self.resumed:
            shutil.rmtree(job.folder, ignore_errors=True)  # Nothing in it can go on.
        # Files and not pipes: a full pipe that nobody reads blocks its writer.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it has ended
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115
        self._call: Path | None = None
        self._process = subprocess.Popen(
            [*before, *self._command()],
            # Who waits for the end of this program does that by the end of its input.
            stdin=subprocess.PIPE if before else subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._messages,
            env=_environment(threads),
            pass_fds=() if lock is None or os.name == "nt" else (lock,),
            # Ctrl-C goes to the study alone, which then asks its runs to stop, each once.
            start_new_session=True,
        )

    def _command(self) -> list[str]:
        work = self.job.resume if self.resumed else self.job.work
        if not isinstance(work, Call):
            return [*COMMAND, *work, "json=true"]
        self._call = Path(tempfile.mkdtemp(prefix="gsfw-call-"))
        (self._call / "call").write_bytes(pickle.dumps((work.function, work.arguments)))
        return [*CALL, str(self._call)]

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._started

    @property
    def is_running(self) -> bool:
        """True if it has not ended."""
        return self._process.poll() is None

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
        if self._process.stdin is not None:
            self._process.stdin.close()
        if self._call is not None:
            shutil.rmtree(self._call, ignore_errors=True)

    def stop(self, once_more: bool = False) -> None:
        """Ask the process to end with a checkpoint; once more, to end at once."""
        if once_more and os.name != "nt":
            self._process.send_signal(signal.SIGINT)
        elif not self._asked_to_stop:
            self._process.terminate()
        self._asked_to_stop = True

    def wait(self) -> None:
        """Wait until the process has ended; kill it after ``PATIENCE`` seconds."""
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close()

    def _outcome(self, code: int) -> Outcome:
        result = self.job.result
        if code == 0 and (result is None or result.is_file()):
            value = None
            if self._call is not None:
                value = pickle.loads((self._call / "value").read_bytes())
            document = self._document()
            return Outcome(True, self.seconds, self.resumed, document=document, value=value)
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
            lines = _text(self._messages).strip().splitlines()
            error = lines[-1] if lines else f"the run ended with exit code {code}."
        return Outcome(False, self.seconds, self.resumed, False, error, advice, cut_off, document)

    def _document(self) -> Mapping[str, Any]:
        """The run's JSON document; empty where it has written none."""
        try:
            document = json.loads(_text(self._output))
        except ValueError:
            return {}
        return document if isinstance(document, dict) else {}


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode(errors="replace")


def _environment(threads: int | None) -> dict[str, str]:
    environment = dict(os.environ)
    if threads is not None:
        environment["OMP_NUM_THREADS"] = str(threads)
    return environment
