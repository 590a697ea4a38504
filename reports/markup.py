"""Markup: HTML in which every plain string is escaped, because only ``Markup`` is trusted."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Mapping
from typing import TypeAlias

from PIL import Image

VOID = frozenset({"br", "hr", "img", "input", "link", "meta", "source"})
"""Elements without content and without a closing tag."""


LONGEST = 3_000
"""Most characters of a text; a longer one is cut, so that no file makes a page large."""


class Markup(str):
    """Text that is HTML already; made by ``element``, ``join`` and for constants of this folder."""

    __slots__ = ()


Child: TypeAlias = "Markup | str | int | Iterable[Child]"
"""Content of an element; strings that are no ``Markup`` are escaped."""

NOTHING = Markup("")


def element(name: str, content: Child = (), attributes: Mapping[str, object] = {}) -> Markup:
    """One element.

    Args:
        name: name of the tag.
        content: its children.
        attributes: values by name; ``None`` and False leave an attribute out, True has no value.
    """
    written = "".join(
        f" {key}" if value is True else f' {key}="{html.escape(str(value))}"'
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    if name in VOID:
        return Markup(f"<{name}{written}>")
    return Markup(f"<{name}{written}>{join(content)}</{name}>")


def join(content: Child) -> Markup:
    """Children one after another; strings that are no ``Markup`` are escaped."""
    if isinstance(content, Markup):
        return content
    if isinstance(content, str | int):
        text = str(content)
        shown = text if len(text) <= LONGEST else f"{text[:LONGEST]} ... ({len(text):,} characters)"
        return Markup(html.escape(shown))
    return Markup("".join(join(child) for child in content))


def div(style_class: str, content: Child = ()) -> Markup:
    """A block of a style class."""
    return element("div", content, {"class": style_class})


def span(style_class: str, content: Child = ()) -> Markup:
    """A piece of text of a style class."""
    return element("span", content, {"class": style_class})


def section(anchor: str, title: str, content: Child, lead: Child = ()) -> Markup:
    """A section of the page with its heading; ``lead`` is a line below the heading."""
    head = [element("h2", title)]
    if lead:
        head.append(element("p", lead, {"class": "lead"}))
    return element("section", [*head, content], {"id": anchor})


def folded(summary: Child, content: Child) -> Markup:
    """Content that a click on its summary shows."""
    return element("details", [element("summary", summary), content])


def note(text: str) -> Markup:
    """A paragraph; a command that ends it, after a colon, is code that can be copied."""
    words, colon, command = text.rpartition(": gsfw ")
    if not colon:
        return element("p", text)
    return element("p", [f"{words}: ", element("code", f"gsfw {command}")])


def bullet_list(items: Iterable[Child]) -> Markup:
    """A list of sentences."""
    return element("ul", [element("li", item) for item in items], {"class": "plain"})


def table(head: Iterable[Child], rows: Iterable[Iterable[Child]], style_class: str = "") -> Markup:
    """A table; the first column holds names, all others figures unless the style says so."""
    titles = element("tr", [element("th", title, {"scope": "col"}) for title in head])
    body = [element("tr", [element("td", cell) for cell in row]) for row in rows]
    content = [element("thead", titles), element("tbody", body)]
    return div("wide", element("table", content, {"class": style_class or None}))


def webp_uri(content: bytes) -> str:
    """A WebP image as an address that holds it."""
    return f"data:image/webp;base64,{base64.b64encode(content).decode('ascii')}"


def aspect(content: bytes) -> float:
    """Width over height of an image."""
    with Image.open(io.BytesIO(content)) as image:
        return image.width / image.height
