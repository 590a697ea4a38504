"""XML files of other programs: parsed without document types, whose entities could be anything."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from gsfw.core.errors import DataError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

DEEPEST = 100
"""Most elements within each other; files of cameras have fewer than ten."""


class _Builder(ElementTree.TreeBuilder):
    """Builds a tree of limited depth, and refuses a document type.

    A document type declares entities: a few of them within each other stand for gigabytes.
    """

    depth = 0

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise ValueError("it declares a document type, which files of cameras do not")

    def start(self, tag: str, attributes: dict[str, str]) -> Element:
        self.depth += 1
        if self.depth > DEEPEST:
            raise ValueError(f"it is nested more than {DEEPEST} levels deep")
        return super().start(tag, attributes)

    def end(self, tag: str) -> Element:
        self.depth -= 1
        return super().end(tag)


def read_xml(file: Path, advice: str) -> Element:
    """The outermost element of a file.

    Args:
        file: the file.
        advice: how to write it anew, as a sentence.

    Raises:
        DataError: it is no XML.
    """
    try:
        parser = ElementTree.XMLParser(target=_Builder())
        parser.feed(file.read_bytes())
        root: Element = parser.close()
    # LookupError and ValueError are those of encodings that do not exist, or that expat lacks.
    except (OSError, ValueError, LookupError, ElementTree.ParseError) as error:
        raise DataError(f"{file} cannot be read as XML: {error}", advice) from error
    return root
