from dataclasses import dataclass, replace

import pytest
import torch
from support.inria_scene import weights
from torch import Tensor

from gsfw.api import (
    CameraModel,
    Cameras,
    Depth,
    RenderSettings,
    Sh,
    Splats,
    Statistic,
    open_rasterizer,
    rotation_matrices,
)
from gsfw.compat.gsplat import rasterization, rasterization_2dgs
from gsfw.compat.gsplat_covariances import quat_scale_to_covar_preci
from gsfw.compat.refusal import UnservedArgument

WIDTH, HEIGHT = 26, 20
CLOSE = {"rtol": 1e-9, "atol": 1e-11}
MODELS = {
    "pinhole": CameraModel.PINHOLE,
    "ortho": CameraModel.ORTHOGRAPHIC,
    "fisheye": CameraModel.FISHEYE,
}


@dataclass
class Scene:
    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    colors: Tensor

    def parameters(self) -> list[Tensor]:
        return list(vars(self).values())

    def with_gradients(self) -> "Scene":
        return Scene(*(tensor.clone().requires_grad_() for tensor in self.parameters()))

    def splats(self, degree: int | None) -> Splats:
        colors = self.colors if degree is None else Sh(self.colors, degree)
        return Splats(self.means, self.opacities, colors, self.quats, self.scales)


