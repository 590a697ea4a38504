"""An independent float64 renderer in plain Python loops over pixels and splats."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT, NumericsProfile
from gsfw.core.splats import Sh, Splats
from support.scenes import front_camera


@dataclass
class Lens:
    model: CameraModel
    focal: np.ndarray
    principal: np.ndarray
    size: np.ndarray

    def pixel(self, point: np.ndarray) -> np.ndarray:
        x, y, z = point
        if self.model is CameraModel.ORTHOGRAPHIC:
            unit = np.array([x, y])
        elif self.model is CameraModel.FISHEYE:
            theta, phi = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
            unit = theta * np.array([math.cos(phi), math.sin(phi)])
        else:
            unit = np.array([x, y]) / z
        return self.focal * unit + self.principal

    def jacobian(self, point: np.ndarray) -> np.ndarray:
        """By central differences, at the point moved into 1.3 times the field of view."""
        at = point.copy()
        if self.model is CameraModel.PINHOLE:
            low, high = -self.principal / self.focal, (self.size - self.principal) / self.focal
            margin = 0.3 * self.size / (2 * self.focal)
            at[:2] = point[2] * np.clip(point[:2] / point[2], low - margin, high + margin)
        columns = []
        for axis in range(3):
            step = 1e-5 * np.eye(3)[axis]
            columns.append((self.pixel(at + step) - self.pixel(at - step)) / 2e-5)
        return np.stack(columns, axis=1)


def rotation_matrix(quat: np.ndarray) -> np.ndarray:
    """By rotating the basis vectors with quaternion products."""
    w, v = quat[0] / np.linalg.norm(quat), quat[1:] / np.linalg.norm(quat)
    turned = [e + 2 * np.cross(v, np.cross(v, e) + w * e) for e in np.eye(3)]
    return np.stack(turned, axis=1)


def view_color(coefficients: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Degrees 0 and 1 only."""
    x, y, z = direction / np.linalg.norm(direction)
    one = math.sqrt(3 / (4 * math.pi))
    basis = np.array([math.sqrt(1 / (4 * math.pi)), -one * y, one * z, -one * x])
    return np.maximum(0.0, 0.5 + basis @ coefficients)


def projected(splats: Splats, camera: Cameras, antialias: bool, profile: NumericsProfile) -> list:
    """(depth, mean, inverse covariance, opacity, channels) of the splats in front, sorted."""
    assert isinstance(splats.colors, Sh)
    assert splats.quats is not None
    assert splats.scales is not None
    view = camera.world_to_camera[0].numpy()
    k = camera.intrinsics[0].numpy()
    lens = Lens(
        camera.model, k.diagonal()[:2], k[:2, 2], np.array([camera.width, camera.height], float)
    )
    rows = []
    for i in range(len(splats)):
        mean = splats.means[i].numpy()
        point = view[:3, :3] @ mean + view[:3, 3]
        if point[2] < 0.01:
            continue
        axes = rotation_matrix(splats.quats[i].numpy()) * splats.scales[i].numpy()
        to_image = lens.jacobian(point) @ view[:3, :3]
        covariance = to_image @ axes @ axes.T @ to_image.T
        dilated = covariance + profile.dilation * np.eye(2)
        opacity = splats.opacities[i].item()
        if antialias:
            ratio = np.linalg.det(covariance) / np.linalg.det(dilated)
            opacity *= math.sqrt(max(ratio, 0.005**2))
        center = -view[:3, :3].T @ view[:3, 3]
        color = view_color(splats.colors.coefficients[i].numpy(), mean - center)
        extra = splats.extra[i].numpy() if splats.extra is not None else np.zeros(0)
        channels = np.concatenate([color, extra, [point[2], 1.0]])
        rows.append((point[2], lens.pixel(point), np.linalg.inv(dilated), opacity, channels))
    return sorted(rows, key=lambda row: row[0])


def draw_in_loops(
    splats: Splats, camera: Cameras, antialias: bool = False, profile: NumericsProfile = DEFAULT
) -> np.ndarray:
    """[h, w, 3 + e + 3]: colour, extra, accumulated depth, sum of weights, transmittance."""
    rows = projected(splats, camera, antialias, profile)
    channels = len(rows[0][4])
    image = np.zeros((camera.height, camera.width, channels + 1))
    for v in range(camera.height):
        for u in range(camera.width):
            left, total = 1.0, np.zeros(channels)
            for _, mean, inverse, opacity, values in rows:
                offset = np.array([u + 0.5, v + 0.5]) - mean
                alpha = opacity * math.exp(-0.5 * offset @ inverse @ offset)
                alpha = min(profile.alpha_max, alpha)
                if alpha < profile.alpha_min:
                    continue
                if left * (1 - alpha) <= profile.transmittance_min:
                    break
                total += left * alpha * values
                left *= 1 - alpha
            image[v, u] = [*total, left]
    return image


def turned_camera(model: CameraModel, dtype: torch.dtype = torch.float64) -> Cameras:
    """A camera in front of the origin, turned and off centre, whose pixels are not square."""
    camera = front_camera(21, 18, distance=2.5, dtype=torch.float64)
    axis_turn = torch.linalg.matrix_exp(
        torch.tensor([[0, -0.3, 0.2], [0.3, 0, -0.1], [-0.2, 0.1, 0]], dtype=torch.float64)
    )
    view = torch.eye(4, dtype=torch.float64)
    view[:3, :3], view[:3, 3] = axis_turn, torch.tensor([0.1, -0.2, 2.0])
    focal = 7.0 if model is CameraModel.ORTHOGRAPHIC else 14.0
    k = torch.tensor([[focal, 0, 9.0], [0, 1.2 * focal, 11.0], [0, 0, 1]], dtype=torch.float64)
    return replace(camera, world_to_camera=view[None], intrinsics=k[None], model=model).to(
        dtype=dtype
    )
