"""Deformed Gaussians: identity at the start, gradients at a time, and what is done to rows."""

from dataclasses import replace

import pytest
import torch
from support.moving_splats import moving_scene

from gsfw.core.cameras import Cameras
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh
from gsfw.core.table import SplatTable
from gsfw.methods.gaussians3d.model import MAX_LOG_SCALE
from gsfw.methods.gaussians4d.config import (
    DeformationConfig,
    HashConfig,
    HexPlaneConfig,
    MlpConfig,
)
from gsfw.methods.gaussians4d.field import OPACITIES
from gsfw.methods.gaussians4d.model import OPACITY_INSTANTS, DeformedGaussians
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SMALL = DeformationConfig(
    sh_degree=1,
    hexplane=HexPlaneConfig(channels=8, resolution=4, width=6),
    mlp=MlpConfig(width=6, depth=3, frequencies=2, time_frequencies=2),
    hash=HashConfig(levels=2, features=3, log2_rows=8, coarsest=2, finest=6, width=6),
)
ENCODERS = ("hexplane", "mlp", "hash")
EVERYTHING = {"deform_opacity": True, "deform_sh": True}
TIME = torch.tensor(0.3)


def gaussians(encoder: str = "hexplane", trained: bool = False, **options) -> DeformedGaussians:
    """A model before its first step, or one whose every parameter has moved."""
    generator = torch.Generator().manual_seed(0)
    scene = moving_scene(12, num_times=5)
    config = replace(SMALL, encoder=encoder, **options)
    model = config.build().build_model(scene, Operators(), generator, None)
    assert isinstance(model, DeformedGaussians)
    if trained:
        model.double()
        with torch.no_grad():
            for parameter in model.parameters():
                noise = torch.randn(parameter.shape, generator=generator, dtype=parameter.dtype)
                parameter.add_(0.1 * noise)
    return model


def front_camera() -> Cameras:
    """A camera in front of the points."""
    pose = torch.eye(4, dtype=torch.float64)[None]
    pose[0, 2, 3] = 3.0
    lens = torch.tensor([[[24.0, 0, 10], [0, 24, 8], [0, 0, 1]]], dtype=torch.float64)
    return Cameras(pose, lens, 20, 16)


def assert_same_splats(first, second):
    one, other = first.tensors(), second.tensors()
    assert one.keys() == other.keys()
    for name, tensor in one.items():
        assert torch.equal(tensor, other[name]), name


@pytest.mark.parametrize("encoder", ENCODERS)
@pytest.mark.parametrize("options", [{}, {"scale_change": "sum"}, EVERYTHING])
def test_the_field_changes_nothing_before_its_first_step(encoder, options):
    model = gaussians(encoder, **options)
    for time in (0.0, 0.37, 1.0, 7.0):
        assert_same_splats(model.splats(torch.tensor(time)), model.canonical.splats())


@pytest.mark.parametrize("encoder", ENCODERS)
def test_in_the_coarse_phase_gaussians_are_canonical_and_then_none_is_the_first_time(encoder):
    model = gaussians(encoder, trained=True)
    canonical = model.canonical.splats()
    assert not torch.equal(model.splats(TIME).means, canonical.means)
    assert_same_splats(model.splats(None), model.splats(torch.tensor(0.0)))
    model.deforming = False
    assert_same_splats(model.splats(TIME), canonical)
    model.splats(TIME).means.sum().backward()
    assert all(parameter.grad is None for parameter in model.field.parameters())


