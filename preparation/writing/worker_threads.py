"""Worker threads that work on several images at a time, within memory that does not grow."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from gsfw.core.machine_memory import free_memory
from gsfw.datamanagers.images import Header

Item = TypeVar("Item")
Result = TypeVar("Result")

MEMORY = 2_000_000_000
"""Bytes that all images that are worked on may take, if there are as many."""
BYTES_PER_PIXEL = {False: 25, True: 38}
"""Peak memory of undistorting at 12 megapixels, with the decoded image: without and with alpha."""


def workers_for(headers: Iterable[Header], jobs: int) -> int:
    """Number of images to process at a time, at most ``jobs``; the largest image decides."""
    sizes = (image.width * image.height * BYTES_PER_PIXEL[image.has_alpha] for image in headers)
    return max(1, min(jobs, int(min(MEMORY, free_memory()) // max(sizes))))


def in_order(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int
) -> Generator[Result, None, None]:
    """Results in the order of the items, of which no more than needed are taken at a time.

    Closing it waits for what is being worked on, and drops the rest.

    Raises:
        Exception: whatever the work raises, at the place of its result.
    """
    threads = ThreadPoolExecutor(workers)
    waiting: deque[Future[Result]] = deque()
    try:
        for item in items:
            waiting.append(threads.submit(work, item))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        threads.shutdown(wait=True, cancel_futures=True)
