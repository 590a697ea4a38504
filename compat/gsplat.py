"""The interface of gsplat's ``rasterization``, on any backend of gsfw.

    from gsfw.compat.gsplat import rasterization

``info`` has what gsplat's strategies read. Differences from gsplat 1.5: gradients by ``Ks`` exist;
``info["means2d"].absgrad`` has the norm of the sums of absolute gradients in column 0 and zeros in
column 1, as strategies read the norm; lists of tiles are not in ``info``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.api import NumericsProfile, RenderOutput, Statistic
from gsfw.compat.gsplat_info import Info, Projected, attach_absolute_gradient, make_info
from gsfw.compat.gsplat_projection import (
    MODELS,
    GsplatCamera,
    axis_radii,
    covariances_in_image,
)
from gsfw.compat.refusal import refuse, refuse_unknown
from gsfw.compat.screen import (
    ScreenSplats,
    ScreenView,
    compensation,
    dilated,
    render_screen,
    view_colors,
)

NAME = "rasterization"
MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
ALPHA_FLOOR = 1e-10
"""Floor of the accumulated alpha, the divisor of expected depth."""


@dataclass(frozen=True)
class _Gaussians:
    """The splats of a call, with gsplat's names."""

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"] | None
    scales: Float[Tensor, "n 3"] | None
    opacities: Float[Tensor, " n"]
    colors: Tensor
    covars: Float[Tensor, "n 3 3"] | None


@dataclass(frozen=True)
class _Conventions:
    """The settings of a call, with gsplat's names."""

    planes: tuple[float, float]
    """Depths between which splats are seen."""
    radius_clip: float
    sh_degree: int | None
    packed: bool
    render_mode: str
    absgrad: bool
    antialiased: bool
    profile: NumericsProfile


def rasterization(
    means: Float[Tensor, "*b n 3"],
    quats: Float[Tensor, "n 4"] | None,
    scales: Float[Tensor, "n 3"] | None,
    opacities: Float[Tensor, " n"],
    colors: Float[Tensor, ...],
    viewmats: Float[Tensor, "c 4 4"],
    Ks: Float[Tensor, "c 3 3"],
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int | None = None,
    backgrounds: Float[Tensor, "c d"] | None = None,
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,
    covars: Float[Tensor, "n 3 3"] | None = None,
    **newer: Any,  # noqa: ANN401
) -> tuple[Float[Tensor, "c h w x"], Float[Tensor, "c h w 1"], Info]:
    """Images, alphas and ``info`` of ``c`` cameras; arguments as gsplat documents them.

    ``tile_size``, ``channel_chunk`` and ``segmented`` change no image, and nothing here. An
    argument or value that is not served raises ``UnservedArgument``, with its name.
    """
    _check_flags(newer, sparse_grad, distributed, means)
    _check_choices(render_mode, rasterize_mode, camera_model)
    gaussians = _Gaussians(means, quats, scales, opacities, colors, covars)
    conventions = _Conventions(
        planes=(near_plane, far_plane),
        radius_clip=radius_clip,
        sh_degree=sh_degree,
        packed=packed,
        render_mode=render_mode,
        absgrad=absgrad,
        antialiased=rasterize_mode == "antialiased",
        profile=dilated(eps2d),
    )
    cameras = _cameras(viewmats, Ks, width, height, camera_model)
    return _render(gaussians, cameras, conventions, backgrounds)


def rasterization_2dgs(*_: object, **__: object) -> None:
    """Refuse 2D Gaussian splatting, so that scripts that only import it run.

    Raises:
        UnservedArgument: always.
    """
    raise refuse("gsplat", "rasterization_2dgs", "Use rasterization, or the original package.")


def _render(
    gaussians: _Gaussians,
    cameras: list[GsplatCamera],
    conventions: _Conventions,
    backgrounds: Float[Tensor, "c d"] | None,
) -> tuple[Tensor, Tensor, Info]:
    """Project for all cameras, render each, and join the results."""
    projected = [
        _project(gaussians, camera, conventions, index) for index, camera in enumerate(cameras)
    ]
    join: Callable[[list[Tensor]], Tensor] = torch.cat if conventions.packed else torch.stack
    # Strategies retain the gradient of this tensor: the images have to depend on it.
    means2d = join([one.splats.means for one in projected])
    lengths = [len(one.splats.means) for one in projected]
    parts = means2d.split(lengths) if conventions.packed else means2d.unbind(0)
    outputs = [
        _image(
            replace(one.splats, means=part),
            camera,
            conventions,
            None if backgrounds is None else backgrounds[index],
        )
        for index, (one, part, camera) in enumerate(zip(projected, parts, cameras, strict=True))
    ]
    if conventions.absgrad:
        attach_absolute_gradient(means2d, outputs, cameras[0], join)
    images = [_channels(output, conventions.render_mode) for output in outputs]
    alphas = torch.cat([output.alpha for output in outputs])
    info = make_info(projected, means2d, join, cameras, conventions.profile.dilation)
    return torch.cat(images), alphas, info


