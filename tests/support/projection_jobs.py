"""The kernels that project, run on the emulation, and what the reference says of them."""

from dataclasses import dataclass, replace

import torch
from emulation.launcher import EmulatedLauncher
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.kernels.cuda import jobs
from gsfw.kernels.cuda.launcher import Kernel, address
from gsfw.kernels.render_arguments import POSE_FIELDS, KernelSettings
from gsfw.rasterizers.cuda.stages import PROJECT_THREADS, SPLAT_CHANNELS, TILE
from gsfw.rasterizers.kernel_arguments import PairLimit, render_call
from gsfw.rasterizers.reference.project import Ellipses, project, view_colors, visible_extents
from support.random_scenes import Kind

NAMES = {torch.float32: "float", torch.float64: "double"}

ROWS = ("means", "quats", "scales", "covariances", "opacities", "colors", "rest", "extra")


Scene = tuple[Splats, Cameras, RenderSettings]

PINHOLE, ORTHOGRAPHIC, FISHEYE = CameraModel

SCENES = {
    "SH in two parts": Kind(1, (33, 17), PINHOLE, 70, degree=3, layout="two parts"),
    "SH of degree 4": Kind(2, (40, 64), FISHEYE, 65, degree=4, extras=2, depth=Depth.EXPECTED),
    "channels": Kind(
        *(3, (64, 33), ORTHOGRAPHIC, 100),
        layout="channels",
        channels=5,
        extras=3,
        antialias=True,
        depth=Depth.ACCUMULATED,
    ),
    "half active covariances": Kind(
        *(4, (50, 40), PINHOLE, 64),
        degree=4,
        layout="half active",
        covariances=True,
        antialias=True,
    ),
    "constant colours of covariances": Kind(
        *(5, (31, 47), FISHEYE, 31),
        degree=2,
        layout="two parts",
        covariances=True,
        depth=Depth.ACCUMULATED,
    ),
    "no cut-offs": Kind(7, (20, 50), PINHOLE, 33, degree=3, cut_offs=False, antialias=True),
    "ragged": Kind(8, (37, 21), PINHOLE, 75, degree=3, layout="ragged"),
    "ragged beyond the active degree": Kind(
        *(9, (45, 33), FISHEYE, 70), degree=4, layout="ragged", covariances=True, antialias=True
    ),
    "one splat": Kind(6, (20, 20), PINHOLE, 1, degree=3),
}
"""Every camera model, form, layout and number of depth channels."""


def scene_of(name: str, dtype: torch.dtype = torch.float64) -> Scene:
    """One of ``SCENES``, a third of it behind the camera or beside the image."""
    splats, cameras, settings = SCENES[name].scene(torch.float64)
    means, colors = splats.means.clone(), splats.colors
    means[2::6] *= -8
    means[4::6] *= 8
    if name.startswith("constant"):
        assert isinstance(colors, Sh)
        colors = replace(colors, degree=0)
    if name.endswith("active degree"):
        assert isinstance(colors, Sh)
        colors = replace(colors, degree=2)
    splats = replace(splats, means=means, colors=colors)
    return splats.map(lambda held: held.to(dtype)), cameras.to(dtype=dtype), settings


