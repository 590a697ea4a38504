"""Moved job: a job whose folder is at another path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from gsfw.jobs.job import Call, Job


def moved(job: Job, folder: Path) -> Job:
    """The job with another folder, also in its arguments."""
    if job.folder is None:
        return job
    before = job.folder
    return replace(
        job,
        work=_work(job.work, before, folder),
        folder=folder,
        resume=tuple(_argument(word, before, folder) for word in job.resume),
        result=None if job.result is None else _path(job.result, before, folder),
    )


def _work(work: tuple[str, ...] | Call, before: Path, now: Path) -> tuple[str, ...] | Call:
    if isinstance(work, Call):
        arguments = tuple(_path(item, before, now) for item in work.arguments)
        return Call(work.function, arguments)
    return tuple(_argument(word, before, now) for word in work)


def _argument(word: str, before: Path, now: Path) -> str:
    """An argument, or a value after its key, that is a path in the folder."""
    key, equals, value = word.rpartition("=")
    path = Path(value)
    return f"{key}{equals}{_path(path, before, now)}" if path.is_relative_to(before) else word


def _path(item: Any, before: Path, now: Path) -> Any:  # noqa: ANN401 - any argument of a call
    if isinstance(item, Path) and item.is_relative_to(before):
        return now / item.relative_to(before)
    return item
