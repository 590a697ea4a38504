"""Forked commands: gsfw commands in forks of a process that has loaded all, with a fault each.

They start in milliseconds, and may get signals, or end by SIGKILL.
``Server`` starts this module as a program, with the library of file faults in LD_PRELOAD.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import types
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from file_faults import Fault, Kind, library, mark

PR_SET_CHILD_SUBREAPER = 36
"""Linux's option of ``prctl``: orphans of descendants become children of the process."""
POLL_SECONDS = 0.002
NO_FAULT = Fault()
OTHERS = (
    *("gsfw.commands.blocks", "gsfw.commands.prepare", "gsfw.commands.study", "gsfw.jobs.process"),
    *("gsfw.methods.spacetime.method", "gsfw.parallel.sharded.team"),
    "torch.fx.experimental.symbolic_shapes",  # With SymPy: a second.
)
"""Modules that forks load beside those of a small training."""


@dataclass(frozen=True)
class Command:
    """A gsfw command, and what happens to it."""

    words: tuple[str, ...]
    """Arguments of ``gsfw``."""
    folder: str
    """Folder whose files have the fault; absolute."""
    fault: Fault = NO_FAULT
    signals: tuple[tuple[float, int], ...] = ()
    """Seconds after the start, and signal. SIGKILL ends the process and all that it started."""
    log: str = ""
    """File for the record of all operations; empty for none."""
    is_forked: bool = True
    """True if the runs of a study are forks; false for processes of their own."""
    orphans_end: bool = True
    """True if processes that outlive the command are killed; false if they are waited for."""
    seconds: float = 120.0
    """Time after which it counts as hung and is killed."""


@dataclass(frozen=True)
class Ended:
    """The end of a command."""

    code: int
    """Exit code; negative: ended by that signal."""
    seconds: float
    said: str
    """Standard output."""
    complained: str
    """Standard error."""
    calls: int
    """Calls on files below the folder that the fault counts."""
    hung: bool = False

    @property
    def error(self) -> str:
        """The lines from ``error:`` on; empty if there are none."""
        _, found, after = f"\n{self.complained}".rpartition("\nerror: ")
        return f"error: {after}" if found else ""


class Server:
    """Makes forks of a process that has loaded gsfw; one command at a time."""

    def __init__(self, folder: Path) -> None:
        """Start it.

        Args:
            folder: for its own files, and the current folder of the commands.
        """
        folder.mkdir(parents=True, exist_ok=True)
        environment = {
            **os.environ,
            "LD_PRELOAD": str(library()),
            "OMP_NUM_THREADS": "1",
            "GSFW_STATE_DIR": "none",
            "PYTHONPATH": str(Path(__file__).parent),
        }
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [sys.executable, "-m", "forked_commands", str(folder)],
            stdin=pipe, stdout=pipe, text=True, env=environment, cwd=folder,
        )  # fmt: skip
        self._answer()

    def run(self, command: Command) -> Ended:
        """Run a command to its end."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(asdict(command)) + "\n")
        self._process.stdin.flush()
        return Ended(**json.loads(self._answer()))

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the server of commands has ended: {self._process.wait()}")
        return line

    def close(self) -> None:
        """End it."""
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()
        self._process.wait(30)

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class ForkedProcess:
    """A process of ``python -m gsfw``, as ``subprocess.Popen`` would start it, as a fork."""

    def __init__(self, words: Sequence[str], **settings: object) -> None:
        arguments, environment = list(words)[3:], settings["env"]
        assert isinstance(environment, dict)
        self.returncode: int | None = None
        self.stdin = None
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            os.environ.update(environment)
            for number, name in ((1, "stdout"), (2, "stderr")):
                os.dup2(settings[name].fileno(), number)  # type: ignore[attr-defined]
            _become(arguments)

    def poll(self) -> int | None:
        """Exit code; ``None`` while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float = 600.0) -> int:
        """Wait for its end."""
        until = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired(["gsfw"], timeout)
            time.sleep(POLL_SECONDS)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


