"""Links and anchors of pages in Markdown."""

from __future__ import annotations

import re

_LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ +(.*?) *$", re.MULTILINE)
_FENCE = re.compile(r"^( *)(```+).*?^\1\2", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]*`")


def links(text: str) -> list[str]:
    """The targets of all links and images, those in code left out."""
    return _LINK.findall(_CODE.sub("code", _FENCE.sub("", text)))


def is_external(link: str) -> bool:
    """True for an address of a web page or of mail."""
    return "://" in link or link.startswith("mailto:")


def anchors(text: str) -> set[str]:
    """The anchors of headings, as GitHub and the site spell them."""
    found: set[str] = set()
    for heading in _HEADING.findall(_FENCE.sub("", text)):
        shown = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")
        numbers = (f"{name}-{number}" for number in range(1, 1000))
        found.add(name if name not in found else next(n for n in numbers if n not in found))
    return found