@dataclass
class Projection:
    """What ``project`` is given, and what it writes."""

    arguments: str
    """Of the kernels' templates."""
    tensors: dict[str, Tensor | None]
    """Those of the job, rows of colours flat."""
    projected: Tensor
    depth_keys: Tensor
    tile_counts: Tensor
    visible: Tensor
    radii: Tensor
    job: jobs.ProjectJob
    channels: int

    @property
    def blocks(self) -> int:
        return -(-len(self.radii) // PROJECT_THREADS)

    def run(self, launcher: EmulatedLauncher) -> None:
        kernel = Kernel("project.cu", f"project<{self.arguments}>")
        launcher.launch(kernel, self.blocks, PROJECT_THREADS, self.job)


@dataclass
class Backward:
    """What ``project_backward`` writes."""

    gradients: dict[str, Tensor]
    screen_gradient: Tensor
    absgrad: Tensor
    pose: Tensor | None
    """[blocks, 15]"""


def flat_tensors(splats: Splats) -> dict[str, Tensor | None]:
    """The arrays of a job by name; rows of colours flat."""
    named: dict[str, Tensor | None] = {name: None for name in ROWS} | splats.tensors()
    for name in ("colors", "rest"):
        tensor = named[name]
        named[name] = None if tensor is None else tensor.detach().flatten(1)
    named["offsets"] = splats.colors.offsets if isinstance(splats.colors, Sh) else None
    return {name: None if held is None else held.detach() for name, held in named.items()}


def projection_of(splats: Splats, cameras: Cameras, settings: RenderSettings) -> Projection:
    """Everything for one camera, outputs full of what nobody may read."""
    n, like = len(splats), splats.means
    statistics = RenderStatistics.zeros(like, 1, frozenset())
    call = render_call(splats, cameras, settings, statistics, PairLimit(1.0, 1, 1), False)
    numbers, channels = call.settings, len(call.background)
    named = flat_tensors(splats)
    tensors = named | {
        "world_to_camera": cameras.world_to_camera[0].detach().contiguous(),
        "intrinsics": cameras.intrinsics[0].detach().contiguous(),
    }
    stride = -(-(SPLAT_CHANNELS + channels) // 4) * 4
    name = NAMES[like.dtype]
    shape = "Axes" if splats.covariances is None else "Symmetric3"
    ragged = "false" if named["offsets"] is None else "true"
    wide = {torch.float32: torch.int32, torch.float64: torch.int64}[like.dtype]
    projection = Projection(
        arguments=f"{name}, {shape}<{name}>, {numbers.sh_degree}, {ragged}",
        tensors=tensors,
        projected=torch.full((n, stride), torch.nan, dtype=like.dtype),
        depth_keys=torch.full((n,), 7, dtype=wide),
        tile_counts=torch.full((n,), -7, dtype=torch.int32),
        visible=torch.full((n,), 7, dtype=torch.uint8),
        radii=torch.full((n,), torch.nan, dtype=like.dtype),
        job=jobs.ProjectJob(),
        channels=channels,
    )
    projection.job = _job(projection, cameras, numbers)
    return projection


def projected(scene: Scene, launcher: EmulatedLauncher | None = None) -> Projection:
    """A projection that has been run, threads in order unless the launcher does otherwise."""
    projection = projection_of(*scene)
    projection.run(launcher or EmulatedLauncher())
    return projection


def _job(projection: Projection, cameras: Cameras, numbers: KernelSettings) -> jobs.ProjectJob:
    tensors = projection.tensors
    view = {
        name: getattr(numbers, name) for name, *_ in jobs.View._fields_ if hasattr(numbers, name)
    } | {"model": numbers.camera_model}
    columns, rows = -(-cameras.width // TILE), -(-cameras.height // TILE)
    widths = {name: 0 if held is None else held.shape[1:].numel() for name, held in tensors.items()}
    return jobs.ProjectJob(
        view=jobs.View(address(tensors["world_to_camera"]), address(tensors["intrinsics"]), **view),
        splats=jobs.SplatArrays(
            count=len(projection.radii),
            **{name: address(tensors[name]) for name in (*ROWS, "offsets")},
            rest_rows=0 if (rest := tensors["rest"]) is None else len(rest),
            color_stride=widths["colors"],
            rest_stride=widths["rest"],
            extras=widths["extra"],
            color_channels=3 if numbers.sh_degree >= 0 else widths["colors"],
            depth_channels=numbers.depth_channels,
        ),
        grid=jobs.Grid(cameras.width, cameras.height, columns, rows),
        level_min=numbers.level_min,
        bounded=numbers.alpha_min > 0,
        stride=projection.projected.shape[1],
        projected=address(projection.projected),
        depth_keys=address(projection.depth_keys),
        tile_counts=address(projection.tile_counts),
        visible=address(projection.visible),
        radii=address(projection.radii),
    )


def run_backward(
    launcher: EmulatedLauncher,
    projection: Projection,
    sums: Tensor,
    slot_ends: Tensor | None = None,
    before: dict[str, Tensor] | None = None,
    pose: bool = True,
    without: tuple[str, ...] = (),
) -> Backward:
    """Run ``project_backward`` on a projection that ``run`` has filled.

    Args:
        sums: [n, fields], or [slots, fields] if ``slot_ends`` is given.
        before: gradients that are added to; replaced by the sums.
        pose: whether the camera's gradient is wanted.
        without: gradients that are not wanted.
    """
    gradients = {
        name: torch.full_like(held, torch.nan) if before is None else before[name].clone()
        for name in ROWS
        if (held := projection.tensors[name]) is not None and name not in without
    }
    like = projection.radii
    written = Backward(
        gradients,
        screen_gradient=torch.zeros_like(like),
        absgrad=torch.zeros_like(like),
        pose=like.new_full((projection.blocks, POSE_FIELDS), torch.nan) if pose else None,
    )
    job = jobs.ProjectBackwardJob(
        forward=projection.job,
        sums=address(sums),
        sum_stride=sums.shape[1],
        channels=projection.channels,
        slot_ends=address(slot_ends),
        gradients=jobs.SplatGradients(**{name: address(gradients.get(name)) for name in ROWS}),
        screen_gradient=address(written.screen_gradient),
        absgrad=address(written.absgrad),
        pose=address(written.pose),
        accumulate=before is not None,
    )
    kernel = f"project_backward<{projection.arguments}, {'true' if pose else 'false'}>"
    launcher.launch(Kernel("project_backward.cu", kernel), projection.blocks, PROJECT_THREADS, job)
    return written


@dataclass
class Expected:
    """What the reference says, for visible rows alone."""

    rows: Tensor
    visible: Tensor
    ellipses: Ellipses
    extents: Tensor
    channels: Tensor
    """[m, d]: all that is rendered."""
    leaves: dict[str, Tensor]
    """What it can be differentiated by, in the shapes of ``Splats``."""


def reference_of(splats: Splats, cameras: Cameras, settings: RenderSettings) -> Expected:
    """Project with the reference, differentiably."""
    scene = splats.map(lambda tensor: tensor.detach().clone().requires_grad_())
    view = cameras.world_to_camera.detach().clone().requires_grad_()
    camera = replace(cameras, world_to_camera=view)
    with torch.no_grad():
        visible, _ = visible_extents(project(scene, camera, settings), camera, settings)
    rows = visible.nonzero()[:, 0]
    ellipses = project(scene, camera, settings, rows)
    _, extents = visible_extents(ellipses, camera, settings)
    parts = [view_colors(scene, camera, rows)]
    if scene.extra is not None:
        parts.append(scene.extra[rows])
    depths = ellipses.depths[:, None]
    names = {"none": [], "accumulated": [depths], "expected": [depths, torch.ones_like(depths)]}
    channels = torch.cat([*parts, *names[settings.depth.value]], dim=1)
    leaves = scene.tensors() | {"world_to_camera": view}
    return Expected(rows, visible, ellipses, extents, channels, leaves)