def _become(words: Sequence[str]) -> None:
    """Be a gsfw command in a session of its own, in a fork; never returns."""
    code = 1
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        from gsfw.commands.main import main

        code = main(words)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        sys.excepthook(*sys.exc_info())  # type: ignore[arg-type]
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _child(command: Command, place: Path) -> None:
    """Be the command, in a fork of the server."""
    for number, name in ((1, "said"), (2, "complained")):
        handle = os.open(place / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(handle, number)
        os.close(handle)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - for the whole process
    sys.stderr = open(2, "w", closefd=False, buffering=1)  # noqa: SIM115
    import gsfw.jobs.process
    from gsfw.core.loop.run_folder import RunFolder

    if command.is_forked:
        known = subprocess
        gsfw.jobs.process.subprocess = types.SimpleNamespace(  # type: ignore[assignment]
            Popen=ForkedProcess, PIPE=known.PIPE, DEVNULL=known.DEVNULL,
            TimeoutExpired=known.TimeoutExpired,
        )  # fmt: skip
    write = RunFolder.write_checkpoint

    def reported(folder: RunFolder, step: int, *rest: object) -> Path:
        path = write(folder, step, *rest)  # type: ignore[arg-type]
        mark(f"checkpoint {step}")
        return path

    RunFolder.write_checkpoint = reported  # type: ignore[assignment,method-assign]
    folder, counter = Path(command.folder), place / "calls"
    os.environ.update(command.fault.environment(folder, counter))
    command.fault.begin(folder, counter, Path(command.log) if command.log else None)
    _become(command.words)


def _descendants(pid: int) -> list[int]:
    """All processes that a process has started, and those that they have."""
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, IndexError):
            if int(path.read_text().rpartition(")")[2].split()[1]) == pid:
                child = int(path.parent.name)
                found += [child, *_descendants(child)]
    return found


def _end_all(pids: Sequence[int]) -> None:
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _served(command: Command, place: Path) -> Ended:
    """Run a command, with its signals."""
    (place / "calls").write_bytes(bytes(16))
    start = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _child(command, place)
    signals = sorted(command.signals)
    code, hung = None, False
    while code is None:
        passed = time.monotonic() - start
        while signals and passed >= signals[0][0]:
            number = signals.pop(0)[1]
            _end_all([*_descendants(pid), pid]) if number == signal.SIGKILL else os.kill(
                pid, number
            )
        if passed > command.seconds:
            hung = True
            _end_all([*_descendants(pid), pid])
        found, status = os.waitpid(pid, os.WNOHANG)
        code = os.waitstatus_to_exitcode(status) if found else None
        time.sleep(POLL_SECONDS)
    seconds = time.monotonic() - start
    if command.orphans_end:
        _end_all(_descendants(os.getpid()))
    with suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)
    calls = int.from_bytes((place / "calls").read_bytes()[:8], "little")
    texts = [(place / name).read_text(errors="replace") for name in ("said", "complained")]
    return Ended(code, seconds, texts[0], texts[1], calls, hung)


def modules_of_commands(place: Path) -> list[str]:
    """Names of all modules that a training and an export use, as found by them in a fork.

    Args:
        place: a folder for their files.

    Raises:
        RuntimeError: one of them failed.
    """
    names, said = place / "modules", place / "said"
    pid = os.fork()
    if pid == 0:
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT, 0o600), 1)
        os.dup2(1, 2)
        from gsfw.commands.main import main

        run, view = str(place / "warm"), ("datamanager.width=16", "datamanager.height=12")
        size = (*view, "datamanager.views=3", "datamanager.points=20", "steps=2", "device=cpu")
        code = main(["train", "method=3dgs", *size, f"out={run}"])
        code = code or main(["export", run, f"out={run}/a.gsfw", "format=gsfw"])
        names.write_text("\n".join(sys.modules))
        os._exit(code)
    if os.waitpid(pid, 0)[1]:
        raise RuntimeError(f"a training that finds modules to load failed: {said.read_text()}")
    return [*names.read_text().split(), *OTHERS]


def load(modules: Sequence[str]) -> None:
    """Load modules, but for those that only a command itself can."""
    for name in modules:
        with suppress(Exception):
            importlib.import_module(name)


def main(folder: Path) -> int:
    """Serve commands from standard input until it ends."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # Nothing else may be between the answers.
    place = Path(tempfile.mkdtemp(dir=folder, prefix="server-"))
    gc.disable()
    load(modules_of_commands(place))
    gc.freeze()  # Collections of forks pass over the modules, and leave their memory shared.
    gc.enable()
    answers.write("ready\n")
    for line in sys.stdin:
        values = json.loads(line)
        fault = Fault(**values.pop("fault"))
        fault = replace(fault, kind=Kind(fault.kind))
        signals = tuple((float(when), int(number)) for when, number in values.pop("signals"))
        words = tuple(values.pop("words"))
        ended = _served(Command(words=words, fault=fault, signals=signals, **values), place)
        answers.write(json.dumps(asdict(ended)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
