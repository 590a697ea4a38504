"""HtmlExporter: one page that holds its scene, and opens from disk without a network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.exchange import Exporter, ExportSource, Holds
from gsfw.core.files.atomic import atomic_file
from gsfw.formats.web.page import document, image_address, poster
from gsfw.formats.web.scene_file import scene_file
from gsfw.formats.web.shown import Shown, check_options

PIECE = 3 << 19
"""Bytes of a piece of the scene, a multiple of 3, so that base64 needs no padding: 2 MB as text."""


@dataclass(frozen=True)
class HtmlExporter(Exporter):
    """Writes one page: the player, the poster, and the scene in base64."""

    title: str = ""
    """Title of the page. Empty: the name of the scene."""
    background: str = ""
    """Colour behind the splats: white, black, or three numbers. Empty: as in training."""
    sh_degree: int = 4
    """Degree of view dependence above which nothing is written."""
    metre: float = 0.0
    """World units that are a metre, for headsets. 0: what the first view looks at is 2 m away."""

    suffix = ".html"
    holds = Holds.MOTION

    def __post_init__(self) -> None:
        check_options(self.background, self.sh_degree, self.metre)

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the page atomically, piece by piece.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        shown = Shown.of(source, self.title, self.background, self.sh_degree, self.metre)
        scene = scene_file(shown)
        page = document(shown, poster=image_address(poster(shown.preview)))
        with atomic_file(path) as file:
            file.write(page.before.encode())
            for piece in _pieces(scene):
                text = base64.b64encode(piece)
                file.write(b'<script class="scene" type="application/octet-stream">')
                file.write(text + b"</script>\n")
            file.write(page.after.encode())


def _pieces(parts: Iterable[bytes]) -> Iterator[bytes]:
    """The same bytes in pieces of equal length; the last one may be shorter."""
    waiting = bytearray()
    for part in parts:
        waiting += part
        while len(waiting) >= PIECE:
            yield bytes(waiting[:PIECE])
            del waiting[:PIECE]
    if waiting:
        yield bytes(waiting)
