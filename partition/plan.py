"""Plan: cuts a data set into blocks of alike work, each with the views that see it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from statistics import median

import numpy as np
import torch
from jaxtyping import Float64

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.maths.axes import known_axis
from gsfw.core.words import size
from gsfw.datamanagers.capture import Capture
from gsfw.partition.cells import Cell, Weighted, balanced, grid, until
from gsfw.partition.costs import CostRule, Costs
from gsfw.partition.document import Block
from gsfw.partition.ground import Ground, find_ground, within
from gsfw.partition.visibility import Visibility, camera_places, visibility

FEWEST_VIEWS = 8
"""Training views below which a block of ``blocks=auto`` is not halved."""
MOST_BLOCKS = 1024
"""Blocks of ``blocks=auto`` at most."""
LEAST_POINTS = 10
"""Points below which there is no scene to cut."""


@dataclass(frozen=True)
class Wishes:
    """The user's wishes for a partition."""

    blocks: str = "auto"
    """auto, a number, or AxB."""
    memory_mb: float = 8000.0
    """Memory that one training may take."""
    margin: float = 0.15
    """Distance around a cell that its block is trained on too, in parts of its shorter side."""
    share: float = 0.15
    """Part of the points that a view sees which a block's cell has to hold for the view to be
    trained on there. VastGaussian takes 0.25 of the image's area, of a box with air above."""


@dataclass(frozen=True)
class Plan:
    """A scene that was cut."""

    ground: Ground
    blocks: tuple[Block, ...]
    whole: Costs
    """Costs of training the whole scene in one piece."""
    points: Float64[np.ndarray, "p 2"]
    """Places of the points on the ground, for the picture."""
    cameras: Float64[np.ndarray, "v 2"]
    """Places of the cameras."""
    held_out: tuple[str, ...]
    held_out_by: str
    by_tracks: bool
    """True if the tracks of the reconstruction said what views see."""


def make_plan(data: Capture, wishes: Wishes, cache_mb: int) -> Plan:
    """Cut the scene of a capture.

    Raises:
        ConfigError: the wishes make no sense, or the scene fits in one piece and nothing says into
            how many blocks it shall be cut.
        DataError: there are no points, or too few cameras.
    """
    recording = data.recording
    views = {split: data.views(split) for split in Split}
    count = len(recording.points)
    if count < LEAST_POINTS:
        raise DataError(
            f"{recording.path} has {count} points, and blocks are cut by what its views see of "
            "them.",
            "Give a reconstruction with points (COLMAP's points3D, or ply_file_path in "
            "transforms.json); gsfw prepare makes one of the photos.",
        )
    points = recording.points.numpy()
    centers = camera_places(recording.frames)
    poses = torch.stack([frame.world_to_camera for frame in recording.frames]).numpy()
    stated = known_axis(recording.up)
    ground = find_ground(points, poses, None if stated is None else stated.numpy())
    seen = visibility(data)
    pixels = int(median([camera.width * camera.height for camera in views[Split.TRAIN].cameras]))
    rule = CostRule(pixels, seen.views_per_point(), count, cache_mb)
    whole = rule.of(len(views[Split.TRAIN]), count)
    cutter = _Cutter(ground, seen, points, centers, frozenset(views[Split.TRAIN].names), rule)
    cells = cutter.cells(wishes, whole)
    numbered = [
        (f"b{place:0{len(str(len(cells) - 1))}d}", cell) for place, cell in enumerate(cells)
    ]
    blocks = tuple(cutter.block(name, cell, wishes) for name, cell in numbered)
    return Plan(
        ground=ground,
        blocks=blocks,
        whole=whole,
        points=ground.places(points),
        cameras=ground.places(centers),
        held_out=tuple(views[Split.EVAL].names),
        held_out_by=views[Split.TRAIN].origin,
        by_tracks=seen.by_tracks,
    )


