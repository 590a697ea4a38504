"""A made outdoor capture with a sky, as a transforms.json: boxes on a plain under clouds.

    python benchmarks/outdoor_capture.py FOLDER [views=around|inside] [count=56] [width=200]

``around`` has cameras around a group of boxes; ``inside`` has cameras within a ring of them that
look outwards. docs/guides/sky.md has what methods make of both.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

SEED = 3
SAMPLES = 2
"""Rays of a pixel along each of its sides."""
SUN = np.array([0.5, 0.3, 0.5]) / np.linalg.norm([0.5, 0.3, 0.5])
HORIZON, ZENITH, HAZE = np.array([0.82, 0.88, 0.95]), np.array([0.25, 0.45, 0.85]), 60.0
"""Colours of the sky, and the distance at which the plain has faded by 1 / e."""
GRASS = np.array([0.55, 0.65, 0.35])
SIDES = np.array([1.0, 0.85, 0.7])
"""Brightness of the sides of a box, by their axis."""


class Noise:
    """Sums of sines of random directions, in octaves."""

    def __init__(self, generator: np.random.Generator, dimensions: int, frequency: float) -> None:
        octaves = [2.0**octave for octave in range(3)]
        self._waves = [
            (generator.normal(size=(7, dimensions)) * frequency * factor, 1 / factor)
            for factor in octaves
        ]
        self._phases = generator.uniform(0, 2 * np.pi, (3, 7))

    def __call__(self, places: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
        """Values about 0."""
        parts = zip(self._waves, self._phases, strict=True)
        return sum(w * np.sin(places @ waves.T + phase).mean(1) for (waves, w), phase in parts)


@dataclass(frozen=True)
class Block:
    """A box that stands on the plain."""

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]
    color: Float[np.ndarray, " 3"]
    noise: Noise


class Outdoors:
    """The scene: what a ray meets, and its colour."""

    def __init__(self, views: str) -> None:
        generator = np.random.default_rng(SEED)
        self.generator = generator
        self._clouds, self._ground = Noise(generator, 3, 3.0), Noise(generator, 2, 1.5)
        near = [(generator.uniform(-1.2, 1.2, 2), (0.3, 0.6), (0.4, 1.6)) for _ in range(5)]
        ring = [
            (generator.uniform(8, 14) * np.array([np.cos(a), np.sin(a)]), (1.0, 2.5), (2.0, 5.0))
            for a in np.arange(10) * 2 * np.pi / 10
        ]
        placed = (near if views == "around" else []) + ring
        self._blocks = [self._block(*each) for each in placed]

    def _block(
        self, place: Float[np.ndarray, " 2"], half: tuple[float, float], top: tuple[float, float]
    ) -> Block:
        draw = self.generator
        size = draw.uniform(*half, 2)
        low, high = np.append(place - size, 0.0), np.append(place + size, draw.uniform(*top))
        return Block(low, high, draw.uniform(0.3, 0.9, 3), Noise(draw, 3, 4.5))

    def sky(self, rays: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Colours at infinity."""
        height = rays[:, 2:].clip(0, 1)
        cover = (2 * self._clouds(rays)).clip(0, 1)[:, None]
        clear = (1 - height) * HORIZON + height * ZENITH
        return (clear * (1 - cover) + 0.97 * cover + np.exp(300 * (rays @ SUN - 1))[:, None]).clip(
            0, 1
        )

    def colors(
        self, origin: Float[np.ndarray, " 3"], rays: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Colours of the nearest surfaces along rays of length 1, or of the sky."""
        colors, nearest = self.sky(rays), np.full(len(rays), np.inf)
        down = rays[:, 2] < 0
        nearest[down] = -origin[2] / rays[down, 2]
        places = origin + nearest[down, None] * rays[down]
        grass = (0.45 + 0.7 * self._ground(places[:, :2])).clip(0, 1)[:, None] * GRASS
        seen = np.exp(-nearest[down] / HAZE)[:, None]
        colors[down] = grass * seen + HORIZON * (1 - seen)
        for block in self._blocks:
            with np.errstate(divide="ignore"):
                ends = (block.low - origin) / rays, (block.high - origin) / rays
            into, out = np.minimum(*ends), np.maximum(*ends).min(1)
            entry = into.max(1)
            met = (entry < out) & (entry > 0) & (entry < nearest)
            nearest[met] = entry[met]
            places = origin + entry[met, None] * rays[met]
            shade = (0.75 + 0.9 * block.noise(places)) * SIDES[into.argmax(1)[met]]
            colors[met] = (block.color * shade[:, None]).clip(0, 1)
        return colors


def poses(views: str, count: int, generator: np.random.Generator) -> list[np.ndarray]:
    """Camera to world, OpenGL axes."""
    found = []
    for angle in np.arange(count) * 2.39996:  # The golden angle: neighbours stand far apart.
        around = np.array([np.cos(angle), np.sin(angle)])
        if views == "around":
            place = np.append(generator.uniform(3.5, 5) * around, generator.uniform(0.4, 1.6))
            target = np.append(generator.uniform(-0.4, 0.4, 2), generator.uniform(0.6, 1.4))
        else:
            place = np.append(generator.uniform(-2.5, 2.5, 2), generator.uniform(1.2, 2))
            target = place + np.append(around, generator.uniform(0, 0.45))
        back = (place - target) / np.linalg.norm(place - target)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(back, right), back, place], axis=1)
        found.append(pose)
    return found


def write_outdoors(folder: Path, views: str = "around", count: int = 56, width: int = 200) -> None:
    """Write images of ``width`` by two thirds of it, and their cameras."""
    scene, height = Outdoors(views), 2 * width // 3
    focal = (0.9 if views == "around" else 0.7) * width
    (folder / "images").mkdir(parents=True, exist_ok=True)
    across = ((np.arange(width * SAMPLES) + 0.5) / SAMPLES - width / 2) / focal
    up = -((np.arange(height * SAMPLES) + 0.5) / SAMPLES - height / 2) / focal
    grid = np.stack(np.broadcast_arrays(across[None], up[:, None], -1.0), axis=-1)
    grid /= np.linalg.norm(grid, axis=-1, keepdims=True)
    frames = []
    for number, pose in enumerate(poses(views, count, scene.generator)):
        colors = scene.colors(pose[:3, 3], (grid @ pose[:3, :3].T).reshape(-1, 3))
        image = colors.reshape(height, SAMPLES, width, SAMPLES, 3).mean((1, 3))
        name = f"images/{number:03}.png"
        Image.fromarray((255 * image + 0.5).astype(np.uint8)).save(folder / name)
        frames.append({"file_path": name, "transform_matrix": pose.tolist()})
    lens = {"fl_x": focal, "fl_y": focal, "cx": width / 2, "cy": height / 2}
    size = {"w": width, "h": height}
    (folder / "transforms.json").write_text(json.dumps({**lens, **size, "frames": frames}))


if __name__ == "__main__":
    given = dict(pair.split("=", 1) for pair in sys.argv[2:])
    write_outdoors(
        Path(sys.argv[1]),
        given.get("views", "around"),
        int(given.get("count", 56)),
        int(given.get("width", 200)),
    )