@pytest.fixture
def scene() -> Scene:
    """Ten splats with spherical harmonics; one is behind the cameras, one on the fisheye's axis."""
    random = torch.Generator().manual_seed(5)

    def draw(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    means = (draw(10, 3) - 0.5) * 2
    means[0] = torch.tensor([0.0, 0.0, -9.0])
    means[1] = torch.tensor([1e-4, 0.0, 0.1])
    return Scene(means, draw(10, 4) - 0.5, 0.1 + 0.2 * draw(10, 3), draw(10), draw(10, 4, 3) - 0.3)


@pytest.fixture
def cameras() -> Cameras:
    """Two views from 3 units away, the second from the side, off centre."""
    views = torch.eye(4, dtype=torch.float64).repeat(2, 1, 1)
    views[:, 2, 3] = 3.0
    turn = torch.tensor([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    views[1, :3, :3] = turn
    matrix = torch.tensor([[18.0, 0, 13.0], [0, 17.0, 10.0], [0, 0, 1.0]], dtype=torch.float64)
    return Cameras(views, torch.stack([matrix, matrix + torch.tensor([0, 0, 1.0])]), WIDTH, HEIGHT)


def ours(scene: Scene, cameras: Cameras, **named):
    return rasterization(
        **vars(scene),
        viewmats=cameras.world_to_camera,
        Ks=cameras.intrinsics,
        width=WIDTH,
        height=HEIGHT,
        **named,
    )


def gradients(scene: Scene, image: Tensor) -> list[Tensor]:
    return list(torch.autograd.grad((image * weights(image)).sum(), scene.parameters()))


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_images_and_gradients_are_those_of_the_reference(
    scene, cameras, model, antialiased, packed
):
    mine, other = scene.with_gradients(), scene.with_gradients()
    background = torch.tensor([0.1, 0.5, 0.9], dtype=torch.float64)
    image, alpha, _ = ours(
        mine,
        cameras,
        sh_degree=1,
        packed=packed,
        camera_model=model,
        rasterize_mode="antialiased" if antialiased else "classic",
        render_mode="RGB+ED",
        backgrounds=background.expand(2, 3),
    )
    settings = RenderSettings(background, antialias=antialiased, depth=Depth.EXPECTED)
    expected = open_rasterizer("reference").render(
        other.splats(1), replace(cameras, model=MODELS[model]), settings
    )
    together = torch.cat([expected.color, expected.depth], dim=-1)
    torch.testing.assert_close(image, together, **CLOSE)
    torch.testing.assert_close(alpha, expected.alpha, **CLOSE)
    torch.testing.assert_close(gradients(mine, image), gradients(other, together), **CLOSE)


def test_gradients_of_means2d_are_finite_differences_in_pixels(scene, cameras):
    image, _, info = ours(scene.with_gradients(), cameras, sh_degree=1, packed=False)
    info["means2d"].retain_grad()
    (image * weights(image)).sum().backward()
    step = 1e-6
    for axis in (0, 1):
        losses = []
        for sign in (1, -1):
            shifted = cameras.intrinsics.clone()
            shifted[:, axis, 2] += sign * step
            moved = replace(cameras, intrinsics=shifted)
            losses.append((ours(scene, moved, sh_degree=1)[0] * weights(image)).sum())
        slope = (losses[0] - losses[1]) / (2 * step)
        total = info["means2d"].grad[..., axis].sum()
        torch.testing.assert_close(total, slope, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("packed", [False, True])
def test_strategies_read_the_norms_that_a_rasterizer_measures(scene, cameras, packed):
    """The calls of a strategy: gradients in pixels, converted with the image's size."""
    image, _, info = ours(scene.with_gradients(), cameras, sh_degree=1, packed=packed, absgrad=True)
    info["means2d"].retain_grad()
    (image * weights(image)).sum().backward()
    wanted = frozenset({Statistic.SCREEN_GRADIENT, Statistic.ABSGRAD})
    other = scene.with_gradients()
    output = open_rasterizer("cpu").render(
        other.splats(1), cameras, RenderSettings(statistics=wanted)
    )
    (output.color * weights(image)).sum().backward()
    size = torch.tensor([0.5 * info["width"], 0.5 * info["height"]], dtype=torch.float64)
    for found, measured in (
        (info["means2d"].grad, output.statistics.screen_gradient),
        (info["means2d"].absgrad, output.statistics.absgrad),
    ):
        norms = (found * size).norm(dim=-1)
        if packed:
            norms = (
                torch.zeros(2, 10)
                .to(norms)
                .index_put((info["camera_ids"], info["gaussian_ids"]), norms)
            )
        torch.testing.assert_close(norms, measured, **CLOSE)


def test_packed_info_has_the_seen_rows_of_the_whole(scene, cameras):
    _, _, packed = ours(scene, cameras, sh_degree=1)
    _, _, whole = ours(scene, cameras, sh_degree=1, packed=False)
    seen = (whole["radii"] > 0).all(-1)
    cameras_of, rows = seen.nonzero().unbind(1)
    assert torch.equal(packed["gaussian_ids"], rows)
    assert torch.equal(packed["camera_ids"], cameras_of)
    assert not seen[:, 0].any() or seen.sum() < 20, "one splat is behind a camera"
    for name in ("means2d", "radii", "depths", "conics", "opacities"):
        torch.testing.assert_close(packed[name], whole[name][seen])
    assert whole["gaussian_ids"] is None
    assert (packed["n_cameras"], packed["width"], packed["height"]) == (2, WIDTH, HEIGHT)
    with pytest.raises(KeyError, match="isect_offsets"):
        packed["isect_offsets"]


def test_modes_have_their_channels(scene, cameras):
    flat = replace(scene, colors=scene.colors[:, 0].abs())
    both, alpha, _ = ours(flat, cameras, render_mode="RGB+D")
    assert torch.equal(ours(flat, cameras)[0], both[..., :3])
    torch.testing.assert_close(ours(flat, cameras, render_mode="D")[0], both[..., 3:])
    expected, _, _ = ours(flat, cameras, render_mode="ED")
    torch.testing.assert_close(expected * alpha.clamp_min(1e-10), both[..., 3:])


def test_covariances_and_colours_per_camera_render_the_same(scene, cameras):
    flat = replace(scene, colors=scene.colors[:, 0].abs())
    expected, _, _ = ours(flat, cameras)
    axes = torch.nn.functional.normalize(scene.quats, dim=1)
    factors = rotation_matrices(axes) * scene.scales[:, None]
    image, _, _ = rasterization(
        scene.means,
        None,
        None,
        scene.opacities,
        flat.colors.expand(2, 10, 3),
        cameras.world_to_camera,
        cameras.intrinsics,
        WIDTH,
        HEIGHT,
        covars=factors @ factors.transpose(1, 2),
    )
    torch.testing.assert_close(image, expected)


def test_planes_radii_and_dilation_are_obeyed(scene, cameras):
    flat = replace(scene, colors=scene.colors[:, 0].abs())
    _, _, info = ours(flat, cameras, packed=False, near_plane=2.5, far_plane=3.5)
    depths = info["depths"][(info["radii"] > 0).all(-1)]
    assert len(depths) > 0
    assert ((depths > 2.5) & (depths < 3.5)).all()
    largest = int(info["radii"].max())
    _, alpha, _ = ours(flat, cameras, radius_clip=float(largest + 9))
    assert not alpha.any()
    wide, _, _ = ours(flat, cameras, eps2d=2.0)
    assert not torch.allclose(wide, ours(flat, cameras)[0])


def test_what_is_not_served_is_refused_by_name(scene, cameras):
    flat = replace(scene, colors=scene.colors[:, 0].abs())
    for named, said in (
        ({"sparse_grad": True}, "sparse_grad=True"),
        ({"distributed": True}, "distributed=True"),
        ({"render_mode": "Ed"}, "render_mode='Ed'"),
        ({"camera_model": "ftheta"}, "camera_model='ftheta'"),
        ({"rasterize_mode": "sharp"}, "rasterize_mode='sharp'"),
        ({"with_ut": True}, "with_ut"),
        ({"radial_coeffs": torch.zeros(2, 6)}, "radial_coeffs"),
        ({"global_z_order": False}, "global_z_order"),
    ):
        with pytest.raises(UnservedArgument, match=f"does not support {said}"):
            ours(flat, cameras, **named)
    with pytest.raises(UnservedArgument, match="batch dimensions"):
        ours(replace(flat, means=flat.means[None]), cameras)
    with pytest.raises(UnservedArgument, match="rasterization_2dgs"):
        rasterization_2dgs(flat.means)
    ours(flat, cameras, global_z_order=True, with_ut=False, viewmats_rs=None)


def test_covariances_have_the_squared_scales_along_their_axes_and_the_inverses_are_inverses():
    half = 0.5**0.5
    quats = torch.tensor([[1.0, 0, 0, 0], [3 * half, 0, 0, 3 * half]])
    scales = torch.tensor([[1.0, 2.0, 3.0]] * 2)
    covariances, inverses = quat_scale_to_covar_preci(quats, scales)
    turned = torch.tensor([[1.0, 4.0, 9.0], [4.0, 1.0, 9.0]])
    torch.testing.assert_close(covariances, torch.diag_embed(turned), atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(inverses, covariances.inverse(), atol=1e-6, rtol=1e-6)
    halves, none = quat_scale_to_covar_preci(quats, scales, compute_preci=False, triu=True)
    assert none is None
    torch.testing.assert_close(halves[:, [0, 3, 5]], turned, atol=1e-6, rtol=1e-6)
