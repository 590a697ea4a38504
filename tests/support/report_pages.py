"""Pages of reports as their readers' programs see them: parsed, with their images decoded."""

import base64
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

from PIL import Image

VOID = {"br", "hr", "img", "input", "link", "meta", "source"}

NEEDS_NETWORK = re.compile(r"url\(|@import|https?:|//[a-z]", re.IGNORECASE)
"""What a style or a script would load something with."""


@dataclass
class ParsedPage(HTMLParser):
    """The elements and the text of a page."""

    elements: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    inline: dict[str, str] = field(default_factory=dict)
    """Content of the style and of the script."""
    open: list[str] = field(default_factory=list)

    def __post_init__(self):
        HTMLParser.__init__(self)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, {key: value or "" for key, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes something else"

    def handle_data(self, data):
        if self.open and self.open[-1] in ("style", "script"):
            self.inline[self.open[-1]] = self.inline.get(self.open[-1], "") + data
        else:
            self.texts.append(data)

    @property
    def text(self) -> str:
        """All text, with single spaces."""
        return " ".join(" ".join(self.texts).split())

    def all(self, tag: str, style_class: str = "") -> list[dict[str, str]]:
        """Attributes of the elements of a tag and of a style class."""
        return [
            attributes
            for name, attributes in self.elements
            if name == tag
            and (not style_class or style_class in attributes.get("class", "").split())
        ]

    def images(self) -> list[tuple[str, Image.Image]]:
        """Description and content of every image with an address, decoded."""
        found = []
        for attributes in self.all("img"):
            if source := attributes.get("src"):
                head, _, content = source.partition(",")
                assert head == "data:image/webp;base64"
                image = Image.open(BytesIO(base64.b64decode(content, validate=True)))
                image.load()
                found.append((attributes["alt"], image))
        return found

    def views(self) -> list[str]:
        """Names of the views with images, from top to bottom."""
        ends = ": ground truth"
        return [alt.removesuffix(ends) for alt, _ in self.images() if alt.endswith(ends)]


def parsed(path: Path) -> ParsedPage:
    """A page, all of whose elements are closed and which loads nothing."""
    page = ParsedPage()
    page.feed(path.read_text(encoding="utf-8"))
    page.close()
    assert page.open == []
    for tag, attributes in page.elements:
        for key in ("src", "href", "srcset", "action", "data", "poster", "xlink:href"):
            value = attributes.get(key, "data:")
            assert value.startswith("data:"), f"<{tag} {key}={value[:60]}> leads out of the page"
        assert not any(key.startswith("on") for key in attributes)
        assert not NEEDS_NETWORK.search(attributes.get("style", ""))
    for name, content in page.inline.items():
        assert not NEEDS_NETWORK.search(content), f"the {name} loads something"
    return page
