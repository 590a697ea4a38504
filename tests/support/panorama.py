"""A wide textured image, and what a camera sees of it: views whose shifts are known exactly."""

from functools import lru_cache

import numpy as np
from scipy import ndimage

WIDTH, HEIGHT = 320, 240


@lru_cache
def panorama(seed: int = 0) -> np.ndarray:
    """Grey levels of waves and edges of all sizes, 1600x600 pixels."""
    noise = np.random.default_rng(seed).normal(size=(600, 1600))
    layers = [ndimage.gaussian_filter(noise, sigma, mode="wrap") for sigma in (1, 4, 16)]
    image = sum(layer / layer.std() for layer in layers)
    return np.clip(128 + 30 * image, 0, 255)


def view(x: float, y: float = 100, seed: int = 0) -> np.ndarray:
    """What a camera sees from pixel (x, y) on; grey levels in [0, 255]."""
    left, top = int(x), int(y)
    part = panorama(seed)[top : top + HEIGHT + 1, left : left + WIDTH + 1]
    right, down = x - left, y - top
    across = part[:, :-1] * (1 - right) + part[:, 1:] * right
    return across[:-1] * (1 - down) + across[1:] * down


def colored(grey: np.ndarray, blur: float = 0.0) -> np.ndarray:
    """A view as 8-bit RGB."""
    values = ndimage.gaussian_filter(grey, blur) if blur else grey
    return np.repeat(values.round().clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)
