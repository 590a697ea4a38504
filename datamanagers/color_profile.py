"""Colour profiles: photos in Display P3 or Adobe RGB become sRGB, the space of all output.

Phones embed a profile in their photos. Numbers of Display P3 that are taken for sRGB look pale.
"""

from __future__ import annotations

import io
from functools import lru_cache
from itertools import product

import numpy as np
from PIL import Image, ImageCms

LIKE_SRGB = 2
"""Largest deviation from sRGB, of 255, of profiles whose numbers stay as they are."""
PROBES = np.array([*product(range(0, 256, 51), repeat=3)], np.uint8)[None]
"""Colours at which a profile is compared with sRGB."""


def in_srgb(image: Image.Image, mode: str) -> Image.Image:
    """Convert an image to sRGB by its embedded profile (relative colorimetric).

    Colours outside of sRGB are clipped. Profiles that are damaged, or of grey or CMYK, are not
    applied.

    Args:
        image: of any mode of Pillow with 8 bits.
        mode: of the result, "RGB" or "RGBA".
    """
    profile = image.info.get("icc_profile")
    colors = image.convert(mode)
    # Pillow gives whatever a TIFF has under the tag of the profile.
    transform = _to_srgb(profile, mode) if isinstance(profile, bytes) else None
    return colors if transform is None else transform.apply(colors)


@lru_cache(maxsize=8)
def _to_srgb(profile: bytes, mode: str) -> ImageCms.ImageCmsTransform | None:
    """The conversion of a profile's numbers; ``None`` if they are those of sRGB or unknown."""
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
        transform = ImageCms.buildTransform(
            source, ImageCms.createProfile("sRGB"), mode, mode, intent
        )
    except (OSError, ImageCms.PyCMSError, ImportError):  # ImportError: Pillow without LittleCMS.
        return None
    probes = Image.fromarray(PROBES).convert(mode)
    moved = np.asarray(transform.apply(probes)).astype(int) - np.asarray(probes)
    return transform if np.abs(moved).max() > LIKE_SRGB else None
