"""The catalogue of extremes: splats and cameras that no backend may stumble over."""

from collections.abc import Callable
from dataclasses import replace

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.splats import Sh, Splats


def scaled(factors: list[float]) -> Callable[[Splats], Splats]:
    def change(splats: Splats) -> Splats:
        assert splats.scales is not None
        return replace(splats, scales=splats.scales * splats.scales.new_tensor(factors))

    return change


def moved(depths: list[float]) -> Callable[[Splats], Splats]:
    """Splats at these view depths, straight ahead and to the side."""

    def change(splats: Splats) -> Splats:
        means = splats.means.clone()
        n = len(means)
        means[:, 2] = means.new_tensor(depths).repeat(n)[:n] - 4
        means[: n // 2, :2] = 0
        return replace(splats, means=means)

    return change


def with_quats(quat: list[float]) -> Callable[[Splats], Splats]:
    return lambda splats: replace(splats, quats=splats.means.new_tensor([quat]).repeat(20, 1))


def with_opacity(value: float) -> Callable[[Splats], Splats]:
    return lambda splats: replace(splats, opacities=torch.full_like(splats.opacities, value))


def covariances(kind: str) -> Callable[[Splats], Splats]:
    def change(splats: Splats) -> Splats:
        bases = torch.linalg.qr(torch.randn(20, 3, 3, generator=torch.Generator().manual_seed(0)))
        widths = {"zero": [0.0] * 3, "needle": [1.0, 1e-6, 1e-6], "not psd": [0.1, 0.1, -1e-6]}
        values = torch.diag(torch.tensor(widths.get(kind, [1e12] * 3)))
        made = (bases.Q @ values @ bases.Q.transpose(1, 2)).to(splats.means.dtype)
        return replace(splats, quats=None, scales=None, covariances=made)

    return change


SPLATS: dict[str, Callable[[Splats], Splats]] = {
    "scales 1e-10": scaled([1e-10] * 3),
    "scales 1e3": scaled([1e3] * 3),
    "scales 1e6": scaled([1e6] * 3),
    "scales 1e30": scaled([1e30] * 3),
    "needles": scaled([1e3, 1e-3, 1e-3]),
    "two zero scales": scaled([1.0, 0.0, 0.0]),
    "zero scales": scaled([0.0, 0.0, 0.0]),
    "zero covariances": covariances("zero"),
    "needle covariances": covariances("needle"),
    "covariances not positive by rounding": covariances("not psd"),
    "covariances 1e12": covariances("huge"),
    "quaternion 0": with_quats([0.0] * 4),
    "quaternion 1e-20": with_quats([1e-20, 2e-20, 0.0, 0.0]),
    "quaternion 1e-11": with_quats([1e-11, 2e-11, 0.0, 0.0]),
    "quaternion 1e20": with_quats([1e20, 2e20, -1e20, 0.0]),
    "quaternion 1e37": with_quats([1e37, 2e37, -1e37, 3e37]),
    "opacity 0": with_opacity(0.0),
    "opacity 1": with_opacity(1.0),
    "opacity below the cut-off": with_opacity(1 / 256),
    "at the camera": moved([0.0]),
    "around the camera": moved([-1.0, 0.0, 1e-9, 1e-6, 1e-3, 0.009999, 0.01, 0.02]),
    "depths to 1e9": moved([1e-6, 1.0, 1e3, 1e6, 1e9]),
    "equal depths": moved([4.0]),
    "around the camera, large": lambda s: moved([0.0, 1e-6, 1e-3])(scaled([1e6] * 3)(s)),
    "coefficients 1e4": lambda s: replace(s, colors=Sh(1e4 * torch.ones_like(_sh(s)), 1)),
    "negative colours": lambda s: replace(s, colors=Sh(-1e4 * torch.ones_like(_sh(s)), 1)),
    "scene of 1e-6": lambda s: replace(scaled([1e-6] * 3)(s), means=1e-6 * s.means),
    "scene of 1e6": lambda s: replace(scaled([1e6] * 3)(s), means=1e6 * s.means),
    "scene of 1e30": lambda s: replace(s, means=1e30 * s.means),
    "one splat": lambda s: Splats(
        s.means[:1], s.opacities[:1], s.means[:1, :1], s.means.new_ones(1, 4), s.means[:1].abs()
    ),
    "no splat": lambda s: Splats(
        s.means[:0], s.opacities[:0], s.means[:0, :1], s.means.new_ones(0, 4), s.means[:0]
    ),
    "32 channels": lambda s: replace(s, colors=s.opacities[:, None].repeat(1, 32)),
}
"""By name: changes 20 random splats into the extreme."""


def _sh(splats: Splats) -> torch.Tensor:
    assert isinstance(splats.colors, Sh)
    return splats.colors.coefficients


def camera_with(focal: float, principal: float = 0.5) -> Callable[[Cameras], Cameras]:
    def change(camera: Cameras) -> Cameras:
        k = camera.intrinsics.clone()
        k[0, 0, 0], k[0, 1, 1] = focal, focal
        k[0, :2, 2] = k.new_tensor([camera.width, camera.height]) * principal
        return replace(camera, intrinsics=k)

    return change


CAMERAS: dict[str, Callable[[Cameras], Cameras]] = {
    "focal 1e-2": camera_with(1e-2),
    "focal 1e6": camera_with(1e6),
    "focal 1e30": camera_with(1e30),
    "field of view 179 degrees": camera_with(0.09),
    "principal point outside": camera_with(20.0, -3.0),
    "principal point far outside": camera_with(20.0, 1e6),
}
"""By name: changes a camera in front of the scene into the extreme."""
