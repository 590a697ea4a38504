"""Drawing: kernels as one differentiable function, whatever device they run on."""

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
from gsfw.rasterizers.painter import POSE_FIELDS, Painter, Picture, StageLog, TooManyPairs
from gsfw.rasterizers.request import PairLimit, Request, drawn_channels, request_of

INPUTS = (
    *("means", "quats", "scales", "covariances", "opacities"),
    *("colors", "rest", "extra", "world_to_camera"),
)
"""What a picture can be differentiated by; any of them may be ``None`` but the first."""

ROWS = INPUTS[:-1]
"""Those of the splats."""


def draw(
    painter: Painter,
    log: StageLog,
    pairs_mb: float,
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
) -> RenderOutput:
    """Draw checked inputs.

    Args:
        painter: the kernels.
        log: where the times of the stages go.
        pairs_mb: memory that pairs of a splat and a tile may take, in megabytes.
        splats: what is drawn.
        cameras: from where.
        settings: how.

    Raises:
        ConfigError: a picture has more pairs than that.
        ValueError: something is asked that kernels do not do.
    """
    _check(painter, cameras)
    statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
    channels, size = drawn_channels(splats, settings), splats.means.element_size()
    limit = PairLimit(pairs_mb, painter.pair_bytes(channels, size), painter.most_pairs)
    request = request_of(splats, cameras, settings, statistics, limit)
    inputs, offsets = _inputs(splats, cameras, constant=request.numbers["sh_degree"] == 0)
    wanted = torch.is_grad_enabled() and any(t is not None and t.requires_grad for t in inputs)
    request.numbers["differentiated"] = wanted
    image, alpha = _Draw.apply(painter, request, log, offsets, *inputs)
    return _output(image, alpha[..., None], splats, settings, statistics)


def _check(painter: Painter, cameras: Cameras) -> None:
    if cameras.intrinsics.requires_grad and torch.is_grad_enabled():
        raise ValueError(
            f"cameras.intrinsics: expected a tensor without gradient, because the {painter.name} "
            "rasterizer has none by intrinsics; use the reference rasterizer"
        )


