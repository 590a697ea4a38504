"""Page: the skeleton of a report; all it needs is within it, and it cannot reach a network."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from gsfw.core.words import size
from gsfw.plugins.specs import PROJECT
from gsfw.reports.markup import NOTHING, Child, Markup, div, element

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""Content security policy: a browser loads nothing for the page, whatever its texts hold."""

_SIZE = Markup("<!--size-->")
"""Place of the page's size; no escaped text looks like it."""

_HOME = Path(__file__).parent


def write_page(title: str, body: Child, left_out: str = "") -> str:
    """A whole page.

    Args:
        title: title in the browser.
        body: its sections.
        left_out: images that are left out to keep the page small, as a sentence; may be empty.
    """
    head = [
        element("meta", (), {"charset": "utf-8"}),
        element("meta", (), {"http-equiv": "Content-Security-Policy", "content": POLICY}),
        element("meta", (), {"name": "viewport", "content": "width=device-width, initial-scale=1"}),
        element("meta", (), {"name": "referrer", "content": "no-referrer"}),
        element("title", title),
        element("style", Markup((_HOME / "page.css").read_text(encoding="utf-8"))),
    ]
    script = element("script", Markup((_HOME / "page.js").read_text(encoding="utf-8")))
    footer = element(
        "footer",
        [
            f"Made by gsfw {metadata.version(PROJECT)}. This file of ",
            _SIZE,
            " holds all it shows and loads nothing. ",
            left_out,
        ],
    )
    content = [element("head", head), element("body", [body, footer, _dialog(), script])]
    text = f"<!doctype html>\n{element('html', content, {'lang': 'en'})}\n"
    text = text.encode(errors="replace").decode()  # Names of files may not be UTF-8.
    return text.replace(_SIZE, size(len(text.encode())), 1)


def _dialog() -> Markup:
    """The dialog that shows images of views large."""
    image = element("img", NOTHING, {"alt": ""})
    return element("dialog", [image, div("choices"), div("named")], {"aria-label": "view, large"})
