"""New rows where the image lacks something: every method puts them where they are asked for."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import toy_scene

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh
from gsfw.core.table import SplatTable
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

METHODS = {
    "3dgs": {},
    "spacetime": {},
    "features": {"method": "spacetime", "preset": "features"},
    "freetime": {"method": "spacetime", "preset": "freetime"},
    "4d-rotor": {},
    "two-quaternions": {"method": "4d-rotor", "rotation": "two-quaternions"},
    "4dgs": {},
    "mlp": {"method": "4dgs", "encoder": "mlp"},
}
FIELDS = ("4dgs", "mlp")
"""Those whose rows are moved by a field, to which the way back is found by iteration."""
POINTS = torch.tensor([[0.2, 0.3, 0.4], [0.8, 0.1, 0.5], [0.5, 0.9, 0.2]])
COLORS = torch.tensor([[1.0, 0.0, 0.2], [0.5, 0.5, 0.5], [0.1, 0.7, 0.0]])
SIZES = torch.tensor([0.01, 0.1, 0.05])


def model_of(name: str):
    """A model of twelve rows, whose networks are no longer those of the first step."""
    typed = {"method": name, **METHODS[name]}
    config = resolve(installed(), [Layer(COMMAND_LINE, typed)]).config
    generator = torch.Generator().manual_seed(0)
    scene = toy_scene(12, num_times=0 if name == "3dgs" else 5)
    model = config.build().build_model(scene, Operators(), generator, None)
    with torch.no_grad():
        for group in model.parameter_groups():
            for parameter in group.parameters:
                parameter.add_(0.003 * torch.randn(parameter.shape, generator=generator))
    return model


def with_new_rows(name: str, time: float | None):
    """A model to which rows were added, and the splats of these rows at their time."""
    model = model_of(name)
    table = SplatTable(model, Optimizer(model, Operators(), OptimizerSettings()))
    table.append(model.rows_at(POINTS, COLORS, SIZES, time))
    model.project_()
    splats = model.splats(None if time is None else torch.tensor(time))
    rows = torch.arange(len(splats)) if splats.rows is None else splats.rows
    return model, replace(splats, rows=None).map(lambda values: values[rows >= 12])


@pytest.mark.parametrize("name", [name for name in METHODS if name not in FIELDS])
@pytest.mark.parametrize("time", [0.0, 0.3, 1.0])
def test_new_rows_are_where_they_are_asked_for_at_that_time(name, time):
    model, splats = with_new_rows(name, time)
    assert model.num_rows == 15
    torch.testing.assert_close(splats.means, POINTS, atol=1e-4, rtol=0)
    torch.testing.assert_close(splats.opacities, torch.full((3,), 0.1), atol=1e-3, rtol=0)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("time", [0.0, 0.3, 1.0])
def test_a_field_moves_new_rows_to_about_where_they_are_asked_for(name, time):
    model, splats = with_new_rows(name, time)
    moved = (model.field(POINTS, torch.tensor(time)).means).detach().norm(dim=1)
    missed = (splats.means.detach() - POINTS).norm(dim=1)
    assert float(moved.min()) > 1e-3
    assert bool((missed < 0.3 * moved).all())


@pytest.mark.parametrize("name", [name for name in METHODS if name not in FIELDS])
def test_new_rows_are_round_and_have_the_size_and_the_colour_asked_for(name):
    _, splats = with_new_rows(name, 0.3)
    assert isinstance(splats.colors, Sh)
    torch.testing.assert_close(dc_to_rgb(splats.colors.dense()[:, 0]), COLORS)
    assert not splats.colors.dense()[:, 1:].any()
    if splats.covariances is None:
        torch.testing.assert_close(splats.scales, SIZES[:, None].expand(-1, 3))
    else:
        expected = torch.eye(3) * SIZES.square()[:, None, None]
        torch.testing.assert_close(splats.covariances, expected)


@pytest.mark.parametrize("name", [name for name in METHODS if name not in ("3dgs", *FIELDS)])
def test_rows_that_come_and_go_are_there_around_the_time(name):
    model, _ = with_new_rows(name, 0.2)
    opacities = []
    for time in (0.2, 0.4, 1.0):
        splats = model.splats(torch.tensor(time))
        rows = torch.arange(len(splats)) if splats.rows is None else splats.rows
        opacities.append(float(splats.opacities[rows >= 12].sum().detach()))
    assert opacities[0] > 1.5 * opacities[1] > 15 * opacities[2]


@pytest.mark.parametrize("name", METHODS)
def test_a_static_capture_has_no_time_to_give(name):
    model, _ = with_new_rows(name, None)
    assert model.num_rows == 15
    assert len(model.rows_at(POINTS[:0], COLORS[:0], SIZES[:0], None)["means"].values) == 0
