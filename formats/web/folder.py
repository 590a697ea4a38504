"""WebExporter: a folder for any host of files: the page, its scene, and what embeds it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource, Holds
from gsfw.core.files.atomic import atomic_file, folder_or_nothing, write_atomically
from gsfw.core.words import size
from gsfw.formats.web.page import document, poster, social_image
from gsfw.formats.web.scene_file import scene_file
from gsfw.formats.web.shown import Shown, check_options

SCENE, POSTER, SOCIAL, INDEX = "scene.bin", "poster.webp", "social.png", "index.html"
SOCIAL_SIZE = (1200, 630)
"""Pixels of the image that other sites show beside a link; the usual size for Open Graph."""
IMAGES = f"{POSTER}     shown while the scene loads\n{SOCIAL}      shown where the page is linked\n"


@dataclass(frozen=True)
class WebExporter(Exporter):
    """Writes the page, the scene as a file of its own, preview images, and snippets to embed it."""

    title: str = ""
    """Title of the page. Empty: the name of the scene."""
    background: str = ""
    """Colour behind the splats: white, black, or three numbers. Empty: as in training."""
    sh_degree: int = 4
    """Degree of view dependence above which nothing is written."""
    url: str = ""
    """Address that the folder will have. Sites that show a preview of a link need it."""
    metre: float = 0.0
    """World units that are a metre, for headsets. 0: what the first view looks at is 2 m away."""

    suffix = ""
    is_folder = True
    holds = Holds.MOTION

    def __post_init__(self) -> None:
        check_options(self.background, self.sh_degree, self.metre)
        if self.url and not re.match(r"https?://[^/]", self.url):
            raise ConfigError(
                f"format.url={self.url}: expected an address that begins with https://."
            )

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the folder; the page, which names the other files, comes last.

        An error leaves no new folder.

        Raises:
            OutputError: a file cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        shown = Shown.of(source, self.title, self.background, self.sh_degree, self.metre)
        with folder_or_nothing(path):
            self._write_files(path, shown)

    def _write_files(self, path: Path, shown: Shown) -> None:
        count, digest = _write_scene(path / SCENE, scene_file(shown))
        images = {POSTER: poster(shown.preview), SOCIAL: social_image(shown.preview, SOCIAL_SIZE)}
        images = {name: image for name, image in images.items() if image}
        for name, image in images.items():
            write_atomically(path / name, image)
        said = {
            "title": shown.title,
            "about": shown.about,
            "size": size(count),
            "images": IMAGES if images else "",
        }
        _write_text(path / "README.txt", _filled("README.txt", said))
        quoted = {name: escape(text) for name, text in said.items()}
        _write_text(path / "embed.html", _filled("embed.html", quoted))
        _write_text(path / "gsfw-scene.js", _read("gsfw-scene.js"))
        # Browsers that hold an older scene.bin take the new one: its address is another.
        page = document(
            shown,
            address=f"{SCENE}?v={digest[:12]}",
            head=self._open_graph(shown, bool(images)),
            poster=POSTER if images else "",
        )
        _write_text(path / INDEX, page.before + page.after)

    def _open_graph(self, shown: Shown, has_image: bool) -> str:
        """Elements from which other sites make the preview of a link."""
        place = f"{self.url.rstrip('/')}/" if self.url else ""
        image = {
            "og:image": place + SOCIAL,
            "og:image:width": str(SOCIAL_SIZE[0]),
            "og:image:height": str(SOCIAL_SIZE[1]),
        }
        facts = {
            "og:type": "website",
            "og:title": shown.title,
            "og:description": shown.about,
            **({"og:url": place} if place else {}),
            **(image if has_image else {}),
        }
        named = {"description": shown.about}
        if has_image:
            named["twitter:card"] = "summary_large_image"
        lines = [f'<meta name="{name}" content="{escape(text)}">' for name, text in named.items()]
        lines += [
            f'<meta property="{name}" content="{escape(text)}">' for name, text in facts.items()
        ]
        return "\n".join([*lines, ""])


def _write_scene(path: Path, pieces: Iterable[bytes]) -> tuple[int, str]:
    """Write the scene; return its size and its digest."""
    count, digest = 0, hashlib.sha256()
    with atomic_file(path) as file:
        for piece in pieces:
            file.write(piece)
            digest.update(piece)
            count += len(piece)
    return count, digest.hexdigest()


def _write_text(path: Path, text: str) -> None:
    write_atomically(path, text.encode())


def _read(name: str) -> str:
    return (files("gsfw.formats.web") / "hosting" / name).read_text(encoding="utf-8")


def _filled(name: str, values: dict[str, str]) -> str:
    """A text with its marks replaced, in one pass: a title may look like a mark."""
    return re.sub(r"\{\{(\w+)\}\}", lambda mark: values[mark[1]], _read(name))
