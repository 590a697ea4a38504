"""Projection and its gradient, against the reference under autograd and finite differences."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.numerics import DEFAULT, LENGTH_MAX
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.layers import projected_splats
from gsfw.rasterizers.reference.project import project, visible_extents

pytestmark = pytest.mark.slow  # Compiles the headers; plain runs test them in the rasterizers.

N = 64


def turned_camera(model: CameraModel) -> Cameras:
    """A camera with nothing symmetric about it."""
    camera = front_camera(40, 30, dtype=torch.float64)
    turn = rotation_matrices(torch.tensor([[0.9, 0.1, -0.3, 0.2]], dtype=torch.float64))[0]
    world_to_camera = camera.world_to_camera.clone()
    world_to_camera[0, :3, :3] = turn
    world_to_camera[0, :3, 3] = torch.tensor([0.3, -0.2, 2.5])
    intrinsics = camera.intrinsics.clone()
    intrinsics[0, 1, 1] *= 1.3
    intrinsics[0, :2, 2] += torch.tensor([3.0, -4.0])
    if model is CameraModel.ORTHOGRAPHIC:
        intrinsics[0, :2, :2] *= 0.3
    return replace(camera, world_to_camera=world_to_camera, intrinsics=intrinsics, model=model)


def in_form(splats: Splats, form: str) -> Splats:
    if form == "axes":
        return splats
    assert splats.quats is not None
    assert splats.scales is not None
    axes = rotation_matrices(splats.quats) * splats.scales[:, None]
    return replace(splats, quats=None, scales=None, covariances=axes @ axes.transpose(1, 2))


def wide_splats(form: str = "axes") -> Splats:
    """Splats in and around the view, some beyond where the pinhole's slopes are limited."""
    splats = random_splats(N, seed=3, dtype=torch.float64)
    return in_form(replace(splats, means=1.6 * splats.means), form)


def random_gradients(n: int = N) -> torch.Tensor:
    generator = torch.Generator().manual_seed(5)
    return torch.randn(n, 7, generator=generator, dtype=torch.float64)


def splat_gradients(rows: torch.Tensor, gradients: torch.Tensor) -> torch.Tensor:
    """What random moments mean for x, y, r, k, w and opacity: du = u dr / r and so on."""
    r, w = rows.detach()[:, 2], rows.detach()[:, 4]
    x, y, _, uu, uv, vv, opacity = gradients.unbind(1)
    return torch.stack([x, y, -uu / r, w * uv / r, -vv / w, opacity], dim=1)


def by_autograd(
    splats: Splats, camera: Cameras, settings: RenderSettings, gradients: torch.Tensor
) -> dict[str, torch.Tensor]:
    """What ``Maths.project_vjp`` computes, by the reference."""
    names = [name for name in splats.tensors() if name != "colors"]
    leaves = {name: splats.tensors()[name].detach().clone().requires_grad_() for name in names}
    pose = camera.world_to_camera.clone().requires_grad_()
    ellipses = project(replace(splats, **leaves), replace(camera, world_to_camera=pose), settings)
    rows = projected_splats(ellipses, ellipses.depths[:, None])
    wanted = torch.cat([splat_gradients(rows[:, :6], gradients), gradients[:, 2:3]], dim=1)
    found = torch.autograd.grad(rows, [*leaves.values(), pose], wanted)
    return dict(zip(names, found[:-1], strict=True)) | {"pose": found[-1][0, :3]}


def assert_near(mine, theirs, tolerance: float) -> None:
    assert mine.keys() == theirs.keys()
    for name, expected in theirs.items():
        assert mine[name].isfinite().all(), name
        error = (mine[name].double() - expected).norm() / expected.norm().clamp(min=1e-300)
        assert error <= tolerance, f"{name}: {error:.2e}"


def in_every_case(test):
    """Run a test for every model, with and without antialiasing, in both forms."""
    test = pytest.mark.parametrize("model", list(CameraModel))(test)
    test = pytest.mark.parametrize("antialias", [False, True])(test)
    return pytest.mark.parametrize("form", ["axes", "covariance"])(test)