class _Draw(torch.autograd.Function):
    """One picture per camera, which is kept for the way back."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        painter: Painter,
        request: Request,
        log: StageLog,
        offsets: Tensor | None,
        *tensors: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        cameras = request.cameras
        like = request.background
        shape = (len(cameras), cameras.height, cameras.width)
        image, alpha = like.new_empty(*shape, len(like)), like.new_empty(shape)
        arrays = dict(zip(INPUTS, tensors, strict=True)) | {"offsets": offsets}
        pictures = [
            _paint(painter, request, index, arrays, image, alpha) for index in range(len(cameras))
        ]
        log.record(pictures)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*tensors, offsets, image)
        ctx.request, ctx.log, ctx.pictures = request, log, pictures
        return image, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, image: Tensor | None, alpha: Tensor | None) -> Any:  # noqa: ANN401
        *inputs, _, drawn = ctx.saved_tensors
        tensors = dict(zip(INPUTS, inputs, strict=True))
        wanted = dict(zip(INPUTS, ctx.needs_input_grad[4:], strict=True))
        statistics = ctx.request.statistics
        cameras = ctx.request.cameras
        if image is None:
            like = ctx.request.background
            image = like.new_zeros(len(cameras), cameras.height, cameras.width, len(like))
        image = image.contiguous()
        gradients = {
            name: torch.empty_like(tensors[name]) if wanted[name] else None for name in ROWS
        }
        poses = image.new_zeros(len(cameras), POSE_FIELDS)
        for index, picture in enumerate(ctx.pictures):
            picture.backward(
                gradients
                | {
                    "drawn": drawn[index],
                    "image": image[index],
                    "alpha": None if alpha is None else alpha[index].contiguous(),
                    "accumulate": index > 0,
                    "pose": poses[index] if wanted["world_to_camera"] else None,
                    "screen_gradient": _row(statistics.screen_gradient, index),
                    "absgrad": _row(statistics.absgrad, index),
                }
            )
        ctx.log.record(ctx.pictures)
        pose = _pose_gradient(poses, cameras.world_to_camera) if wanted["world_to_camera"] else None
        return None, None, None, None, *gradients.values(), pose


def _row(tensor: Tensor | None, index: int) -> Tensor | None:
    return None if tensor is None else tensor[index]


def _paint(
    painter: Painter,
    request: Request,
    index: int,
    tensors: dict[str, Tensor | None],
    image: Tensor,
    alpha: Tensor,
) -> Picture:
    """Draw one camera's picture.

    Raises:
        ConfigError: it has more pairs of a splat and a tile than it may.
    """
    arrays = {name: None if held is None else held.detach() for name, held in tensors.items()}
    cameras = request.cameras
    arrays["world_to_camera"] = cameras.world_to_camera[index].detach().contiguous()
    arrays["intrinsics"] = cameras.intrinsics[index].detach().contiguous()
    arrays["background"] = request.background
    outputs = {
        "image": image[index],
        "alpha": alpha[index],
        "visible": request.statistics.visible[index],
        "radii": request.statistics.radii[index],
        "contribution": _row(request.statistics.contribution, index),
    }
    try:
        return painter.paint(arrays, request.numbers, outputs)
    except TooManyPairs as refused:
        raise request.refuse(refused.count) from None


def _pose_gradient(
    sums: Float[Tensor, "c 15"], world_to_camera: Float[Tensor, "c 4 4"]
) -> Float[Tensor, "c 4 4"]:
    """Put together what the kernels sum: by rotation, by translation, and by the camera centre.

    The centre is -R^T t, on which the direction of spherical harmonics depends.
    """
    rotation, translation = world_to_camera[:, :3, :3], world_to_camera[:, :3, 3]
    by_rotation, by_translation = sums[:, :9].view(-1, 3, 3), sums[:, 9:12]
    by_center = sums[:, 12:]
    gradient = torch.zeros_like(world_to_camera)
    gradient[:, :3, :3] = by_rotation - translation[:, :, None] * by_center[:, None, :]
    gradient[:, :3, 3] = by_translation - (rotation @ by_center[:, :, None])[:, :, 0]
    return gradient


def _inputs(
    splats: Splats, cameras: Cameras, constant: bool
) -> tuple[list[Tensor | None], Tensor | None]:
    """The tensors of ``INPUTS``, and the offsets of ragged colours, all contiguous.

    Rows of colours are flat. ``constant`` leaves out what is not drawn at degree 0.
    """
    colors, rest, offsets = splats.colors, None, None
    if isinstance(colors, Sh):
        if colors.rest is not None and not constant:
            rest, offsets = colors.rest.flatten(1), colors.offsets
        colors = colors.coefficients.flatten(1)
    tensors = [splats.means, splats.quats, splats.scales, splats.covariances, splats.opacities]
    tensors += [colors, rest, splats.extra, cameras.world_to_camera]
    flat = [None if tensor is None else tensor.contiguous() for tensor in tensors]
    return flat, None if offsets is None else offsets.contiguous()


def _output(
    image: Tensor,
    alpha: Tensor,
    splats: Splats,
    settings: RenderSettings,
    statistics: RenderStatistics,
) -> RenderOutput:
    """Take the drawn channels apart."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    color, extra, depth = image, None, None
    if image.shape[-1] > splats.channels:
        color, extra, depth = image.tensor_split([splats.channels, splats.channels + extras], dim=3)
    if settings.background is not None and settings.background.requires_grad:
        color = color + (1.0 - alpha) * settings.background
    if depth is not None and settings.depth is Depth.EXPECTED:
        depth = depth[..., :1] / depth[..., 1:].clamp(min=settings.profile.depth_epsilon)
    return RenderOutput(
        color=color,
        alpha=alpha,
        statistics=statistics,
        depth=None if settings.depth is Depth.NONE else depth,
        extra=None if splats.extra is None else extra,
    )
