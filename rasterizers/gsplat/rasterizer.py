"""The gsplat rasterizer: hands splats to ``gsplat.rasterization``, and takes its result apart.

gsplat (Ye et al. 2024, arXiv 2409.06765) is called as versions 1.5.3 and 1.6.0 document it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.rasterizers.autograd import check_cameras, split_channels
from gsfw.rasterizers.gsplat import package
from gsfw.rasterizers.gsplat.arguments import arguments_of, rendered_channels

DEVICES = frozenset({"cuda"})

LACKING = frozenset({Feature.FLOAT64})

ABSGRAD_CHANNELS = 32
"""gsplat renders this many channels in a pass, and each pass overwrites the absgrad of the last."""


class GsplatRasterizer(Rasterizer):
    """Renders in float32 on GPUs, as the gsplat that is installed does.

    It differs from the other backends in what is not its own: ``radii`` are gsplat's, rounded up
    to whole pixels, and a splat counts as visible that reaches the image only by that rounding.
    Splats that no finite ellipse comes of (quaternions of norm 0, say) are treated as gsplat
    treats them. The gradient statistics are written by the first backward pass that reaches the
    splats' centres, sizes or rotations, or the pose.
    """

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Found out without importing gsplat."""
        installed = package.version()
        return Capabilities(
            devices=DEVICES,
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature) - LACKING,
            profile=package.profile(installed).name,
            determinism=Determinism.NONE,
            preference=15,
            unavailable=package.unavailable(),
            details={"gsplat": installed} if installed else {},
        )

    @cached_property
    def _version(self) -> str:
        return package.version()

    @cached_property
    def _gsplat(self) -> Any:  # noqa: ANN401 - a module without types
        return package.load()

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        _check_inputs(splats, cameras)
        _check_settings(splats, settings, self._version)
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        if len(splats) == 0:
            # gsplat divides by their number (ProjectionEWA3DGSFused.cu, line 239 in 1.5.3), which
            # ends the process.
            image, alpha = _nothing(splats, cameras, settings)
            color, depth, extra = split_channels(image, splats, settings)
            return RenderOutput(color, alpha, statistics, depth, extra)
        image, alpha, meta = self._gsplat.rasterization(**arguments_of(splats, cameras, settings))
        radii = meta["radii"].detach()
        statistics.radii.copy_(radii.amax(2))
        statistics.visible.copy_((radii > 0).all(2))
        _record_gradients(meta["means2d"], statistics, cameras)
        if statistics.contribution is not None:
            statistics.contribution.copy_(self._contribution(splats, cameras, settings))
        color, depth, extra = split_channels(image, splats, settings)
        return RenderOutput(color, alpha, statistics, depth, extra)

    def _contribution(
        self, splats: Splats, cameras: Cameras, settings: RenderSettings
    ) -> Float[Tensor, "c n"]:
        """Sum blending weights over pixels, in a second pass.

        gsplat returns no weights. An image is linear in its colours, so the weights are the
        derivatives of a channel in which every splat shows 1.
        """
        pose = cameras.world_to_camera.detach()
        arguments = arguments_of(
            splats.map(torch.Tensor.detach),
            replace(cameras, world_to_camera=pose),
            replace(settings, background=None, depth=Depth.NONE, statistics=frozenset()),
        )
        with torch.enable_grad():
            ones = splats.means.new_ones(len(cameras), len(splats), 1).requires_grad_()
            arguments |= {"colors": ones, "sh_degree": None}
            image, _, _ = self._gsplat.rasterization(**arguments)
        weights = settings.contribution_weights
        weights = torch.ones_like(image) if weights is None else weights.detach()
        return torch.autograd.grad(image, ones, weights)[0][:, :, 0]


def _check_inputs(splats: Splats, cameras: Cameras) -> None:
    """Refuse what gsplat cannot render.

    Raises:
        ValueError: naming the field, what was expected and what was found.
    """
    if splats.means.device.type not in DEVICES:
        raise ValueError(
            f"splats.means: expected a tensor on a GPU, found one on {splats.means.device}"
        )
    if splats.means.dtype != torch.float32:
        raise ValueError(
            f"splats.means: expected float32, which is all that gsplat renders, found "
            f"{splats.means.dtype}"
        )
    check_cameras("gsplat", cameras)


def _check_settings(splats: Splats, settings: RenderSettings, installed: str) -> None:
    """Refuse settings that gsplat would not follow.

    Raises:
        ValueError: naming the setting, what was expected and what was found.
    """
    own, asked = package.profile(installed), settings.profile
    if replace(asked, name=own.name, dilation=own.dilation) != own:
        raise ValueError(
            f"settings.profile: expected {own.name!r}, because gsplat {installed} renders with no "
            f"other constants, found {asked.name!r}; use profile={own.name}, or another rasterizer"
        )
    channels = rendered_channels(splats, settings)
    if Statistic.ABSGRAD in settings.statistics and channels > ABSGRAD_CHANNELS:
        raise ValueError(
            f"settings.statistics: gsplat measures absgrad over at most {ABSGRAD_CHANNELS} "
            f"channels, found {channels}; use another rasterizer"
        )


def _nothing(
    splats: Splats, cameras: Cameras, settings: RenderSettings
) -> tuple[Float[Tensor, "c h w d"], Float[Tensor, "c h w 1"]]:
    """The image and alpha of no splats; they hang on the splats, so that backward runs."""
    empty = torch.stack([tensor.sum() for tensor in splats.tensors().values()]).sum()
    alpha = splats.means.new_zeros(len(cameras), cameras.height, cameras.width, 1) + empty
    image = alpha.expand(-1, -1, -1, rendered_channels(splats, settings))
    if settings.background is not None:
        others = image.shape[-1] - splats.channels
        image = image + torch.cat([settings.background, settings.background.new_zeros(others)])
    return image, alpha


def _record_gradients(
    centres: Float[Tensor, "c n 2"], statistics: RenderStatistics, cameras: Cameras
) -> None:
    """Have backward write the gradient statistics from those of the ``centres``, in pixels."""
    screen_gradient, absgrad = statistics.screen_gradient, statistics.absgrad
    if not centres.requires_grad or (screen_gradient is None and absgrad is None):
        return

    def in_ndc(pixels: Tensor) -> Tensor:
        x, y = pixels.unbind(2)
        return torch.hypot(0.5 * cameras.width * x, 0.5 * cameras.height * y)

    def record(gradient: Tensor) -> None:
        # The hook holds the centres, which hold the hook: unbroken, this cycle would keep GPU
        # memory until Python looks for cycles. Nothing else keeps the centres until here.
        hook.remove()
        if screen_gradient is not None:
            screen_gradient.copy_(in_ndc(gradient))
        if absgrad is not None:
            absolute: Tensor = centres.absgrad  # type: ignore[attr-defined]  # Set by gsplat.
            absgrad.copy_(in_ndc(absolute))

    hook = centres.register_hook(record)