@pytest.mark.parametrize("encoder", ENCODERS)
def test_what_the_field_says_is_added_before_activation(encoder):
    model = gaussians(encoder, trained=True, **EVERYTHING)
    rows, splats = model.canonical, model.splats(TIME)
    change = model.field(rows.means.values, TIME)
    assert change.opacity_logits is not None
    assert change.sh is not None
    assert splats.scales is not None
    assert isinstance(splats.colors, Sh)
    assert rows.sh_rest is not None
    logits = rows.opacity_logits.values + change.opacity_logits
    torch.testing.assert_close(splats.means, rows.means.values + change.means)
    torch.testing.assert_close(splats.quats, rows.quats.values + change.quats)
    torch.testing.assert_close(splats.scales, (rows.log_scales.values + change.scales).exp())
    torch.testing.assert_close(splats.opacities, logits.sigmoid())
    coefficients = torch.cat([rows.sh_dc.values, rows.sh_rest.values], dim=1) + change.sh
    torch.testing.assert_close(splats.colors.dense(), coefficients)
    model.canonical.active_degree = 0
    constant = model.splats(TIME).colors
    assert isinstance(constant, Sh)
    torch.testing.assert_close(constant.dense(), coefficients[:, :1])


def test_rows_that_no_pixel_shows_are_not_moved_and_the_image_and_all_gradients_stay():
    found = []
    for cameras in (front_camera(), None):
        model = gaussians(trained=True)
        with torch.no_grad():
            model.canonical.opacity_logits.values[::2] = -9.0
        splats = model.splats(TIME, cameras)
        image = ReferenceRasterizer().render(splats, front_camera()).color
        image.square().sum().backward()
        found.append((model, splats, image))
    (model, fewer, image), (whole, splats, expected) = found
    assert torch.equal(fewer.means[::2], model.canonical.means.values[::2])
    assert not torch.equal(splats.means[::2], model.canonical.means.values[::2])
    assert torch.equal(fewer.means[1::2], splats.means[1::2])
    assert torch.equal(fewer.opacities, splats.opacities)
    assert torch.equal(image, expected)
    assert float(image.detach().std()) > 0
    for (name, one), other in zip(model.named_parameters(), whole.parameters(), strict=True):
        torch.testing.assert_close(one.grad, other.grad, msg=name)


def test_density_control_sees_that_a_settled_field_hides_rows_at_all_times():
    model = gaussians(trained=True)
    times = torch.linspace(0, 1, OPACITY_INSTANTS, dtype=torch.float64)
    means = model.canonical.means.values
    with torch.no_grad():  # The field then hides half of the rows, and shows the others.
        changes = torch.stack([model.field.opacity_change(means, time) for time in times]).amax(0)
        model.field.decoder.outputs[OPACITIES].bias.sub_(changes.median())
    largest = torch.stack([model.splats(time).opacities for time in times]).amax(0)
    canonical = model.canonical.opacities()
    assert 0 < int((largest < canonical).sum()) < len(means)
    torch.testing.assert_close(model.opacities(), largest.detach().minimum(canonical))
    model.settled = False
    assert torch.equal(model.opacities(), canonical)
    model = gaussians(trained=True, deform_opacity=False)
    assert torch.equal(model.opacities(), model.canonical.opacities())


def test_a_sum_of_scales_is_in_units_of_the_box_and_renders_like_its_absolute_value():
    model = gaussians(trained=True, scale_change="sum")
    rows, splats = model.canonical, model.splats(TIME)
    with torch.no_grad():
        rows.log_scales.values[:6] = -20.0
    change = model.field(rows.means.values, TIME).scales * model.field.box.size
    assert bool((change[:6] < 0).any())
    splats = model.splats(TIME)
    assert splats.scales is not None
    expected = (rows.log_scales.values.exp() + change).abs()
    torch.testing.assert_close(splats.scales, expected)


