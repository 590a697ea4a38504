"""Splats and models to be edited, with cameras around them."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.similarity import Similarity
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.editing.capture import Capture
from gsfw.editing.editable import EditableSplats
from gsfw.editing.editable_model import EditableModel
from gsfw.editing.operations.edit import Edited, Surroundings
from gsfw.editing.script import Step
from gsfw.editing.transforms import composed, move, rotate, scale
from support.fast_rasterizer import fast_rasterizer
from support.moving_scene import two_balls

WORLD = composed(
    move(torch.tensor([4.0, 5.0, -6.0], dtype=torch.float64)),
    composed(rotate(torch.tensor([0.0, 1.0, 1.0], dtype=torch.float64), 40.0), scale(3.0)),
)
"""A world that is not the scene frame."""


def cameras_around(times: bool) -> list[Cameras]:
    """Four level cameras around the origin of the scene frame."""
    count = 4
    angles = torch.arange(count) * (2 * torch.pi / count)
    places = torch.stack([angles.cos(), 0.3 * torch.ones(count), angles.sin()], dim=1)
    cameras = Cameras.look_at(3.0 * places, width=32, height=24)
    if times:
        cameras = replace(cameras, time=torch.linspace(0, 1, count))
    return [cameras.select([index]) for index in range(count)]


def capture(world: Similarity = WORLD, invented: bool = False, times: bool = False) -> Capture:
    """A capture of the scene frame."""
    return Capture(
        cameras=tuple(cameras_around(times)),
        world_from_scene=world,
        rasterizer=fast_rasterizer(),
        settings=RenderSettings(background=torch.ones(3)),
        device=torch.device("cpu"),
        source="scene.ply",
        invented=invented,
    )


def piece_of(splats: Splats, up: str = "", invented: bool = False) -> EditableSplats:
    """Splats of a world to be edited; they are given in that world."""
    found = capture(invented=invented)
    return EditableSplats(SplatFile(splats, up=up), lambda: found, Similarity())


def balls(at_all_times: bool = False, world: Similarity = WORLD) -> EditableModel:
    """A ball that drifts from x = -0.4 to 0.4, and one that stands at (0, 0.5, 0)."""
    return EditableModel(
        model=two_balls(), method="drifting", given=capture(world, times=True),
        times=tuple(index / 8 for index in range(9)), at_all_times=at_all_times, time=0.0,
        moved=Similarity(), up="-y",
    )  # fmt: skip


def nothing_around() -> Surroundings:
    """What edits need that need nothing."""

    def read(path: object) -> SplatFile:
        raise NotImplementedError

    return Surroundings(read, lambda piece: 100 * len(piece) + 40)


def edited(piece: EditableSplats | EditableModel, name: str, text: str) -> Edited:
    """The result of one step."""
    return Step.of(name, text).edit(piece, nothing_around())