def compare_forward(maths, splats, camera, settings, tolerance):
    expected = project(splats, camera, settings)
    visible, extents = visible_extents(expected, camera, settings)
    mine = maths.project(splats, camera, settings).double()
    assert torch.equal(mine[:, 8] > 0, visible)
    columns = [expected.means, expected.depths[:, None], expected.covariances]
    columns += [expected.determinants[:, None], expected.opacities[:, None], visible[:, None]]
    theirs = torch.cat([*columns, extents], dim=1)[visible]
    error = (mine[visible] - theirs).norm(dim=0) / theirs.norm(dim=0)
    assert error.amax() < tolerance, error


@in_every_case
def test_double_projects_as_the_reference_does(double, model, antialias, form):
    settings = RenderSettings(antialias=antialias)
    splats = wide_splats(form)
    compare_forward(double, splats, turned_camera(model), settings, 1e-12)


@in_every_case
def test_single_projects_as_the_reference_does(single, model, antialias, form):
    settings = RenderSettings(antialias=antialias)
    splats = wide_splats(form)
    compare_forward(single, splats, turned_camera(model), settings, 1e-5)


def test_without_a_least_alpha_every_splat_in_front_reaches_the_whole_image(double):
    settings = RenderSettings(profile=DEFAULT.without_cutoffs())
    compare_forward(double, wide_splats(), turned_camera(CameraModel.PINHOLE), settings, 1e-12)


@in_every_case
def test_double_has_the_gradients_of_the_reference(double, model, antialias, form):
    settings, camera = RenderSettings(antialias=antialias), turned_camera(model)
    splats, gradients = wide_splats(form), random_gradients()
    mine = double.project_vjp(splats, camera, settings, gradients)
    assert_near(mine, by_autograd(splats, camera, settings, gradients), 1e-11)


@in_every_case
def test_single_has_the_gradients_of_the_reference(single, model, antialias, form):
    settings, camera = RenderSettings(antialias=antialias), turned_camera(model)
    splats, gradients = wide_splats(form), random_gradients()
    mine = single.project_vjp(splats, camera, settings, gradients)
    assert_near(mine, by_autograd(splats, camera, settings, gradients), 1e-4)


@in_every_case
def test_a_pack_gives_the_bits_of_its_lanes(double, pair, model, antialias, form):
    settings, camera = RenderSettings(antialias=antialias), turned_camera(model)
    splats, gradients = wide_splats(form), random_gradients()
    assert torch.equal(
        pair.project(splats, camera, settings), double.project(splats, camera, settings)
    )
    apart = double.project_vjp(splats, camera, settings, gradients)
    together = pair.project_vjp(splats, camera, settings, gradients)
    for name, expected in apart.items():
        assert torch.equal(together[name], expected), name


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("antialias", [False, True])
def test_gradients_are_finite_differences_of_the_projection(double, model, antialias):
    """The moments' gradient is that of <second, L^-1 Sigma2 L^-T> / 2 with L held fixed."""
    settings = RenderSettings(antialias=antialias)
    camera, splats, gradients = turned_camera(model), wide_splats(), random_gradients()
    at = double.project(splats, camera, settings)
    r = at[:, 3].rsqrt()
    w = (at[:, 3] / at[:, 6]).sqrt()
    zeros = torch.zeros_like(r)
    inverse = torch.stack([r, zeros, -w * at[:, 4] / at[:, 3], w], dim=1).view(-1, 2, 2)
    second = gradients[:, [3, 4, 4, 5]].view(-1, 2, 2)
    matrix = 0.5 * inverse.transpose(1, 2) @ second @ inverse

    def loss(changed: Splats) -> torch.Tensor:
        out = double.project(changed, camera, settings)
        covariance = out[:, [3, 4, 4, 5]].view(-1, 2, 2)
        plain = (out[:, [0, 1, 2, 7]] * gradients[:, [0, 1, 2, 6]]).sum(1)
        return plain + (covariance * matrix).sum((1, 2))

    found = double.project_vjp(splats, camera, settings, gradients)
    for name in ("means", "quats", "scales", "opacities"):
        values = getattr(splats, name)
        differences = torch.zeros(N, values[0].numel(), dtype=torch.float64)
        for column in range(values[0].numel()):
            step = torch.zeros_like(differences)
            step[:, column] = 1e-6
            step = step.view_as(values)
            after = loss(replace(splats, **{name: values + step}))
            before = loss(replace(splats, **{name: values - step}))
            differences[:, column] = (after - before) / 2e-6
        assert_near({name: found[name].reshape(N, -1)}, {name: differences}, 1e-6)


