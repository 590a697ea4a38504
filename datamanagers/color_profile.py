"""Colour profiles: photos in other colour spaces become sRGB, the space of all output.

Phones embed a profile in their photos. Numbers of Display P3 that are taken for sRGB look pale.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import product

import numpy as np
from PIL import Image, ImageCms

from gsfw.core.words import listed
from gsfw.datamanagers.adobe_rgb import adobe_rgb, is_adobe_rgb
from gsfw.datamanagers.coded_colors import HDR

LIKE_SRGB = 2
"""Largest deviation from sRGB, of 255, of profiles whose numbers stay as they are."""
PROBES = np.array([*product(range(0, 256, 51), repeat=3)], np.uint8)[None]
"""Colours at which a profile is compared with sRGB."""
SPACES = {"GRAY": ("1", "L", "LA"), "CMYK": ("CMYK",)}
"""Modes of images that profiles of a space describe, other than RGB."""
GAMMAS = (0.4, 0.6)
"""Values of PNG's gAMA that are taken for sRGB, whose is 0.45; ffmpeg writes 0.51 for video."""
PRIMARIES = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
"""Chromaticities x, y of white, red, green and blue in sRGB (IEC 61966-2-1), as PNG's cHRM."""
LIKE_PRIMARIES = 0.02
"""Largest deviation of primaries that are taken for those of sRGB; old television has 0.01."""


def profile_of(image: Image.Image) -> bytes | None:
    """The profile to convert an image by; ``None`` if there is none that fits its pixels."""
    profile = image.info.get("icc_profile")
    # Pillow gives whatever a TIFF has under the tag of the profile.
    if isinstance(profile, bytes):
        return profile if _fits(profile, image.mode) else None
    return adobe_rgb() if image.mode in ("RGB", "RGBA") and is_adobe_rgb(image) else None


def unconverted(image: Image.Image) -> str:
    """The colour space of an image that is not converted to sRGB; empty where there is none."""
    profile = image.info.get("icc_profile")
    if isinstance(profile, bytes):
        return "" if _fits(profile, image.mode) else "a colour profile that cannot be applied"
    if image.mode == "CMYK":
        return "CMYK without a colour profile"
    return _unconverted_png(image) if image.format == "PNG" else ""


def _unconverted_png(image: Image.Image) -> str:
    """The colour space of a PNG by its chunks other than a profile, where it is not sRGB."""
    transfer = _transfer_of_png(image)
    if transfer in HDR:
        return f"HDR ({HDR[transfer]})"
    if "srgb" in image.info:
        return ""
    gamma = image.info.get("gamma", 0.5)
    if not GAMMAS[0] < gamma < GAMMAS[1]:
        return f"a gamma of {gamma:g}"
    found = image.info.get("chromaticity", PRIMARIES)
    # Pillow 11 gives as many numbers as the chunk has.
    if any(abs(a - b) > LIKE_PRIMARIES for a, b in zip(found, PRIMARIES, strict=False)):
        return "primaries other than those of sRGB"
    return ""


def color_notes(unconverted_colors: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Notes on images whose colours are not converted: pairs of a name and ``unconverted``."""
    by_space: dict[str, list[str]] = {}
    for name, space in unconverted_colors:
        if space:
            by_space.setdefault(space, []).append(name)
    for space, names in by_space.items():
        yield (
            f"colours of {listed(names, 3)} are not converted to sRGB and may look wrong "
            f"({space}): save them as sRGB in a photo program"
        )


def in_srgb(image: Image.Image, mode: str, profile: bytes | None) -> Image.Image:
    """Convert an image to sRGB (relative colorimetric); colours outside of sRGB are clipped.

    Args:
        image: of any mode of Pillow with 8 bits.
        mode: of the result, "RGB" or "RGBA".
        profile: as ``profile_of`` gives it; its numbers stay as they are without one.
    """
    colors = image.convert(mode)
    space = None if profile is None else _space(profile)
    if profile is None or space is None:
        return colors
    source = {"GRAY": "L", "CMYK": "CMYK"}.get(space, mode)
    transform = _to_srgb(profile, source, mode if source == mode else "RGB")
    if transform is None:
        return colors
    if source == mode:
        return transform.apply(colors)
    converted = transform.apply(image.convert(source))
    if mode == "RGBA":
        converted.putalpha(colors.getchannel("A"))
    return converted


def _transfer_of_png(image: Image.Image) -> int:
    """The transfer characteristic of the chunk cICP (PNG, third edition); 0 without one."""
    file = getattr(image, "fp", None)
    if file is None:
        return 0
    before = file.tell()
    file.seek(8)
    try:
        while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
            if head[4:] == b"cICP":
                return int(file.read(4)[1])
            file.seek(struct.unpack(">I", head[:4])[0] + 4, io.SEEK_CUR)
    except (OSError, ValueError, IndexError):
        return 0
    finally:
        file.seek(before)
    return 0


def _fits(profile: bytes, mode: str) -> bool:
    """True if a profile describes the pixels of a mode; grey is RGB, too."""
    space = _space(profile)
    grey = mode if not mode.startswith("I") else "L"
    return grey in SPACES[space] if space in SPACES else space == "RGB" and mode != "CMYK"


@lru_cache(maxsize=64)
def _space(profile: bytes) -> str | None:
    """The kind of numbers that a profile describes, such as RGB; ``None`` if it is damaged."""
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space = opened.profile.xcolor_space.strip()
        _built(opened, {"GRAY": "L"}.get(space, space), "RGB", space)
    except (OSError, ValueError, ImageCms.PyCMSError, ImportError):
        return None  # ImportError: Pillow without LittleCMS.
    return space


def _built(
    opened: ImageCms.ImageCmsProfile, source: str, target: str, space: str
) -> ImageCms.ImageCmsTransform:
    # Ink on paper is never black; programs for photos make its darkest colour black.
    darkest = ImageCms.Flags.BLACKPOINTCOMPENSATION if space in SPACES else ImageCms.Flags.NONE
    intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
    srgb = ImageCms.createProfile("sRGB")
    return ImageCms.buildTransform(opened, srgb, source, target, intent, darkest)


@lru_cache(maxsize=64)
def _to_srgb(profile: bytes, source: str, target: str) -> ImageCms.ImageCmsTransform | None:
    """The conversion of a profile's numbers, of a known space; ``None`` if they are sRGB's."""
    opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    transform = _built(opened, source, target, opened.profile.xcolor_space.strip())
    if source == "CMYK":
        return transform
    probes = Image.fromarray(PROBES).convert(source)
    moved = np.asarray(transform.apply(probes)).astype(int) - np.asarray(probes.convert(target))
    return transform if np.abs(moved).max() > LIKE_SRGB else None