def _cameras(
    views: Float[Tensor, "c 4 4"],
    intrinsics: Float[Tensor, "c 3 3"],
    width: int,
    height: int,
    model: str,
) -> list[GsplatCamera]:
    """The cameras of a call, one by one."""
    return [
        GsplatCamera(view, matrix, width, height, model)
        for view, matrix in zip(views, intrinsics, strict=True)
    ]


def _project(
    gaussians: _Gaussians, camera: GsplatCamera, conventions: _Conventions, index: int
) -> Projected:
    """Project the splats for the camera of this number."""
    points = camera.in_camera(gaussians.means)
    depths = points[:, 2]
    near, far = conventions.planes
    in_range = (depths > near) & (depths < far)
    # Others may be at depth 0: they take a place that has finite derivatives, and get none.
    ahead = points.new_tensor([0.0, 0.0, 1.0])
    means, jacobian = camera.project(torch.where(in_range[:, None], points, ahead))
    covariances = covariances_in_image(
        camera, gaussians.quats, gaussians.scales, gaussians.covars, jacobian
    )
    opacities = gaussians.opacities
    if conventions.antialiased:
        opacities = opacities * compensation(covariances, conventions.profile)
    radii = axis_radii(
        means.detach(),
        covariances.detach(),
        opacities.detach(),
        in_range,
        camera,
        conventions.profile,
    )
    visible = (radii > 0).all(1) & (radii > conventions.radius_clip).any(1)
    radii = torch.where(visible[:, None], radii, 0)
    colors = _colors(gaussians, camera, conventions, index)
    if conventions.render_mode != "RGB":
        colors = torch.cat([colors, depths[:, None]], dim=1)
    splats = ScreenSplats(means, depths, covariances, opacities, colors, visible)
    if not conventions.packed:
        return Projected(splats, radii, None)
    rows = visible.nonzero()[:, 0]
    return Projected(_taken(splats, rows), radii[rows], rows)


def _taken(splats: ScreenSplats, rows: Int[Tensor, " m"]) -> ScreenSplats:
    """Some of the splats."""
    return ScreenSplats(
        splats.means.index_select(0, rows),
        splats.depths.index_select(0, rows),
        splats.covariances.index_select(1, rows),
        splats.opacities.index_select(0, rows),
        splats.channels.index_select(0, rows),
        splats.visible.index_select(0, rows),
    )


def _colors(
    gaussians: _Gaussians, camera: GsplatCamera, conventions: _Conventions, index: int
) -> Float[Tensor, "n d"]:
    """Colours in one image; none for images of depth alone."""
    colors, degree = gaussians.colors, conventions.sh_degree
    if conventions.render_mode in ("D", "ED"):
        return gaussians.means.new_zeros(len(gaussians.means), 0)
    per_camera = colors.dim() == (3 if degree is None else 4)
    own = colors[index] if per_camera else colors
    if degree is None:
        return own
    return view_colors(own, degree, gaussians.means - camera.center)


def _image(
    splats: ScreenSplats,
    camera: GsplatCamera,
    conventions: _Conventions,
    background: Float[Tensor, " d"] | None,
) -> RenderOutput:
    """Render one camera; depth is the last channel, over a background of 0."""
    if background is not None and conventions.render_mode != "RGB":
        colors = splats.channels.shape[1] - 1
        background = torch.cat([background[:colors], background.new_zeros(1)])
    view = ScreenView(
        width=camera.width,
        height=camera.height,
        background=background,
        profile=conventions.profile,
        statistics=frozenset({Statistic.ABSGRAD} if conventions.absgrad else ()),
    )
    return render_screen(splats, view)


def _channels(output: RenderOutput, mode: str) -> Float[Tensor, "1 h w x"]:
    """The channels of a mode."""
    if not mode.endswith("ED"):
        return output.color
    depth = output.color[..., -1:] / output.alpha.clamp_min(ALPHA_FLOOR)
    return torch.cat([output.color[..., :-1], depth], dim=-1)


def _is_set(name: str, value: object) -> bool:
    """True for a value that asks for something else than gsplat's own default."""
    return value is not None and value is not (name == "global_z_order")


def _check_flags(
    newer: Mapping[str, Any], sparse_grad: bool, distributed: bool, means: Tensor
) -> None:
    """Refuse what is asked for by a flag, a shape, or an argument of newer versions.

    Raises:
        UnservedArgument: there is such a one.
    """
    refuse_unknown(NAME, {name: value for name, value in newer.items() if _is_set(name, value)})
    if sparse_grad:
        raise refuse(NAME, "sparse_grad=True", "Use dense gradients and torch.optim.Adam.")
    if distributed:
        raise refuse(NAME, "distributed=True", "Use one process, with gradient accumulation.")
    if means.dim() != 2:
        raise refuse(
            NAME, f"batch dimensions (means {list(means.shape)})", "Call it once for each scene."
        )


def _check_choices(render_mode: str, rasterize_mode: str, camera_model: str) -> None:
    """Refuse values that are not served.

    Raises:
        UnservedArgument: there is one.
    """
    for argument, value, served in (
        ("render_mode", render_mode, MODES),
        ("rasterize_mode", rasterize_mode, ("classic", "antialiased")),
        ("camera_model", camera_model, MODELS),
    ):
        if value not in served:
            raise refuse(NAME, f"{argument}={value!r}", f"Served: {', '.join(served)}.")