def only_row(splats: Splats, row: int) -> Splats:
    fields = {name: tensor[row : row + 1] for name, tensor in splats.tensors().items()}
    return replace(splats, **(fields | {"colors": splats.means[row : row + 1]}))


def extreme_splats() -> Splats:
    """In view, with scales and quaternions that float32 can barely hold; even in number."""
    scales = [
        [0.0, 0.0, 0.0],
        [1e-10, 1e-10, 1e-10],
        [1e-7, 1e-1, 1e-7],
        [0.1, 0.0, 0.0],
        [1e3, 1e-3, 1e-3],
        [1e9, 1e9, 1e9],
        [1e12, 1.0, 1e-3],
        [3e7, 1.0, 2.0],
    ]
    quats = [[0.0, 0, 0, 0], [1e-20, 0, 2e-20, 0], [1e20, -1e20, 3e19, 2e19], [0.5, 0.1, -0.7, 0.2]]
    rows = len(scales) * len(quats)
    splats = random_splats(rows, seed=2, dtype=torch.float64)
    return replace(
        splats,
        means=0.3 * splats.means,
        scales=torch.tensor(scales, dtype=torch.float64).repeat(len(quats), 1),
        quats=torch.tensor(quats, dtype=torch.float64).repeat_interleave(len(scales), 0),
    )


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("antialias", [False, True])
def test_extreme_shapes_have_the_gradients_of_the_reference(double, single, model, antialias):
    settings, camera = RenderSettings(antialias=antialias), turned_camera(model)
    splats = extreme_splats()
    gradients = random_gradients(len(splats))
    compare_forward(double, splats, camera, settings, 1e-10)
    for row in range(len(splats)):
        alone = only_row(splats, row)
        gradient = gradients[row : row + 1]
        expected = by_autograd(alone, camera, settings, gradient)
        mine = double.project_vjp(alone, camera, settings, gradient)
        # Turning a ball does nothing: what the torques along its axes cancel to is rounding.
        torque = (expected["scales"] * alone.scales).norm() / alone.quats.norm().clamp(min=1e-12)
        assert (mine.pop("quats") - expected["quats"]).norm() <= 1e-6 * (
            expected.pop("quats").norm() + 1e-6 * torque
        ), row
        assert_near(mine, expected, 1e-6)
        for name, found in single.project_vjp(alone, camera, settings, gradient).items():
            assert found.isfinite().all(), f"row {row}: {name}"


def test_no_gradient_passes_a_limit(double):
    splats = random_splats(4, dtype=torch.float64)
    scales = torch.full((4, 3), 2 * LENGTH_MAX, dtype=torch.float64)
    scales[:, 1] = 0.1
    splats = replace(splats, scales=scales)
    found = double.project_vjp(
        splats, turned_camera(CameraModel.PINHOLE), RenderSettings(), random_gradients(4)
    )
    assert (found["scales"][:, [0, 2]] == 0).all()


