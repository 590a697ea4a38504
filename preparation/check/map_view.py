"""MapView: cameras and points of a capture, drawn from above or from the side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.up_axis import up_axis

INK, PAPER = (60, 60, 64), (255, 255, 255)
"""Colours of text and lines, and of the sheet."""
TRAINED, HELD_OUT = (31, 91, 171), (209, 98, 36)
"""Colours of cameras."""
GROUND = (243, 243, 245)
POINTS = 12_000
"""Largest number of points in the map, spread evenly over all."""
SHADE = 0.9
"""Colours of points are darkened by this factor, so that white ones show."""
REACH = 3.0
"""Points farther than this many camera distances from the middle lie outside the image."""
FRUSTUM = 0.035
"""Length of a camera, in widths of the view."""
ROOM = 0.15
"""Around the outermost camera or point, in parts of the distance to it."""
OVERSAMPLING = 2
"""Views are drawn this much larger and then shrunk: Pillow draws lines with hard edges."""


@dataclass(frozen=True)
class MapView:
    """Two directions of the scene that become right and down in an image."""

    across: Float[np.ndarray, " 3"]
    down: Float[np.ndarray, " 3"]
    middle: Float[np.ndarray, " 3"]
    reach: tuple[float, float]
    """From the middle to the borders at least, across and down, in scene units."""

    def draw(self, survey: Survey, title: str, size: tuple[int, int]) -> Image.Image:
        """The image, ``size`` pixels wide and high."""
        scale = OVERSAMPLING
        image = Image.new("RGB", (scale * size[0], scale * size[1]), GROUND)
        draw = ImageDraw.Draw(image)
        self._points(draw, survey, image.size)
        self._target(draw, survey, image.size)
        for number in survey.viewpoints.places[::-1].tolist():
            self._camera(draw, survey, number, image.size)
        font = ImageFont.load_default(14 * scale)
        draw.text((10 * scale, 8 * scale), title, INK, font)
        return image.resize(size, Image.Resampling.BOX)

    def _pixels(
        self, points: Float[np.ndarray, "p 3"], size: tuple[int, int]
    ) -> Float[np.ndarray, "p 2"]:
        offsets = (points - self.middle) @ np.stack([self.across, self.down], axis=1)
        zoom = min(side / 2 / reach for side, reach in zip(size, self.reach, strict=True))
        return np.array(size) / 2 + offsets * zoom

    def _points(self, draw: ImageDraw.ImageDraw, survey: Survey, size: tuple[int, int]) -> None:
        scene = survey.scene
        count = len(scene.points)
        chosen = np.linspace(0, count - 1, min(count, POINTS)).astype(int)
        points = scene.points.double().numpy()[chosen]
        colors = scene.point_colors.numpy()[chosen]
        # From above, what is higher is drawn last.
        order = np.argsort(points @ np.cross(self.across, self.down))[::-1]
        shades = (255 * SHADE * colors.clip(0, 1)).astype(int)
        for row, (x, y) in zip(order, self._pixels(points[order], size), strict=True):
            if 0 <= x < size[0] and 0 <= y < size[1]:
                draw.rectangle((x, y, x + 2, y + 2), fill=tuple(shades[row].tolist()))

    def _target(self, draw: ImageDraw.ImageDraw, survey: Survey, size: tuple[int, int]) -> None:
        """A cross where cameras look, if there are no points."""
        if survey.surface is None or survey.surface.measured:
            return
        middle = survey.surface.points.mean(axis=0, keepdims=True)
        x, y = self._pixels(middle, size)[0]
        arm = 9 * OVERSAMPLING
        for line in ((x - arm, y, x + arm, y), (x, y - arm, x, y + arm)):
            draw.line(line, fill=INK, width=2 * OVERSAMPLING)

    def _camera(
        self, draw: ImageDraw.ImageDraw, survey: Survey, number: int, size: tuple[int, int]
    ) -> None:
        """A pyramid from the camera's centre to the corners of its image."""
        viewpoints = survey.viewpoints
        pose, intrinsics = viewpoints.poses[number], viewpoints.intrinsics[number]
        width, height = viewpoints.sizes[number].tolist()
        half = np.array([width / intrinsics[0, 0], height / intrinsics[1, 1]]) / 2
        half = np.minimum(half, 1.2)
        corners = np.array(
            [(x * half[0], y * half[1], 1.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        )
        center = viewpoints.centers[number]
        length = 2 * max(self.reach) * FRUSTUM
        points = np.concatenate([center[None], center + length * corners @ pose[:3, :3]])
        pixels = [(float(x), float(y)) for x, y in self._pixels(points, size)]
        color = TRAINED if viewpoints.trained[number] else HELD_OUT
        for corner in pixels[1:]:
            draw.line((pixels[0], corner), fill=color, width=OVERSAMPLING)
        draw.line([*pixels[1:], pixels[1]], fill=color, width=OVERSAMPLING)


def map_views(survey: Survey) -> tuple[MapView, MapView, str]:
    """Maps from above and from the side, and a sentence on how the up axis was found."""
    viewpoints = survey.viewpoints
    up, how = up_axis(survey.scene, viewpoints)
    centers = viewpoints.centers[viewpoints.places]
    level = centers - centers.mean(0)
    level = level - np.outer(level @ up, up)
    _, _, axes = np.linalg.svd(np.concatenate([level, 1e-9 * np.eye(3)]), full_matrices=False)
    across = axes[0] - (axes[0] @ up) * up
    across /= max(float(np.linalg.norm(across)), 1e-12)
    corners = centers
    if survey.surface is not None:
        points = survey.surface.points
        around = np.linalg.norm(points - centers.mean(0), axis=1)
        spread = float(np.linalg.norm(centers - centers.mean(0), axis=1).max())
        near = points[around <= max(REACH * spread, float(np.median(around)))]
        corners = np.concatenate([centers, near]) if len(near) else centers
    middle = (corners.min(0) + corners.max(0)) / 2
    forward = np.cross(across, -up)
    above, side = (
        MapView(across, down, middle, _reach(corners - middle, across, down))
        for down in (forward, -up)
    )
    return above, side, how


def _reach(
    offsets: Float[np.ndarray, "p 3"],
    across: Float[np.ndarray, " 3"],
    down: Float[np.ndarray, " 3"],
) -> tuple[float, float]:
    """Extents of points across and down, with room for the cameras' frusta."""
    wide, high = (float(np.abs(offsets @ axis).max()) for axis in (across, down))
    room = max(wide, high, 1e-6)
    return wide + ROOM * room, high + ROOM * room
