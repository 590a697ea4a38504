"""Position: georeferenced worlds, and scenes of extreme extent."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.core.render_settings import RenderSettings
from gsfw.studies.stress.case import Change, Drawing, StressCase
from gsfw.studies.stress.catalogue.shape import FLAT, scaled
from gsfw.studies.stress.catalogue.variants import splat_cases
from gsfw.studies.stress.scene import front_camera, random_splats

CHANGES: dict[str, Change] = {
    "position/scene-of-1e-6": lambda splats: replace(
        scaled(1e-6, 1e-6, 1e-6)(splats), means=1e-6 * splats.means
    ),
    "position/scene-of-1e6": lambda splats: replace(
        scaled(1e6, 1e6, 1e6)(splats), means=1e6 * splats.means
    ),
    "position/scene-of-1e30": lambda splats: replace(splats, means=1e30 * splats.means),
}

ORDER = "seen from afar, depths differ by less than float32 resolves, and the order is that of rows"

REASONS = {
    "position/scene-of-1e-6": ORDER,
    "position/scene-of-1e6": FLAT,
}

ORIGIN = (447_213.25, 5_411_820.5, 312.75)
"""Easting, northing and height of a place in Europe (UTM), in metres."""


def _in_the_world() -> Drawing:
    """A house in UTM coordinates with details of centimetres, all in float64."""
    splats = transform_splats(
        random_splats(60, 0), Similarity(5.0, translation=torch.tensor(ORIGIN).double())
    )
    assert splats.scales is not None
    splats = replace(splats, scales=0.15 * splats.scales)
    camera = front_camera(48, 36, distance=20.0, dtype=torch.float64)
    pose = camera.world_to_camera.clone()
    pose[0, :3, 3] -= pose[0, :3, :3] @ torch.tensor(ORIGIN).double()
    return Drawing(splats, replace(camera, world_to_camera=pose), RenderSettings())


def _single(drawing: Drawing) -> Drawing:
    return replace(
        drawing,
        splats=drawing.splats.map(lambda tensor: tensor.float()),
        cameras=drawing.cameras.to(dtype=torch.float32),
    )


def _in_the_scene_frame() -> Drawing:
    """The same through the scene frame, which is what is kept in float32."""
    world = _in_the_world()
    frame = Similarity(0.2, translation=-0.2 * torch.tensor(ORIGIN).double())
    pose = frame.camera(world.cameras.world_to_camera)
    splats = transform_splats(world.splats, frame)
    return _single(
        replace(world, splats=splats, cameras=replace(world.cameras, world_to_camera=pose))
    )


POSITION = (
    *splat_cases(CHANGES, REASONS),
    StressCase("position/georeferenced", _in_the_scene_frame, truth=_in_the_world, bound=1e-5),
    StressCase(
        "position/georeferenced/without-a-frame",
        lambda: _single(_in_the_world()),
        conditioning="float32 resolves half a metre at 5,000,000 m, as much as the scene's details",
    ),
)
"""All cases of this section."""