def test_a_quaternion_that_is_none_is_the_identity_without_a_gradient(double):
    splats = wide_splats()
    none = replace(splats, quats=torch.full_like(splats.quats, 1e-20))
    identity = replace(
        splats, quats=torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).repeat(N, 1)
    )
    camera, settings = turned_camera(CameraModel.PINHOLE), RenderSettings()
    assert torch.equal(
        double.project(none, camera, settings), double.project(identity, camera, settings)
    )
    found = double.project_vjp(none, camera, settings, random_gradients())
    assert (found["quats"] == 0).all()
    assert (found["scales"] != 0).any()


@pytest.mark.parametrize("antialias", [False, True])
def test_a_raised_determinant_has_the_gradients_of_the_reference(double, antialias):
    """Rounding makes flat covariances slightly indefinite; here they are so for certain."""
    camera, gradients = turned_camera(CameraModel.PINHOLE), random_gradients()
    splats = wide_splats("covariance")
    hollow = torch.diag(torch.tensor([0.01, -0.005, 0.002], dtype=torch.float64))
    splats = replace(splats, covariances=hollow.repeat(N, 1, 1))
    settings = RenderSettings(antialias=antialias)
    projected = project(splats, camera, settings)
    xx, xy, yy = (projected.covariances - torch.tensor([0.3, 0.0, 0.3])).unbind(1)
    assert (xx * yy - xy * xy < 0).any()
    mine = double.project_vjp(splats, camera, settings, gradients)
    assert_near(mine, by_autograd(splats, camera, settings, gradients), 1e-11)


def test_a_floored_compensation_passes_no_gradient_to_the_shape(double):
    splats = replace(wide_splats(), scales=torch.full((N, 3), 1e-6, dtype=torch.float64))
    camera, settings = turned_camera(CameraModel.PINHOLE), RenderSettings(antialias=True)
    gradients = torch.zeros(N, 7, dtype=torch.float64)
    gradients[:, 6] = 1.0
    found = double.project_vjp(splats, camera, settings, gradients)
    for name in ("means", "quats", "scales", "pose"):
        assert (found[name] == 0).all(), name
    expected = torch.full((N,), DEFAULT.compensation_min, dtype=torch.float64)
    torch.testing.assert_close(found["opacities"], expected)


@pytest.mark.parametrize("model", list(CameraModel))
def test_what_is_not_finite_is_not_visible(double, single, model):
    base = random_splats(2, dtype=torch.float64)
    camera, settings = turned_camera(model), RenderSettings()
    for name in ("means", "quats", "scales", "opacities"):
        for bad in (torch.nan, torch.inf):
            values = getattr(base, name).clone()
            values.view(2, -1)[1, 0] = bad
            splats = replace(base, **{name: values})
            expected, _ = visible_extents(project(splats, camera, settings), camera, settings)
            for maths in (double, single):
                visible = maths.project(splats, camera, settings)[:, 8] > 0
                assert torch.equal(visible, expected), f"{name} {bad}"


@pytest.mark.parametrize("antialias", [False, True])
def test_a_needle_loses_no_more_in_single_than_the_reference_does(single, antialias):
    """1 : 1e6 in the scene, by the float64 oracle; plain float32 is 3e-7 to 2e-5 off."""
    splats = random_splats(N, seed=4)
    splats = replace(splats, scales=torch.tensor([[10.0, 1e-5, 1e-5]]).repeat(N, 1))
    fields = splats.tensors() | {"colors": splats.means}
    exact = {name: tensor.double() for name, tensor in fields.items()}
    camera, settings = turned_camera(CameraModel.PINHOLE), RenderSettings(antialias=antialias)
    gradients = random_gradients().float()
    oracle = by_autograd(replace(splats, **exact), camera, settings, gradients.double())
    plain = by_autograd(splats, camera.to(dtype=torch.float32), settings, gradients)
    mine = single.project_vjp(splats, camera, settings, gradients)
    for name, expected in oracle.items():
        error = (mine[name] - expected).norm() / expected.norm()
        theirs = (plain[name] - expected).norm() / expected.norm()
        assert error <= 2 * theirs + 1e-6, f"{name}: {error:.1e}, plain float32 {theirs:.1e}"
