"""Drawing: the native kernels as one differentiable function."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.rasterizer import StageTime
from gsfw.kernels.cpu.native_module import native
from gsfw.rasterizers.cpu.request import Request

INPUTS = (
    *("means", "quats", "scales", "covariances", "opacities"),
    *("colors", "rest", "extra", "world_to_camera"),
)
"""What a picture can be differentiated by; any of them may be ``None`` but the first."""

ROWS = INPUTS[:-1]
"""Those with a row per splat."""


class StageLog(dict[str, StageTime]):
    """What the stages of the latest call took, summed over its cameras."""

    def record(self, pictures: Sequence[Any]) -> None:
        """Read the clocks of some pictures, replacing what was read before."""
        self.clear()
        for picture in pictures:
            for name, (cpu, wall) in picture.times().items():
                before = self.get(name, StageTime(0.0, 0.0))
                self[name] = StageTime(before.cpu_ms + cpu, before.wall_ms + wall)


def draw(
    request: Request, log: StageLog, tensors: Sequence[Tensor | None]
) -> tuple[Float[Tensor, "c h w d"], Float[Tensor, "c h w"]]:
    """Draw every channel over the request's background, and alpha.

    Args:
        request: what is wanted.
        log: where the times of the stages go.
        tensors: those of ``INPUTS``, contiguous, colours in flat rows.
    """
    image, alpha = _Draw.apply(request, log, *tensors)
    return image, alpha


class _Draw(torch.autograd.Function):
    """One native picture per camera, which is kept for the way back."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        request: Request,
        log: StageLog,
        *tensors: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        cameras = request.cameras
        like = request.background
        shape = (len(cameras), cameras.height, cameras.width)
        image, alpha = like.new_empty(*shape, len(like)), like.new_empty(shape)
        pictures = [
            _paint(request, index, dict(zip(INPUTS, tensors, strict=True)), image, alpha)
            for index in range(len(cameras))
        ]
        log.record(pictures)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*tensors)
        ctx.request, ctx.log, ctx.pictures = request, log, pictures
        return image, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, image: Tensor | None, alpha: Tensor | None) -> Any:  # noqa: ANN401
        tensors = dict(zip(INPUTS, ctx.saved_tensors, strict=True))
        wanted = dict(zip(INPUTS, ctx.needs_input_grad[2:], strict=True))
        statistics = ctx.request.statistics
        cameras = ctx.request.cameras
        if image is None:
            like = ctx.request.background
            image = like.new_zeros(len(cameras), cameras.height, cameras.width, len(like))
        image = image.contiguous()
        gradients = {
            name: torch.empty_like(tensors[name]) if wanted[name] else None for name in ROWS
        }
        poses = image.new_zeros(len(cameras), _native().POSE_FIELDS)
        for index, picture in enumerate(ctx.pictures):
            picture.backward(
                gradients
                | {
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
        return None, None, *gradients.values(), pose


def _native() -> Any:  # noqa: ANN401
    module = native()
    assert module is not None, "the capabilities say that there is none"
    return module


def _row(tensor: Tensor | None, index: int) -> Tensor | None:
    return None if tensor is None else tensor[index]


def _paint(
    request: Request,
    index: int,
    tensors: dict[str, Tensor | None],
    image: Tensor,
    alpha: Tensor,
) -> Any:  # noqa: ANN401
    """Draw one camera's picture.

    Raises:
        ConfigError: it has more pairs of a splat and a tile than it may.
    """
    module = _native()
    kind = module.DrawingFloat32 if image.dtype == torch.float32 else module.DrawingFloat64
    arrays = {name: None if held is None else held.detach() for name, held in tensors.items()}
    arrays["world_to_camera"] = request.cameras.world_to_camera[index].detach()
    arrays["intrinsics"] = request.cameras.intrinsics[index].detach()
    arrays["background"] = request.background
    for name in ("world_to_camera", "intrinsics"):
        arrays[name] = arrays[name].contiguous()  # type: ignore[union-attr]
    outputs = {
        "image": image[index],
        "alpha": alpha[index],
        "visible": request.statistics.visible[index],
        "radii": request.statistics.radii[index],
        "contribution": _row(request.statistics.contribution, index),
    }
    try:
        return kind(arrays, request.numbers, outputs)
    except module.TooManyPairs as refused:
        raise request.refuse(refused.args[0]) from None


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