class _Cutter:
    """Cuts by places on the ground."""

    def __init__(
        self,
        ground: Ground,
        seen: Visibility,
        points: Float64[np.ndarray, "p 3"],
        centers: Float64[np.ndarray, "v 3"],
        trained: frozenset[str],
        rule: CostRule,
    ) -> None:
        self._seen, self._rule = seen, rule
        self._trained = np.array([name in trained for name in seen.names])
        self._points, self._cameras = ground.places(points), ground.places(centers)
        self._tried = ground.places(seen.places)
        self._totals = seen.seen(np.ones(len(seen.places), bool))
        inner = self._points[within(self._points)]
        self._work = Weighted.of(inner, self._cameras[self._trained])
        self._box = np.stack([inner.min(axis=0), inner.max(axis=0)])

    def cells(self, wishes: Wishes, whole: Costs) -> list[Cell]:
        """The cells that the user asks for."""
        text = wishes.blocks.lower()
        if text == "auto":
            if whole.memory_mb <= wishes.memory_mb:
                raise ConfigError(
                    "the whole scene fits in one piece: it needs about "
                    f"{size(1e6 * whole.memory_mb)}, and memory={size(1e6 * wishes.memory_mb)}.",
                    "Train it with gsfw train; blocks=N cuts it all the same.",
                )
            return until(self._work, lambda cell: self._fits(cell, wishes), MOST_BLOCKS)
        if found := re.fullmatch(r"(\d+)x(\d+)", text):
            first, second = int(found[1]), int(found[2])
        elif text.isdecimal():
            first, second = int(text), 1
        else:
            first = second = 0
        if not 2 <= first * second <= MOST_BLOCKS:
            raise ConfigError(
                f"blocks={wishes.blocks}: expected auto, a number from 2 to {MOST_BLOCKS}, or AxB "
                "such as 3x2."
            )
        self._check_views(first * second)
        return balanced(self._work, first) if text.isdecimal() else grid(self._work, first, second)

    def _check_views(self, count: int) -> None:
        views = int(self._trained.sum())
        if views < 2 * count:
            raise DataError(
                f"{views} training views are too few for {count} blocks: expected at least 2 for "
                "each.",
                "Give fewer blocks, or train it in one piece with gsfw train.",
            )

    def _fits(self, cell: Cell, wishes: Wishes) -> bool:
        block = self.block("", cell, wishes, may_be_empty=True)
        return block.memory_mb <= wishes.memory_mb or len(block.train) < 2 * FEWEST_VIEWS

    def block(self, name: str, cell: Cell, wishes: Wishes, *, may_be_empty: bool = False) -> Block:
        """The block of a cell.

        Raises:
            DataError: no training view sees it.
        """
        low, high = np.maximum(cell.low, self._box[0]), np.minimum(cell.high, self._box[1])
        margin = wishes.margin * max(float((high - low).min()), 0.0)
        inside = self._seen.seen(cell.holds(self._tried))
        shares = inside / np.maximum(self._totals, 1)
        stands = cell.holds(self._cameras) & (inside > 0)
        chosen = (shares >= wishes.share) | stands
        train = tuple(np.array(self._seen.names, object)[chosen & self._trained])
        # A held-out view is measured in the block that most of what it sees is in.
        held = (shares > 0.5) & ~self._trained
        if not train and not may_be_empty:
            raise DataError(
                f"block {name} has no training view: no view sees enough of it.",
                "Give fewer blocks (blocks=N, or more memory), or a smaller share than "
                f"{wishes.share:g}.",
            )
        points = int(cell.holds(self._points).sum())
        costs = self._rule.of(len(train), int(cell.holds(self._points, margin).sum()))
        return Block(
            name=name,
            cell=cell,
            margin=margin,
            train=train,
            evaluation=tuple(np.array(self._seen.names, object)[held]),
            points=points,
            gaussians=costs.gaussians,
            memory_mb=costs.memory_mb,
        )
