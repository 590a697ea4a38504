"""Autograd: the kernels of a backend as one differentiable function."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.cameras import Cameras
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.kernels.render_arguments import (
    POSE_FIELDS,
    KernelGradients,
    SplatArrays,
    SplatGradients,
)
from gsfw.kernels.tangents import has_tangents
from gsfw.rasterizers.kernel_arguments import (
    PairLimit,
    RenderCall,
    active_degree,
    render_call,
    rendered_channels,
    row_of,
)
from gsfw.rasterizers.kernel_backend import ForwardPass, KernelBackend, StageLog, TooManyPairs


def render(
    backend: KernelBackend,
    log: StageLog,
    pairs_mb: float,
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
) -> RenderOutput:
    """Render checked inputs, differentiably.

    Args:
        backend: the kernels.
        log: takes the times of the stages.
        pairs_mb: memory for tile intersections (pairs of a splat and a tile), in megabytes.
        splats: the splats.
        cameras: the cameras, each of which gives one image.
        settings: the settings of the call.

    Raises:
        ConfigError: an image has more tile intersections than fit into ``pairs_mb``.
        ValueError: an input has a property that the kernels do not support.
    """
    check_cameras(backend.name, cameras)
    statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
    limit = pair_limit(backend, pairs_mb, splats, settings)
    inputs, offsets = flat_inputs(splats, cameras)
    wanted = torch.is_grad_enabled() and any(t is not None and t.requires_grad for t in inputs)
    call = render_call(splats, cameras, settings, statistics, limit, wanted)
    if wanted or has_tangents(inputs):  # Autograd refuses tangents.
        image, alpha = _Render.apply(backend, call, log, offsets, *inputs)
    else:  # The host needs as long for a node of autograd as for a stage.
        image, alpha, _ = _images(backend, call, log, offsets, *inputs)
    return composed(image, alpha[..., None], splats, settings, statistics)


def pair_limit(
    backend: KernelBackend, pairs_mb: float, splats: Splats, settings: RenderSettings
) -> PairLimit:
    """Most tile intersections that fit into ``pairs_mb`` megabytes."""
    channels, size = rendered_channels(splats, settings), splats.means.element_size()
    return PairLimit(pairs_mb, backend.pair_bytes(channels, size), backend.max_pairs)


def check_cameras(rasterizer: str, cameras: Cameras) -> None:
    """Refuse cameras whose intrinsics want gradients."""
    if cameras.intrinsics.requires_grad and torch.is_grad_enabled():
        raise ValueError(
            f"cameras.intrinsics: expected a tensor without gradient, because the {rasterizer} "
            "rasterizer has none by intrinsics; use the reference rasterizer"
        )


def flat_inputs(splats: Splats, cameras: Cameras) -> tuple[list[Tensor | None], Tensor | None]:
    """The tensors that an image can be differentiated by, and the offsets of ragged colours.

    All are contiguous, in the order of ``SplatGradients``, the pose last. Rows of colours are flat.
    Coefficients that the active degree leaves out entirely are left out.
    """
    colors, rest, offsets = splats.colors, None, None
    if isinstance(colors, Sh):
        if colors.rest is not None and active_degree(colors) != 0:
            rest, offsets = colors.rest.flatten(1), colors.offsets
        colors = colors.coefficients.flatten(1)
    tensors = [splats.means, splats.quats, splats.scales, splats.covariances, splats.opacities]
    tensors += [colors, rest, splats.extra, cameras.world_to_camera]
    flat = [None if tensor is None else tensor.contiguous() for tensor in tensors]
    return flat, None if offsets is None else offsets.contiguous()


class _Render(torch.autograd.Function):
    """One image per camera, each kept for the backward pass."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        backend: KernelBackend,
        call: RenderCall,
        log: StageLog,
        offsets: Tensor | None,
        *tensors: Any,  # noqa: ANN401 - a tensor or None, by position.
    ) -> tuple[Tensor, Tensor]:
        image, alpha, passes = _images(backend, call, log, offsets, *tensors)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*tensors, offsets, image)
        ctx.call, ctx.log, ctx.passes = call, log, passes
        return image, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, image: Tensor | None, alpha: Tensor | None) -> Any:  # noqa: ANN401
        *inputs, _, _, rendered = ctx.saved_tensors
        *rows_wanted, pose_wanted = ctx.needs_input_grad[4:]
        call: RenderCall = ctx.call
        image = torch.zeros_like(rendered) if image is None else image.contiguous()
        gradients = [
            torch.empty_like(tensor) if wanted else None
            for tensor, wanted in zip(inputs, rows_wanted, strict=True)
        ]
        poses = image.new_zeros(len(call.cameras), POSE_FIELDS) if pose_wanted else None
        for index, one in enumerate(ctx.passes):
            one.backward(
                KernelGradients(
                    rendered=rendered[index],
                    image=image[index],
                    alpha=None if alpha is None else alpha[index].contiguous(),
                    splats=SplatGradients(*gradients),
                    accumulate=index > 0,
                    pose=row_of(poses, index),
                    screen_gradient=row_of(call.statistics.screen_gradient, index),
                    absgrad=row_of(call.statistics.absgrad, index),
                )
            )
        ctx.log.record(ctx.passes)
        pose = None if poses is None else pose_gradient(poses, call.cameras.world_to_camera)
        return None, None, None, None, *gradients, pose


