"""Page: the player as one HTML document that asks no other machine for anything."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from importlib.resources import files

from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from gsfw.core.color_bytes import color_bytes
from gsfw.core.exchange import Preview
from gsfw.formats.web.shown import Shown

SHARED = ("layout.js", "geometry.js")
WORKER = (*SHARED, "decoder.js", "sorter.js", "worker.js")
"""Scripts of the worker, which decodes and sorts."""
PLAYER = (
    *(*SHARED, "camera.js", "renderer.js", "controls.js", "scene.js"),
    *("stage.js", "headset.js", "page.js", "pieces.js", "main.js"),
)
"""Scripts of the page."""
POSTER_SIDE = 1280
"""Longest side of the poster, in pixels."""
BRIGHT = 1.5
"""Sum of a background's channels above which dark text is put on it."""
POSTER_QUALITY = 82
"""WebP quality of the poster; it is seen for seconds."""


@dataclass(frozen=True)
class Document:
    """A page around the place of its scene."""

    before: str
    """Everything before the pieces of the scene."""
    after: str
    """Everything after them."""


def document(shown: Shown, address: str = "", head: str = "", poster: str = "") -> Document:
    """The page of a scene.

    Args:
        shown: the scene.
        address: of the scene file beside the page; empty if the page itself holds the scene.
        head: further elements of the head, as HTML.
        poster: address of the poster; empty for none.
    """
    script, style = _script(address), _style(shown.background)
    reach = "connect-src 'self'; img-src 'self' data:" if address else "img-src data:"
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; "
        f"worker-src blob:; {reach}; base-uri 'none'; form-action 'none'"
    )
    # The script comes before the scene: it decodes the pieces while the next ones arrive.
    values = {
        "policy": policy,
        "version": version("gsfw"),
        "title": escape(shown.title),
        "head": f"{head}<style>{style}</style>",
        "tone": " bright" if sum(shown.background) > BRIGHT else "",
        "poster": f'<img id="poster" alt="" src="{escape(poster)}">' if poster else "",
        "about": escape(shown.about),
    }
    before, after = _read("index.html").split("{{scene}}")
    # In one pass: a title may look like a mark.
    before = re.sub(r"\{\{(\w+)\}\}", lambda mark: values[mark[1]], before)
    return Document(f"{before}<script>{script}</script>\n", after)


def _script(address: str) -> str:
    """The script of the page, with its shaders and the source of its worker as texts."""
    texts = {
        "SPLAT_VERT": _read("splat.vert"),
        "SPLAT_FRAG": _read("splat.frag"),
        "WORKER_SOURCE": "\n".join(map(_read, WORKER)),
        "SCENE_ADDRESS": address,
    }
    named = [f"const {name} = {_quoted(text)};" for name, text in texts.items()]
    return "\n".join(['"use strict";', *named, *map(_read, PLAYER)])


def _style(background: tuple[float, float, float]) -> str:
    """The style of the page; the colour behind the scene is there before the scene."""
    color = " ".join(str(round(255 * min(max(value, 0.0), 1.0))) for value in background)
    return f"{_read('style.css')}body {{ background: rgb({color}); }}\n"


def _quoted(text: str) -> str:
    """A text in JavaScript; it cannot end the element that it is in."""
    return json.dumps(text).replace("<", "\\u003c")


def _read(name: str) -> str:
    return (files("gsfw.formats.web") / "player" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """An inline element as policies name it."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def poster(preview: Preview | None) -> bytes:
    """The image of the first view as WebP; empty if there is none."""
    if preview is None or preview.image is None:
        return b""
    picture = Image.fromarray(_pixels(preview.image).numpy())
    picture.thumbnail((POSTER_SIDE, POSTER_SIDE))
    buffer = io.BytesIO()
    picture.save(buffer, "WEBP", quality=POSTER_QUALITY)
    return buffer.getvalue()


def social_image(preview: Preview | None, size: tuple[int, int]) -> bytes:
    """The image of the first view as PNG of some size, cropped; empty if there is none."""
    if preview is None or preview.image is None:
        return b""
    picture = Image.fromarray(_pixels(preview.image).numpy())
    scale = max(size[0] / picture.width, size[1] / picture.height)
    picture = picture.resize(
        (max(size[0], round(picture.width * scale)), max(size[1], round(picture.height * scale))),
        Image.Resampling.LANCZOS,
    )
    left, top = (picture.width - size[0]) // 2, (picture.height - size[1]) // 2
    buffer = io.BytesIO()
    picture.crop((left, top, left + size[0], top + size[1])).save(buffer, "PNG")
    return buffer.getvalue()


def image_address(content: bytes) -> str:
    """A WebP image as an address that holds it; empty for no image."""
    return f"data:image/webp;base64,{base64.b64encode(content).decode()}" if content else ""


def _pixels(image: Float[Tensor, "h w 3"]) -> UInt8[Tensor, "h w 3"]:
    return color_bytes(image.detach().float().nan_to_num()).cpu().contiguous()
