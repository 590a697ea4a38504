"""Arguments of the rendering kernels, which the CPU and the CUDA kernels share.

All tensors are contiguous and have the dtype and device of the means. ``None`` stands for what is
absent or not wanted. One image has ``h`` x ``w`` pixels and ``d`` channels: colour, extra, depth.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.kernels.cuda.source_files import constant, enumerators

POSE_FIELDS = constant("stages.h", "POSE_FIELDS")
"""Numbers of a pose gradient: by rotation [3, 3], by translation [3], and by the camera centre [3],
on which the directions of spherical harmonics depend."""

CAMERA_MODELS = enumerators("camera.h", "CameraModel")
"""Numbers of the camera models, by lower-case name."""


@dataclass(frozen=True)
class KernelSettings:
    """The plain numbers of one image."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    camera_model: int
    """One of ``CAMERA_MODELS``."""
    sh_degree: int
    """Active degree of the spherical harmonics; -1 for plain channels."""
    depth_channels: int
    """0, 1 for depth, or 2 for depth and a channel of ones, after all other channels."""
    near: float
    """Least view depth of a rendered splat, in scene units."""
    far: float
    """Largest view depth of a rendered splat, in scene units."""
    antialias: bool
    """True if opacities are compensated for the dilation."""
    dilation: float
    """``NumericsProfile.dilation``, in pixels squared."""
    compensation_min: float
    """``NumericsProfile.compensation_min``."""
    jacobian_margin: float
    """``NumericsProfile.jacobian_margin``."""
    alpha_min: float
    """``NumericsProfile.alpha_min``; with 0 every splat in front reaches the whole image."""
    level_min: float
    """log2 of the least alpha that is rendered."""
    alpha_cap: float
    """Alpha is clamped here."""
    alpha_limit: float
    """The gradient of alpha is 0 above this."""
    transmittance_min: float
    """A pixel is finished before its transmittance would fall to this."""
    length_max: float
    """``LENGTH_MAX``, in scene units and in pixels."""
    quaternion_min_norm: float
    """``QUATERNION_MIN_NORM``."""
    differentiated: bool
    """True if a backward pass may follow."""
    max_pairs: int
    """Most tile intersections, pairs of a splat and a tile, for which there is memory."""


@dataclass(frozen=True)
class SplatArrays:
    """Splats in the layout of the kernels."""

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"] | None
    scales: Float[Tensor, "n 3"] | None
    covariances: Float[Tensor, "n 3 3"] | None
    """Instead of quats and scales."""
    opacities: Float[Tensor, " n"]
    colors: Float[Tensor, "n k"]
    """Channels, or spherical harmonics, coefficient after coefficient; only the constant one where
    ``rest`` has the others."""
    rest: Float[Tensor, "m r"] | None
    """m = n, or, with ``offsets``, one row of 3 per coefficient."""
    extra: Float[Tensor, "n e"] | None
    offsets: Int[Tensor, " n_plus_1"] | None
    """Rows of ``rest`` of each splat, rising from 0 to m."""

    def detached(self) -> SplatArrays:
        """The same arrays without a graph."""
        held: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        return replace(self, **{k: t.detach() for k, t in held.items() if t is not None})


@dataclass(frozen=True)
class KernelInputs:
    """The tensors that one image is rendered from."""

    splats: SplatArrays
    world_to_camera: Float[Tensor, "4 4"]
    intrinsics: Float[Tensor, "3 3"]
    background: Float[Tensor, " d"]
    pixel_weights: Float[Tensor, "h w"] | None
    """Weight of each pixel in ``KernelOutputs.contribution``; ``None`` for ones."""

    def detached(self) -> KernelInputs:
        """The same inputs without a graph, for kernels that take tensors and not addresses."""
        pose = self.world_to_camera.detach()
        intrinsics = self.intrinsics.detach()
        splats = self.splats.detached()
        return replace(self, splats=splats, world_to_camera=pose, intrinsics=intrinsics)


@dataclass(frozen=True)
class KernelOutputs:
    """The tensors that the forward pass writes."""

    image: Float[Tensor, "h w d"]
    alpha: Float[Tensor, "h w"]
    visible: Bool[Tensor, " n"]
    radii: Float[Tensor, " n"]
    contribution: Float[Tensor, " n"] | None


@dataclass(frozen=True)
class SplatGradients:
    """The tensors that take the gradients of ``SplatArrays``, in its layout."""

    means: Float[Tensor, "n 3"] | None
    quats: Float[Tensor, "n 4"] | None
    scales: Float[Tensor, "n 3"] | None
    covariances: Float[Tensor, "n 3 3"] | None
    opacities: Float[Tensor, " n"] | None
    colors: Float[Tensor, "n k"] | None
    rest: Float[Tensor, "m r"] | None
    extra: Float[Tensor, "n e"] | None


@dataclass(frozen=True)
class KernelGradients:
    """The gradients that the backward pass reads, and the tensors that it writes."""

    rendered: Float[Tensor, "h w d"]
    """The image of the forward pass."""
    image: Float[Tensor, "h w d"]
    """Gradient of the image."""
    alpha: Float[Tensor, "h w"] | None
    """Gradient of alpha; ``None`` for zeros."""
    splats: SplatGradients
    accumulate: bool
    """True if gradients of splats are added to (further cameras) instead of replaced."""
    pose: Float[Tensor, " p"] | None
    """p = POSE_FIELDS."""
    screen_gradient: Float[Tensor, " n"] | None
    absgrad: Float[Tensor, " n"] | None


@dataclass(frozen=True)
class RowOutputs:
    """The tensors that the projection of some rows writes."""

    visible: Bool[Tensor, " n"]
    radii: Float[Tensor, " n"]


@dataclass(frozen=True)
class PackedRows:
    """The projected splats of some rows, band after band."""

    rows: Float[Tensor, "m k"]


@dataclass(frozen=True)
class RowGradients:
    """The sums of bands that the backward pass of projection reads, and the tensors it writes."""

    sums: Float[Tensor, "m s"]
    splats: SplatGradients
    accumulate: bool
    """True if gradients of splats are added to (further images) instead of replaced."""
    pose: Float[Tensor, " p"] | None
    screen_gradient: Float[Tensor, " n"] | None
    absgrad: Float[Tensor, " n"] | None
    contribution: Float[Tensor, " n"] | None


@dataclass(frozen=True)
class BandInputs:
    """The tensors that one band of an image is blended from."""

    rows: Float[Tensor, "m k"]
    top: int
    """First row of pixels in the image."""
    background: Float[Tensor, " d"]
    pixel_weights: Float[Tensor, "h w"] | None


@dataclass(frozen=True)
class BandOutputs:
    """The tensors that blending a band writes."""

    image: Float[Tensor, "h w d"]
    alpha: Float[Tensor, "h w"]
    contribution: Float[Tensor, " m"] | None


@dataclass(frozen=True)
class BandGradients:
    """The gradients of a band, and the sums that its backward pass writes."""

    image: Float[Tensor, "h w d"]
    alpha: Float[Tensor, "h w"] | None
    absolute: bool
    sums: Float[Tensor, "m s"]
