"""Program: the text that the compiler is given for a kernel."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable

NAMESPACE = "gsfw::cuda"
"""C++ namespace of kernels, jobs, and the types that kernels are made for."""

OFFSET = "__INTADDR__(&(({job}*)0)->{field})"
"""An expression for offsetof in every NVRTC; version 12.4 does not know __builtin_offsetof."""


def program_text(source: str, jobs: Iterable[type[ctypes.Structure]]) -> str:
    """A source file, and the assertion that each job's mirror in Python looks like the job.

    A structure in Python that drifts from its original thus fails to compile, where otherwise the
    kernel would read whatever bytes it finds.
    """
    lines = [f'#include "{source}"', f"using namespace {NAMESPACE};"]
    for job in _with_members(jobs):
        name = f"{NAMESPACE}::{job.__name__}"
        lines.append(_check(f"sizeof({name})", ctypes.sizeof(job), f"size of {job.__name__}"))
        for field, *_ in job._fields_:
            where = f"place of {job.__name__}.{field}"
            offset = OFFSET.format(job=name, field=field)
            lines.append(_check(offset, getattr(job, field).offset, where))
    return "\n".join(lines) + "\n"


def _with_members(jobs: Iterable[type[ctypes.Structure]]) -> list[type[ctypes.Structure]]:
    """The structures, and those that they are made of, each once."""
    found: dict[type[ctypes.Structure], None] = {}
    for job in jobs:
        kinds = [kind for _, kind, *_ in job._fields_]
        members = [kind for kind in kinds if issubclass(kind, ctypes.Structure)]
        found.update(dict.fromkeys([*_with_members(members), job]))
    return list(found)


def _check(value: str, expected: int, what: str) -> str:
    return f'static_assert({value} == {expected}, "the {what} differs from its mirror in Python");'
