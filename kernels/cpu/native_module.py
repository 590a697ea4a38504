"""The native CPU module: whether it is there, and which instruction set it uses."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import ModuleType
from typing import Any

import torch

from gsfw.core.errors import ConfigError

NOT_BUILT = (
    "the native CPU module was not built: a working C++ compiler (GCC or Clang) or the headers of "
    "Python were missing at installation. Install both (Debian: apt install g++ python3-dev; "
    "macOS: xcode-select --install), then: pip install --force-reinstall --no-deps ."
)

_last_words: list[tuple[str, str, int]] = []
"""The messages of the blocks of ``last_words`` around this one."""
FORCED = "GSFW_CPU_ISA"
"""Environment variable that forces an instruction set."""


@lru_cache(maxsize=1)
def native() -> ModuleType | None:
    """The module, set to the instruction set that is wanted; ``None`` when it cannot be used.

    Raises:
        ConfigError: ``GSFW_CPU_ISA`` names a set that this machine cannot run.
    """
    if unavailable():
        return None
    from gsfw.kernels.cpu import _native

    wanted = os.environ.get(FORCED, "")
    if wanted and not _native.use_instruction_set(wanted):
        raise ConfigError(
            f"{FORCED}={wanted}: expected one of the instruction sets that this machine runs: "
            f"{', '.join(_native.instruction_sets())}.",
            f"Unset {FORCED} to use the best one.",
        )
    return _native


def required() -> Any:  # noqa: ANN401 - the module's stub is for its own users
    """The module, for code that is chosen only where it can be used."""
    module = native()
    assert module is not None, "these operators are chosen only where the module is there"
    return module


def native_class(name: str, dtype: torch.dtype) -> Any:  # noqa: ANN401
    """The class of the module for numbers of a type, float32 or float64."""
    return getattr(required(), f"{name}Float{8 * dtype.itemsize}")


@lru_cache(maxsize=1)
def unavailable() -> str:
    """The reason why the module cannot be used; empty if it can."""
    try:
        import gsfw.kernels.cpu._native  # noqa: F401 - whether it loads is the question.
    except ModuleNotFoundError:
        return NOT_BUILT
    except ImportError as error:
        return f"the native CPU module was built, but does not load: {error}"
    return ""


def instruction_sets() -> list[str]:
    """Instruction sets this machine can run, the best first; empty when the module is not built."""
    module = native()
    return [] if module is None else module.instruction_sets()


def instruction_set() -> str:
    """The one that is used; empty when the module is not built."""
    module = native()
    return "" if module is None else module.instruction_set()


def keep_freed_memory() -> None:
    """Let this process's allocator keep what is freed, for programs that train.

    Gradients above 32 MB would otherwise come as fresh pages in every step: with 200,000 splats,
    allocating and filling those of the spherical harmonics took 15 ms instead of 1 ms. It concerns
    the whole process, which is why a library does not do it unasked.
    """
    module = native()
    if module is not None:
        module.keep_freed_memory()


@contextmanager
def last_words(cause: str, advice: str, exit_code: int) -> Iterator[None]:
    """Within the block, a library that aborts the process ends it with a message.

    Without the native module, and on Windows, it aborts as libraries do. The message is that of
    the innermost block, whichever thread aborts.

    Args:
        cause: one line, without a full stop; what an exception says comes after it.
        advice: further lines.
        exit_code: of the process.
    """
    module = native()
    if module is None:
        yield
        return
    _last_words.append((cause, advice, exit_code))
    module.set_last_words(*_last_words[-1])
    try:
        yield
    finally:
        _last_words.pop()
        if _last_words:
            module.set_last_words(*_last_words[-1])
        else:
            module.clear_last_words()


def release_render_memory() -> None:
    """Free the memory that kernels keep from one render to the next, as after the last one."""
    module = native()
    if module is not None:
        module.release_render_memory()
