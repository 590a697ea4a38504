"""Random scenes drawn a second time: pixel by pixel, splat by splat, in plain Python loops."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT, GSPLAT_1_5, NumericsProfile
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats


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


SETTINGS = RenderSettings(depth=Depth.ACCUMULATED, statistics=frozenset({Statistic.CONTRIBUTION}))


def draw(
    rasterizer: Rasterizer, splats: Splats, camera: Cameras, settings: RenderSettings
) -> np.ndarray:
    output = rasterizer.render(splats, camera, settings)
    parts = [output.color, output.extra, output.depth, output.alpha, 1 - output.alpha]
    return torch.cat([part for part in parts if part is not None], dim=3)[0].double().numpy()


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("antialias", [False, True])
def test_the_picture_is_the_one_that_loops_draw(rasterizer, model, antialias):
    splats = random_splats(25, 1, seed=3, dtype=torch.float64)
    splats = replace(splats, extra=torch.linspace(-1, 1, 50, dtype=torch.float64).view(25, 2))
    camera = turned_camera(model)
    settings = replace(SETTINGS, antialias=antialias)
    expected = draw_in_loops(splats, camera, antialias)
    assert expected[:, :, -2].max() > 0.3, "the scene must cover something"
    np.testing.assert_allclose(
        draw(rasterizer, splats, camera, settings), expected, rtol=0, atol=2e-8
    )


@pytest.mark.parametrize("profile", [GSPLAT_1_5, DEFAULT.without_cutoffs()])
def test_the_picture_is_right_with_other_cut_offs(rasterizer, profile):
    splats = random_splats(25, 1, seed=4, dtype=torch.float64)
    splats = replace(splats, opacities=splats.opacities.sqrt().sqrt())
    camera = turned_camera(CameraModel.PINHOLE)
    expected = draw_in_loops(splats, camera, profile=profile)
    found = draw(rasterizer, splats, camera, replace(SETTINGS, profile=profile))
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-8)


def test_a_deep_scene_whose_pixels_stop_is_drawn_right(rasterizer):
    splats = random_splats(150, 1, seed=5, dtype=torch.float64)
    splats = replace(splats, opacities=splats.opacities.sqrt())
    camera = turned_camera(CameraModel.PINHOLE)
    found = rasterizer.render(splats, camera).color[0]
    np.testing.assert_allclose(found, draw_in_loops(splats, camera)[:, :, :3], rtol=0, atol=2e-8)
    assert draw_in_loops(splats, camera)[:, :, -1].min() < 2e-4


def test_splats_close_to_the_camera_at_its_side_are_linearised_within_the_margin(rasterizer):
    splats = random_splats(12, 1, seed=6, dtype=torch.float64)
    means = splats.means * torch.tensor([6.0, 6.0, 0.2], dtype=torch.float64)
    splats = replace(splats, means=means, scales=3 * splats.scales)
    camera = front_camera(15, 12, distance=0.5, dtype=torch.float64)
    expected = draw_in_loops(splats, camera)
    np.testing.assert_allclose(
        draw(rasterizer, splats, camera, SETTINGS), expected, rtol=0, atol=2e-8
    )


def test_float32_stays_near_float64(rasterizer):
    splats = random_splats(200, 1, seed=7)
    doubles = random_splats(200, 1, seed=7, dtype=torch.float64)
    camera = front_camera(64, 48)
    wide = front_camera(64, 48, dtype=torch.float64)
    for settings, tolerance in [
        (RenderSettings(), 1e-3),
        (RenderSettings(profile=DEFAULT.without_cutoffs()), 1e-4),
    ]:
        images, gradients = [], []
        for scene, view in ((splats, camera), (doubles, wide)):
            tensors = scene.tensors()
            inputs = [t.clone().requires_grad_() for t in tensors.values()]
            named = dict(zip(tensors, inputs, strict=True))
            named["colors"] = Sh(named["colors"], 1)
            color = rasterizer.render(Splats(**named), view, settings).color
            color.square().sum().backward()
            images.append(color.detach().double())
            gradients.append([t.grad.double() for t in inputs if t.grad is not None])
        assert (images[0] - images[1]).norm() <= 1e-5 * images[1].norm()
        assert ((images[0] - images[1]).abs().amax(3) > 1e-5).double().mean() <= 5e-4
        for found, expected in zip(*gradients, strict=True):
            assert (found - expected).norm() <= tolerance * expected.norm()
