"""Views: extreme depths, positions, cameras and image sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase, front_camera, random_splats
from gsfw.studies.stress.catalogue.splats import FLAT, scaled
from gsfw.studies.stress.catalogue.variants import (
    EVERYTHING,
    SIZE,
    camera_cases,
    ordinary,
    splat_cases,
)

DISTANCE = 4.0
"""Distance of the camera from the origin."""


def moved(*depths: float) -> Change:
    """Place splats at these view depths, half of them straight ahead and the others to the side."""

    def change(splats: Splats) -> Splats:
        means, n = splats.means.clone(), len(splats)
        means[:, 2] = means.new_tensor(depths).repeat(n)[:n] - DISTANCE
        means[: n // 2, :2] = 0
        return replace(splats, means=means)

    return change


DEPTH_CHANGES: dict[str, Change] = {
    "depth/at-the-camera": moved(0.0),
    "depth/around-the-camera": moved(-1.0, 0.0, 1e-9, 1e-6, 1e-3, 0.009999, 0.01, 0.02),
    "depth/to-1e9": moved(1e-6, 1.0, 1e3, 1e6, 1e9),
    "depth/equal": moved(4.0),
    "depth/behind": moved(-1e-6, -1.0, -1e3, -1e9),
    "depth/around-the-camera-large": lambda splats: moved(0.0, 1e-6, 1e-3)(
        scaled(1e6, 1e6, 1e6)(splats)
    ),
}

TINY_DEPTH = (
    "gradients by position grow with 1 / depth squared, up to 1e12, and dominate all others"
)

DEPTH_REASONS = {
    "depth/to-1e9": TINY_DEPTH,
    "depth/around-the-camera": TINY_DEPTH,
    "depth/around-the-camera-large": FLAT,
}


def _at_the_near_plane(settings: RenderSettings) -> Drawing:
    """A camera at the origin, so that depths are exact; splats small enough not to overlap."""
    depths = torch.tensor([-0.5, 0.005, 0.0099, 0.00999, 0.01001, 0.0101, 0.02, 1.0])
    side = torch.linspace(-0.35, 0.35, 8)
    splats = random_splats(8)
    means = torch.stack([side * depths, 0.1 * depths, depths], dim=1)
    scales = depths.abs()[:, None] * torch.tensor([0.03, 0.02, 0.01])
    splats = replace(splats, means=means, scales=scales)
    return Drawing(splats, front_camera(48, 16, distance=0.0), settings)


def _straddling() -> Drawing:
    """Large splats with centres on both sides of the near plane."""
    drawing = _at_the_near_plane(RenderSettings(statistics=frozenset(Statistic)))
    splats = replace(drawing.splats, scales=torch.tensor([[0.02, 0.015, 0.01]]).repeat(8, 1))
    return replace(drawing, splats=splats)


def _thousand_equal() -> Drawing:
    n, generator = 1000, torch.Generator().manual_seed(0)
    splats = Splats(
        means=torch.zeros(n, 3),
        opacities=0.02 * torch.rand(n, generator=generator),
        colors=torch.rand(n, 3, generator=generator),
        quats=torch.ones(n, 4),
        scales=torch.tensor([[0.3, 0.2, 0.1]]).repeat(n, 1),
    )
    return Drawing(splats, front_camera(*SIZE), EVERYTHING)


def _closer_than_float32() -> Drawing:
    """Depths one rounding apart, in the reverse order of the rows."""
    n = 64
    depths = [torch.tensor(DISTANCE)]
    for _ in range(n - 1):
        depths.append(depths[-1].nextafter(depths[-1].new_tensor(0.0)))
    means = torch.zeros(n, 3)
    means[:, 2] = torch.stack(depths)
    splats = replace(
        random_splats(n),
        means=means,
        opacities=torch.full((n,), 0.2),
        scales=torch.tensor([[0.5, 0.4, 0.3]]).repeat(n, 1),
    )
    return Drawing(splats, front_camera(*SIZE, distance=0.0), EVERYTHING)


NEAR_PLANE = RenderSettings(statistics=frozenset(Statistic), depth=Depth.ACCUMULATED)

DEPTH = (
    *splat_cases(DEPTH_CHANGES, DEPTH_REASONS),
    StressCase("depth/near-plane", lambda: _at_the_near_plane(NEAR_PLANE)),
    StressCase("depth/near-plane/straddling", _straddling),
    StressCase("depth/far-plane", lambda: _at_the_near_plane(replace(NEAR_PLANE, far=0.5))),
    StressCase("depth/thousand-equal", _thousand_equal),
    StressCase("depth/one-rounding-apart", _closer_than_float32),
)
"""All cases of this section."""

POSITION_CHANGES: dict[str, Change] = {
    "position/scene-of-1e-6": lambda splats: replace(
        scaled(1e-6, 1e-6, 1e-6)(splats), means=1e-6 * splats.means
    ),
    "position/scene-of-1e6": lambda splats: replace(
        scaled(1e6, 1e6, 1e6)(splats), means=1e6 * splats.means
    ),
    "position/scene-of-1e30": lambda splats: replace(splats, means=1e30 * splats.means),
}

ORDER = "from far away, depths differ by less than float32 resolves: the order of rows decides"

POSITION_REASONS = {
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
    """The same in the scene frame, in float32."""
    world = _in_the_world()
    frame = Similarity(0.2, translation=-0.2 * torch.tensor(ORIGIN).double())
    pose = frame.camera(world.cameras.world_to_camera)
    splats = transform_splats(world.splats, frame)
    return _single(
        replace(world, splats=splats, cameras=replace(world.cameras, world_to_camera=pose))
    )


POSITION = (
    *splat_cases(POSITION_CHANGES, POSITION_REASONS),
    StressCase("position/georeferenced", _in_the_scene_frame, truth=_in_the_world, bound=1e-5),
    StressCase(
        "position/georeferenced/without-a-frame",
        lambda: _single(_in_the_world()),
        conditioning="float32 resolves half a metre at 5,000,000 m, the size of the details",
    ),
)
"""All cases of this section."""


def camera_with(
    focal: float, principal: float = 0.5, aspect: float = 1.0
) -> Callable[[Cameras], Cameras]:
    """A camera with this focal length in pixels, and a principal point in parts of the image."""

    def change(camera: Cameras) -> Cameras:
        k = camera.intrinsics.clone()
        k[0, 0, 0], k[0, 1, 1] = focal, focal * aspect
        k[0, :2, 2] = k.new_tensor([camera.width, camera.height]) * principal
        return replace(camera, intrinsics=k)

    return change


CAMERAS: dict[str, Callable[[Cameras], Cameras]] = {
    "camera/focal-1e-2": camera_with(1e-2),
    "camera/focal-1e6": camera_with(1e6),
    "camera/focal-1e30": camera_with(1e30),
    "camera/field-of-view-179": camera_with(0.09),
    "camera/principal-point-outside": camera_with(20.0, -3.0),
    "camera/principal-point-far-outside": camera_with(20.0, 1e6),
    "camera/pixels-not-square": camera_with(24.0, aspect=30.0),
}

SPLATS: dict[str, Change] = {
    "": lambda splats: splats,
    "-scales-1e6": scaled(1e6, 1e6, 1e6),
    "-around-the-camera": moved(-1.0, 0.0, 1e-9, 1e-6, 1e-3, 0.009999, 0.01, 0.02),
}

NEAR = "splats next to the camera are magnified until they are constant, as very large splats are"
LONG = "with this focal length, overflows of float32 decide which splats are drawn"

CAMERA_REASONS = {
    **{f"{name}-scales-1e6": FLAT for name in CAMERAS},
    **{f"{name}-around-the-camera": NEAR for name in CAMERAS},
    "camera/focal-1e30-around-the-camera": LONG,
}

CAMERA = camera_cases(CAMERAS, SPLATS, CAMERA_REASONS)
"""All cases of this section."""


def _some(splats: Splats, count: int) -> Splats:
    colors = splats.means[:count, :1]
    return Splats(
        splats.means[:count],
        splats.opacities[:count],
        colors.abs(),
        quats=splats.means.new_ones(count, 4),
        scales=splats.means[:count].abs(),
    )


IMAGE_CHANGES: dict[str, Change] = {
    "image/one-splat": lambda splats: _some(splats, 1),
    "image/no-splat": lambda splats: _some(splats, 0),
}

SIZES = ((1, 1), (1, 4096), (4096, 1), (17, 31), (8, 8), (9, 7), (16, 16), (64, 48))
FAR_PIXELS = "at thousands of pixels, float32 resolves a position to a ten-thousandth of a pixel"
COUNTS = {"": 20, "/one-splat": 1, "/no-splat": 0}


def _sized(width: int, height: int, count: int) -> StressCase:
    kind = next(name for name, found in COUNTS.items() if found == count)

    def make() -> Drawing:
        camera = camera_with(3.0)(front_camera(width, height))
        settings = replace(EVERYTHING, depth=Depth.EXPECTED)
        return Drawing(random_splats(count), camera, settings)

    far = FAR_PIXELS if max(width, height) > 1000 else ""
    return StressCase(f"image/{width}x{height}{kind}", make, conditioning=far)


def _wide() -> Drawing:
    """An image of 1,024 columns of tiles: more than a strip or a block of tiles holds."""
    camera = front_camera(16384, 64)
    k = camera.intrinsics.clone()
    k[0, 0, 0], k[0, 1, 1] = 12000.0, 60.0
    return Drawing(ordinary(), replace(camera, intrinsics=k), replace(EVERYTHING, near=0.01))


def _untouched() -> Drawing:
    splats, background = ordinary(), torch.tensor([-0.5, 0.25, 2.0])
    away = replace(splats, means=splats.means + torch.tensor([1000.0, 0, 0]))
    settings = RenderSettings(
        background=background, depth=Depth.EXPECTED, statistics=frozenset(Statistic)
    )
    return Drawing(away, front_camera(), settings)


IMAGE = (
    *splat_cases(IMAGE_CHANGES, {}),
    *(_sized(*size, count) for size in SIZES for count in COUNTS.values()),
    StressCase("image/16384x64", _wide, conditioning=FAR_PIXELS),
    StressCase("image/untouched", _untouched),
)
"""All cases of this section."""