@pytest.mark.parametrize("time", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("encoder", ENCODERS)
def test_splats_have_the_gradients_of_finite_differences_for_every_parameter(encoder, time):
    model = gaussians(encoder, trained=True, **EVERYTHING)
    instant = torch.tensor(time, dtype=torch.float64)
    held = {"canonical.means.values"} if model.field.encoder.detached else set()
    inputs = tuple(value for name, value in model.named_parameters() if name not in held)
    assert len(inputs) + len(held) == len([*model.parameters()]) > 12
    assert torch.autograd.gradcheck(
        lambda *_: tuple(model.splats(instant).tensors().values()), inputs, fast_mode=True
    )


def test_sums_of_scales_have_the_gradients_of_finite_differences():
    model = gaussians(trained=True, scale_change="sum")
    instant = TIME.double()
    assert torch.autograd.gradcheck(
        lambda *_: tuple(model.splats(instant).tensors().values()),
        tuple(model.parameters()),
        fast_mode=True,
    )


@pytest.mark.parametrize(("encoder", "detached"), [("hexplane", False), ("mlp", True)])
def test_positions_move_through_the_field_where_the_paper_has_it_so(encoder, detached):
    model = gaussians(encoder, trained=True)
    splats = model.splats(TIME)
    assert splats.scales is not None
    means = model.canonical.means.values
    (through_means,) = torch.autograd.grad(splats.means.sum(), means, retain_graph=True)
    assert torch.equal(through_means, torch.ones_like(means)) == detached
    (through_scales,) = torch.autograd.grad(splats.scales.sum(), means, allow_unused=True)
    assert (through_scales is None) == detached


@pytest.mark.parametrize("encoder", ENCODERS)
def test_times_before_and_after_the_capture_count_as_its_ends(encoder):
    model = gaussians(encoder, trained=True)
    for outside, end in ((-10.0, 0.0), (1e8, 1.0), (float("inf"), 1.0)):
        first, second = (model.splats(torch.tensor(time)) for time in (outside, end))
        assert_same_splats(first, second)


@pytest.mark.parametrize("encoder", ENCODERS)
def test_extreme_parameters_make_finite_splats_and_gradients(encoder):
    model = gaussians(encoder, trained=True, **EVERYTHING).float()
    with torch.no_grad():
        for output in model.field.decoder.outputs.values():
            output.weight.mul_(1e6)
        model.canonical.means.values[:3] = torch.tensor([[1e30], [-1e30], [1e9]])
    splats = model.splats(TIME)
    assert splats.scales is not None
    assert float(splats.scales.detach().max()) <= 1.001 * torch.tensor(MAX_LOG_SCALE).exp()
    for name, tensor in splats.tensors().items():
        assert bool(tensor.isfinite().all()), name
    splats.opacities.sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is None or bool(parameter.grad.isfinite().all()), name


@pytest.mark.parametrize("encoder", ENCODERS)
def test_groups_hold_every_parameter_of_the_field_once(encoder):
    model = gaussians(encoder)
    groups = {group.name: group for group in model.parameter_groups()}
    assert set(groups) == ({"network"} if encoder == "mlp" else {"grid", "network"})
    grouped = [id(parameter) for group in groups.values() for parameter in group.parameters]
    assert sorted(grouped) == sorted(id(parameter) for parameter in model.field.parameters())
    assert set(model.columns()) == set(model.canonical.columns())


def test_rows_come_and_go_as_those_of_static_gaussians():
    model = gaussians(trained=True)
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    table, seeded = SplatTable(model, optimizer), torch.Generator().manual_seed(0)
    rows = torch.tensor([3, 5])
    for children in (
        model.clone_rows(rows, seeded),
        model.split_rows(rows, 2, seeded),
        model.relocated(rows, torch.tensor([2, 3])),
    ):
        before = len(table)
        table.append(children)
        assert len(table) == before + len(children["means"].values)
        assert len(model.splats(TIME)) == len(table)
    assert model.change_opacities_(lambda values: values.clamp_max(0.01)) == ("opacity_logits",)
    assert float(model.opacities().max()) <= 0.01 + 1e-6
    model.perturb_(0.1, seeded, Operators())
    model.project_()
    assert model.sizes().shape == (20,)
    assert model.lifetimes() is None
    assert model.active_bands() == 3
