"""Faults of readers: other errors than words, warnings, hangs, memory, and values of no meaning."""

from __future__ import annotations

import ctypes
import gc
import os
import re
import signal
import time
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from gsfw.core.errors import DataError, UserError
from gsfw.core.exchange import Importer, SplatFile, StoredModel
from gsfw.core.splats import Sh
from support.damage import damaged
from support.readers_under_test import Reader

SECONDS = 10.0
"""Longest time of the processor for a small file, whatever else is running; a sound one takes
milliseconds."""
FIXED_BYTES, FACTOR = 32 << 20, 100
"""Most memory of a reader: a constant, and a multiple of the file."""
TRACED = 6
"""Allocations of every sixth file are measured: that takes as long as reading it."""
HEADROOM = 1 << 28
"""Address space that remains for a reader; more is refused by the system. PyTorch's memory, which
nothing traces, counts as well."""
ARENA_MAX = -8
"""The parameter of ``mallopt`` for the number of arenas (glibc, malloc.h)."""
CAN_STOP = hasattr(signal, "SIGPROF")
"""True where the system has an alarm that stops a reader."""
AXIS = re.compile(r"[+-]?[xyz]|")
"""Upward axes that the rest of gsfw knows."""
NOT_FINITE = "it returned values that are not finite, or out of range"


class Hang(BaseException):
    """A reader went on for too long. (No ``Exception``, which a reader may turn into another.)"""


def complaint(kind: type[Importer], path: Path, seconds: float = SECONDS) -> str:
    """What is wrong with how an importer takes a file; empty for splats or a ``DataError``."""

    def read() -> object:
        kind.recognises(path)
        return kind().read(path)

    return fault(read, path.stat().st_size, unsound, DataError, seconds)


def fault(
    read: Callable[[], object],
    size: int,
    check: Callable[[Any], str],
    refusal: type[UserError] = UserError,
    seconds: float = SECONDS,
) -> str:
    """What is wrong with how a reader takes a file; empty for sound content, or for words.

    Args:
        read: reads the file.
        size: of the file, in bytes.
        check: says what is wrong with what was read; empty if nothing is.
        refusal: the error whose words may come instead.
        seconds: of the processor, at most.
    """
    before = time.process_time()
    held = tracemalloc.get_traced_memory()[0]
    if tracemalloc.is_tracing():
        tracemalloc.reset_peak()
    try:
        with _watched(seconds), warnings.catch_warnings():
            warnings.simplefilter("error")
            outcome: object = read()
    except refusal as error:
        outcome = error
    except Hang:
        return f"it goes on for more than {seconds:g} s"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    taken = time.process_time() - before
    if taken > seconds:
        return f"it took {taken:.1f} s"
    peak = tracemalloc.get_traced_memory()[1] - held if tracemalloc.is_tracing() else 0
    if peak > FIXED_BYTES + FACTOR * size:
        return f"it allocated {peak / 1e6:.0f} MB for {size} bytes"
    return _words(outcome) if isinstance(outcome, UserError) else check(outcome)


def _words(error: UserError) -> str:
    return "" if len(error.message) > 10 else f"its message is {error.message!r}"


def unsound(outcome: object) -> str:
    """What is wrong with splats, or with a model, that were read; empty if nothing is."""
    if isinstance(outcome, StoredModel):
        return "" if all(map(_is_finite, outcome.state.values())) else NOT_FINITE
    if not isinstance(outcome, SplatFile):
        return f"it returned {type(outcome).__name__}"
    splats = outcome.splats
    if len(splats) == 0 or splats.quats is None or not isinstance(splats.colors, Sh):
        return "it returned no splats"
    sound = all(map(_is_finite, splats.tensors().values()))
    in_range = bool(((splats.opacities >= 0) & (splats.opacities <= 1)).all())
    if not sound or not in_range:
        return NOT_FINITE
    return "" if AXIS.fullmatch(outcome.up) else f"its upward axis is {outcome.up[:40]!r}"


def _is_finite(tensor: Tensor) -> bool:
    return bool(tensor.isfinite().all())


def complaints(reader: Reader, folder: Path, count: int, first: int = 0) -> list[str]:
    """Complaints about ``count`` damaged files, each with what makes the same file again."""
    found = []
    files = reader.sound
    others = [sound.content for sound in files]
    # Sound files first: what reading loads once is no memory of a damaged file.
    for number, sound in enumerate(files):
        complaint(reader.kind, sound.write(folder, f"sound-{number}"))
    with little_memory():
        for seed in range(first, first + count):
            sound = files[seed % len(files)]
            content = damaged(sound.content, others, seed)
            # A new file each time: writing over an old one waits for the disk.
            path = replace(sound, content=content).write(folder, f"damaged-{seed}")
            # The number of the round: every sound file has a turn.
            with traced() if seed // len(files) % TRACED == 0 else nullcontext():
                wrong = complaint(reader.kind, path)
            path.unlink()
            if wrong:
                found.append(f"{reader.name}: {sound.label}, seed {seed}: {wrong}")
    return found


@contextmanager
def traced() -> Iterator[None]:
    """Measure allocations, of Python and of NumPy."""
    tracemalloc.start(1)
    try:
        yield
    finally:
        tracemalloc.stop()


@contextmanager
def little_memory() -> Iterator[None]:
    """Leave little address space to this process, and one thread: others would need some."""
    try:
        import resource

        gc.collect()  # What is freed later would be room for more.
        used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError):  # No Linux.
        yield
        return
    # Each thread of a reader would get 64 MB of addresses for its allocations.
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).mallopt(ARENA_MAX, 1)
    before, threads = resource.getrlimit(resource.RLIMIT_AS), torch.get_num_threads()
    torch.set_num_threads(1)
    resource.setrlimit(resource.RLIMIT_AS, (used + HEADROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
        torch.set_num_threads(threads)


@contextmanager
def _watched(seconds: float) -> Iterator[None]:
    """Raise ``Hang`` in the code inside if it goes on for too long, where the system can."""
    if not CAN_STOP:
        yield
        return

    def stop(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
