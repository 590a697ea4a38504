"""Choices: what a planned run turns on, by the number of updates that its time allows.

The rows are for studies to tune. They replace plain defaults alone: what the
user, a preset or a method's own recommendation says stays, and a key that the chosen parts do not
have is left out. So they hold for every method and strategy, those of plugins included.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gsfw.core.capabilities import Feature
from gsfw.core.config import AUTO, DENSE, RasterizerConfig
from gsfw.core.loop.growth_limit import LIMITS
from gsfw.core.scene import Scene
from gsfw.plugins.automatic import USUAL_CHOICE
from gsfw.plugins.keys import SLOT_KEYS, keys
from gsfw.plugins.settings import METHOD_DEFAULT, Settings


@dataclass(frozen=True)
class Choice:
    """Settings for runs of some length."""

    updates: int
    """Updates at the chosen image size from which on the choice is made."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Settings by dotted key."""
    per_pixel: float = 2.0
    """Most Gaussians for each pixel of a view: models that grow freely end with 0.4 to 2, and those
    of short runs would cost more time than they have to be fitted."""


USUAL = {"init": DENSE, "strategy": "error"}
"""Choices of runs of any length."""
CHOICES = (
    Choice(0, USUAL, per_pixel=0.8),
    Choice(1000, USUAL | {"resolution_schedule": AUTO}, per_pixel=1.0),
    Choice(10_000, USUAL | {"resolution_schedule": AUTO}),
)
"""By length. Below 1000 updates a schedule of sizes has no effect. ``strategy.budget=auto`` is no
choice: it halves the Gaussians of long runs, for 0.5 dB on fox and nothing on plush."""

ENOUGH_UPDATES = 1000
"""Updates below which smaller images help more than larger ones with fewer updates."""
DOWNSCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
"""Divisors of the sides of all images, of which the smallest is chosen that leaves enough updates;
only where the user gives none."""
SHORTEST_SIDE = 120
"""Pixels of the short side of an image that no choice goes below."""

ENOUGH_POSITIONS = 40
"""Number of camera positions below which the limit of Gaussians falls in proportion: with few
positions, more Gaussians only overfit each image. Measured: garden_robot_mv, 9 positions: 15.4 dB
with 96,000 Gaussians, 15.4 to 16.0 with 27,000 (seeds differ by 0.4)."""

NEEDED = {"strategy": Feature.WEIGHTED_CONTRIBUTION}
"""Features of the rasterizer that a choice needs."""


def chosen(settings: Settings, updates: float, scene: Scene) -> dict[str, Any]:
    """The settings to turn on in a run of ``updates`` updates.

    Points that have times say more of motion than a surface of one time, and are kept.
    """
    rasterizer = settings.config.rasterizer
    assert isinstance(rasterizer, RasterizerConfig)
    features = rasterizer.capabilities().features
    return {
        key: value
        for key, value in _row(updates).values.items()
        if _is_free(settings, key)
        and NEEDED.get(key) in (None, *features)
        and (key != "init" or scene.point_times is None)
    }


def limits(
    settings: Settings, updates: float, scene: Scene, view_pixels: int, start: int
) -> dict[str, int]:
    """Limits of the number of Gaussians, where the usual ones are larger.

    Args:
        settings: of the run.
        updates: that it has.
        scene: the capture; few camera positions determine few Gaussians.
        view_pixels: pixels of an image.
        start: number of Gaussians to start with.
    """
    positions, flat = _camera_positions(scene), settings.flat()
    per_pixel = _row(updates).per_pixel * min(positions / ENOUGH_POSITIONS, 1.0)
    most = max(int(per_pixel * view_pixels), start)
    return {key: most for key in LIMITS if _is_free(settings, key) and flat[key] > most}


def _camera_positions(scene: Scene) -> int:
    """Number of distinct positions of the training cameras; images of a fixed camera share one."""
    return len((scene.camera_centers / (1e-3 * scene.extent)).round().unique(dim=0))


def _row(updates: float) -> Choice:
    """The last row of the table that a run of ``updates`` updates reaches."""
    return max((row for row in CHOICES if row.updates <= updates), key=lambda row: row.updates)


def downscale(sides: tuple[int, int], updates: Sequence[float]) -> float:
    """The smallest of ``DOWNSCALES`` that leaves enough updates.

    Args:
        sides: width and height of the images.
        updates: that the time allows at each of ``DOWNSCALES``.
    """
    usable = [
        (divisor, count)
        for divisor, count in zip(DOWNSCALES, updates, strict=True)
        if divisor == 1 or min(sides) / divisor >= SHORTEST_SIDE
    ]
    return next((divisor for divisor, count in usable if count >= ENOUGH_UPDATES), usable[-1][0])


def _is_free(settings: Settings, key: str) -> bool:
    """True if a setting is there and has its plain default, and a slot's part has those alone."""
    if key in SLOT_KEYS:
        return settings.sources[key].endswith(USUAL_CHOICE) and all(
            source.startswith(METHOD_DEFAULT)
            for name, source in settings.sources.items()
            if name.startswith(f"{key}.")
        )
    known = {item.name for item in keys(settings.config)}
    return key in known and settings.sources.get(key) == METHOD_DEFAULT
