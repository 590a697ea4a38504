"""Page limit: as many images as fit into the stated size of a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

from gsfw.core.words import size
from gsfw.reports.pictures import Pictures

MOST_BYTES = 4_000_000
"""Size that no page with images is above. Texts, rows and points are bounded by themselves."""

Shown: TypeAlias = "Sequence[Pictures | None]"
"""Images of each run of a page; ``None`` if it has none."""


def within_limit(build: Callable[[Shown, str], str], pictures: Shown) -> str:
    """The page with the most images that fit.

    Args:
        build: makes the page from images and a sentence on what is left out, which may be empty.
        pictures: images of each run.
    """
    page = ""
    for fewer, what in _ever_fewer(pictures):
        left_out = f"Left out, to stay below {size(MOST_BYTES)}: {what}." if what else ""
        page = build(fewer, left_out)
        if len(page.encode()) <= MOST_BYTES:
            break
    return page


def _ever_fewer(pictures: Shown) -> Iterator[tuple[Shown, str]]:
    """Images, and what of them is left out: the films, then the last views, then the stills."""
    yield pictures, ""
    found = _each(pictures, orbit=b"")
    said = ["the film"] if any(one is not None and one.orbit for one in pictures) else []
    if said:
        yield found, said[0]
    most = max((len(one.views) for one in found if one is not None), default=0)
    for left in reversed(range(most)):
        fewer = [None if one is None else replace(one, views=one.views[:left]) for one in found]
        count = most - left
        views = f"images of {count} view{'s' if count > 1 else ''}"
        yield fewer, " and ".join([*said, views])
    yield _each(pictures, orbit=b"", views=(), still=b""), "all images"


def _each(pictures: Shown, **changes: object) -> list[Pictures | None]:
    return [None if one is None else replace(one, **changes) for one in pictures]  # type: ignore[arg-type]