def _images(
    backend: KernelBackend,
    call: RenderCall,
    log: StageLog,
    offsets: Tensor | None,
    *tensors: Any,  # noqa: ANN401 - a tensor or None, by position.
) -> tuple[Tensor, Tensor, list[ForwardPass]]:
    """Images and alphas of all cameras, and their forward passes."""
    cameras, like = call.cameras, call.background
    shape = (len(cameras), cameras.height, cameras.width)
    image, alpha = like.new_empty(*shape, len(like)), like.new_empty(shape)
    arrays: list[Any] = [*tensors[:-1], offsets]
    splats = SplatArrays(*arrays)
    passes = [
        _render_one(backend, call, splats, image, alpha, index) for index in range(len(cameras))
    ]
    log.record(passes)
    return image, alpha, passes


def _render_one(
    backend: KernelBackend,
    call: RenderCall,
    splats: SplatArrays,
    image: Tensor,
    alpha: Tensor,
    index: int,
) -> ForwardPass:
    """Render the image of camera ``index``.

    Raises:
        ConfigError: it has more tile intersections than it may have.
    """
    inputs, outputs = call.inputs(splats, index), call.outputs(image, alpha, index)
    try:
        return backend.render(inputs, call.settings, outputs)
    except TooManyPairs as refused:
        raise call.limit.refuse(refused.count) from None


def pose_gradient(
    sums: Float[Tensor, "c 15"], world_to_camera: Float[Tensor, "c 4 4"]
) -> Float[Tensor, "c 4 4"]:
    """Join the sums of the kernels: by rotation, by translation, and by the camera centre.

    The centre is -R^T t, on which the directions of spherical harmonics depend.
    """
    rotation, translation = world_to_camera[:, :3, :3], world_to_camera[:, :3, 3]
    by_rotation, by_translation = sums[:, :9].view(-1, 3, 3), sums[:, 9:12]
    by_center = sums[:, 12:]
    gradient = torch.zeros_like(world_to_camera)
    gradient[:, :3, :3] = by_rotation - translation[:, :, None] * by_center[:, None, :]
    gradient[:, :3, 3] = by_translation - (rotation @ by_center[:, :, None])[:, :, 0]
    return gradient


def composed(
    image: Tensor,
    alpha: Tensor,
    splats: Splats,
    settings: RenderSettings,
    statistics: RenderStatistics,
) -> RenderOutput:
    """The outputs of rendered channels, with a background that is learned behind the colours."""
    color, depth, extra = split_channels(image, splats, settings)
    if settings.background is not None and settings.background.requires_grad:
        color = color + (1.0 - alpha) * settings.background
    if depth is not None and settings.depth is Depth.EXPECTED:
        depth = depth[..., :1] / depth[..., 1:].clamp(min=settings.profile.depth_epsilon)
    return RenderOutput(color, alpha, statistics, depth, extra)


def split_channels(
    image: Float[Tensor, "c h w d"], splats: Splats, settings: RenderSettings
) -> tuple[Tensor, Tensor | None, Tensor | None]:
    """Colour, depth and extra channels of an image; ``None`` for those that are not rendered."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    if image.shape[-1] == splats.channels:
        return image, None, None
    color, extra, depth = image.tensor_split([splats.channels, splats.channels + extras], dim=3)
    return (
        color,
        None if settings.depth is Depth.NONE else depth,
        None if splats.extra is None else extra,
    )
