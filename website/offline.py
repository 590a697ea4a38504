"""Addresses in a built site: what a page loads from elsewhere, and where its links lead."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

_LOADS = (
    re.compile(
        r"<(?:script|img|iframe|source|video|audio|embed|object)\b[^>]*?"
        r"\b(?:src|data|poster)=[\"']((?:https?:)?//[^\"']+)"
    ),
    re.compile(r"<link\b(?![^>]*rel=[\"']canonical)[^>]*?\bhref=[\"']((?:https?:)?//[^\"']+)"),
    re.compile(r"url\(\s*[\"']?((?:https?:)?//[^\"')]+)"),
    re.compile(r"@import\s+[\"']((?:https?:)?//[^\"']+)"),
)
_LINK = re.compile(r"<a\b[^>]*?\bhref=[\"'](https?://[^\"'#]+)")


def foreign_loads(site: Path) -> Iterator[str]:
    """Each address that a page or a style sheet would load from elsewhere, with its file."""
    for path in sorted([*site.rglob("*.html"), *site.rglob("*.css")]):
        text = path.read_text(encoding="utf-8")
        for pattern in _LOADS:
            for address in pattern.findall(text):
                yield f"{path.relative_to(site)} loads {address}"


def external_links(site: Path) -> list[str]:
    """All addresses outside of the site that pages link to, sorted. Nothing follows them."""
    pages = (path.read_text(encoding="utf-8") for path in site.rglob("*.html"))
    return sorted({address for text in pages for address in _LINK.findall(text)})
