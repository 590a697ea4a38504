"""A room with texture that is photographed all around: panoramas whose places are known exactly.

Its axes are those of a level camera: x to the right, y down, z ahead; units are metres.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

LOW, HIGH = np.array([-3.0, -1.5, -2.5]), np.array([3.0, 1.2, 2.5])
"""Corners of the room."""
BOXES = (
    (np.array([1.6, 0.2, 0.6]), np.array([2.3, 1.2, 1.5])),
    (np.array([-2.2, -0.3, -1.6]), np.array([-1.5, 1.2, -1.1])),
    (np.array([-0.4, 0.5, 1.4]), np.array([0.5, 1.2, 2.0])),
)
"""Furniture: corners of each."""
TEXELS = 110
"""Texture elements to a metre."""
FULL_XMP = (
    b'<x:xmpmeta><rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" '
    b'GPano:ProjectionType="equirectangular"/></x:xmpmeta>'
)


@lru_cache
def _texture(seed: int) -> np.ndarray:
    """Colours in [0, 255] of waves and edges of all sizes, 700x700 texels; it wraps around."""
    random = np.random.default_rng(seed)
    waves = np.fft.rfft2(random.normal(size=(700, 700)))
    squares = np.fft.fftfreq(700)[:, None] ** 2 + np.fft.rfftfreq(700) ** 2
    grey = np.zeros((700, 700))
    for sigma in (1.0, 2.5, 7.0, 20.0):
        noise = np.fft.irfft2(waves * np.exp(-2 * (np.pi * sigma) ** 2 * squares), (700, 700))
        grey += np.sign(noise) * np.sqrt(np.abs(noise / noise.std()))
    tint = random.uniform(0.7, 1.2, 3)
    return np.clip((125 + 22 * grey)[..., None] * tint, 0, 255)


def directions(width: int) -> np.ndarray:
    """Unit vectors of the pixels of a level panorama, ``(width / 2, width, 3)``."""
    across = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    down = ((np.arange(width // 2) + 0.5) / (width // 2) - 0.5) * np.pi
    y, x = np.meshgrid(down, across, indexing="ij")
    return np.stack([np.sin(x) * np.cos(y), np.sin(y), np.cos(x) * np.cos(y)], axis=-1)


def colors(center: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Colours in [0, 255] that rays from a place meet, ``(..., 3)``."""
    flat = rays.reshape(-1, 3)
    with np.errstate(divide="ignore"):
        inverse = 1 / np.where(flat == 0, 1e-12, flat)
    far = np.maximum((LOW - center) * inverse, (HIGH - center) * inverse)
    axis = far.argmin(axis=1)
    distance, face = far.min(axis=1), axis * 2 + (flat[np.arange(len(flat)), axis] > 0)
    for number, (low, high) in enumerate(BOXES, 1):
        first, second = (low - center) * inverse, (high - center) * inverse
        near, beyond = np.minimum(first, second), np.maximum(first, second)
        enter = near.max(axis=1)
        met = (enter < beyond.min(axis=1)) & (enter > 0) & (enter < distance)
        distance = np.where(met, enter, distance)
        axis = np.where(met, near.argmax(axis=1), axis)
        face = np.where(met, 5 + number, face)
    points = center + flat * distance[:, None]
    result = np.empty_like(flat)
    for one, across in np.unique(np.stack([face, axis]), axis=1).T.tolist():
        chosen = (face == one) & (axis == across)
        rest = [i for i in range(3) if i != across]
        places = (points[chosen][:, rest] * TEXELS).T
        for channel in range(3):
            result[chosen, channel] = ndimage.map_coordinates(
                _texture(one)[..., channel], places, order=1, mode="grid-wrap"
            )
    return result.reshape(rays.shape)


def panorama(center: np.ndarray, turn: np.ndarray, width: int, finer: int = 2) -> np.ndarray:
    """An equirectangular image; the camera's axes are ``turn`` times the room's."""
    seen = colors(np.asarray(center, float), directions(finer * width) @ turn)
    blocks = seen.reshape(width // 2, finer, width, finer, 3).mean(axis=(1, 3))
    return blocks.round().astype(np.uint8)


@lru_cache
def sphere() -> np.ndarray:
    """The panorama of the room's middle, 512x256 pixels."""
    return panorama(np.zeros(3), np.eye(3), 512)


@dataclass(frozen=True)
class Walk:
    """Places and turns of the panoramas of a walk through the room."""

    centers: np.ndarray
    turns: np.ndarray
    """From the room to the camera."""

    @staticmethod
    def of(count: int, seed: int = 0, upright: bool = False) -> "Walk":
        """A loop with cameras that look ahead, turned a little in all directions."""
        random = np.random.default_rng(seed)
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        centers = np.stack(
            [1.3 * np.cos(angle), 0.15 * np.sin(3 * angle) - 0.2, 1.0 * np.sin(angle)], axis=1
        )
        turns = []
        for one in angle:
            tilt = np.zeros(2) if upright else random.normal(scale=np.radians(4), size=2)
            yaw = one + (0.0 if upright else random.normal(scale=np.radians(15)))
            turns.append(_about(0, tilt[0]) @ _about(2, tilt[1]) @ _about(1, yaw))
        return Walk(centers, np.array(turns))

    def write(self, folder: Path, width: int, xmp: bytes = FULL_XMP) -> None:
        """Write it as JPEG files."""
        folder.mkdir(parents=True, exist_ok=True)
        for number, (center, turn) in enumerate(zip(self.centers, self.turns, strict=True)):
            image = Image.fromarray(panorama(center, turn, width))
            image.save(folder / f"R{number:04d}.jpg", quality=95, xmp=xmp)


def _about(axis: int, angle: float) -> np.ndarray:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[[first, second], [first, second]] = np.cos(angle)
    matrix[first, second], matrix[second, first] = -np.sin(angle), np.sin(angle)
    return matrix
