"""Moving Gaussians of which some stand still: images, gradients, and rows that come and go."""

import math

import pytest
import torch
from support.mixed_rows import CONFIGS, WRITTEN, check_rows, mixed, standing
from support.model_gradients import check_gradients, drawn
from support.moving_splats import at, moving_scene, seeded
from support.scenes import random_splats

from gsfw.core.errors import ConfigError
from gsfw.core.operators import Operators
from gsfw.methods.moving.gaussians import moving_children
from gsfw.methods.moving.method import MovingMethod

METHODS = tuple(CONFIGS)


def row_of(splats, name: str) -> torch.Tensor:
    return splats.tensors()[name].detach()


@pytest.mark.parametrize("method", METHODS)
def test_rows_that_stand_still_are_the_same_at_all_times_and_others_are_not(method):
    model, _ = mixed(method)
    still = model.still.rows()
    first, last = model.splats(at(0.1)), model.splats(at(0.8))
    assert first.rows is None
    for name in first.tensors():
        assert torch.equal(row_of(first, name)[still], row_of(last, name)[still]), name
    assert not (first.means == last.means)[model.still.moving()].any()


@pytest.mark.parametrize("method", METHODS)
def test_rows_that_stand_still_look_like_static_gaussians(method):
    model, _ = standing(method)
    splats, canonical = model.splats(at(0.3)), model.canonical.splats()
    assert torch.equal(splats.means, canonical.means)
    assert torch.equal(splats.opacities, canonical.opacities)
    assert len(model.splats()) == 16


@pytest.mark.parametrize("method", METHODS)
def test_a_row_that_begins_to_move_leaves_every_image_as_it_was(method):
    model, table = standing(method)
    before = [model.splats(at(time)) for time in (0.0, 0.5, 1.0)]
    rows = torch.arange(0, 16, 2)
    model.start_(table, rows, torch.full((8,), 0.5, dtype=torch.float64))
    check_rows(model, table)
    assert model.still.moving().tolist() == rows.tolist()
    for time, earlier in zip((0.0, 0.5, 1.0), before, strict=True):
        now = model.splats(at(time))
        for name in earlier.tensors():
            tolerance = 2e-3 if name == "opacities" else 1e-7
            torch.testing.assert_close(
                row_of(now, name), row_of(earlier, name), atol=tolerance, rtol=1e-6
            )


def test_a_row_that_begins_to_move_does_so_where_a_trained_field_leaves_it_on_average():
    model, table = standing("4dgs")
    with torch.no_grad():
        for tensor in (t for group in model.parameter_groups() for t in group.parameters):
            tensor.add_(0.02 * torch.randn(tensor.shape, generator=seeded(), dtype=torch.float64))
    before = model.splats(at(0.0))
    model.start_(table, torch.tensor([3]), torch.tensor([0.5], dtype=torch.float64))
    seen = [model.splats(at(index / 8)) for index in range(9)]
    mean = torch.stack([splats.means[3] for splats in seen]).mean(0)
    torch.testing.assert_close(mean, before.means[3], atol=1e-4, rtol=0)
    assert (seen[0].means[3] - seen[8].means[3]).norm().item() > 1e-4


@pytest.mark.parametrize("method", METHODS)
def test_gradients_agree_with_difference_quotients_for_every_column(method):
    model, _ = mixed(method, n=7)
    check_gradients(model, lambda: drawn(model, at(0.45)), without=("time_centers",))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
def test_rows_stay_in_order_through_everything_that_is_done_to_them(method, seed):
    model, table = mixed(method)
    generator = seeded(seed)

    def some() -> torch.Tensor:
        chosen = torch.rand(len(table), generator=generator) < 0.4
        chosen[0] = True
        return chosen.nonzero()[:, 0]

    def start() -> None:
        rows = model.still.rows()
        rows = rows[torch.rand(len(rows), generator=generator) < 0.5]
        model.start_(table, rows, torch.rand(len(rows), generator=generator).double())

    def grow() -> None:
        points = torch.rand(2, 3, generator=generator).double()
        table.append(model.rows_at(points, points, torch.full((2,), 0.1).double(), 0.3))

    actions = (
        lambda: table.keep(torch.rand(len(table), generator=generator) < 0.8),
        lambda: table.append(model.clone_rows(some(), generator)),
        lambda: table.append(model.split_rows(some(), 2, generator)),
        lambda: table.replace(rows := some(), model.relocated(rows, torch.full_like(rows, 2))),
        lambda: model.perturb_(1e-3, generator, Operators()),
        start,
        grow,
    )
    twice = [torch.randperm(len(actions), generator=generator) for _ in range(2)]
    for choice in torch.cat(twice).tolist():
        actions[choice]()
        model.project_()
        check_rows(model, table)
        count = len(table)
        for found in (model.lifetimes(), model.sizes(), model.opacities()):
            assert found is None or found.shape == (count,)
        splats = model.splats(at(0.5))
        assert len(splats) == count
        assert all(bool(tensor.isfinite().all()) for tensor in splats.tensors().values())


@pytest.mark.parametrize("method", METHODS)
def test_children_are_of_the_kind_of_their_parents(method):
    model, table = mixed(method)
    still, rows = model.still.mask(), torch.tensor([0, 1, 5, 6])
    table.append(model.clone_rows(rows, seeded()))
    table.append(model.split_rows(rows, 2, seeded()))
    expected = torch.cat([still, still[rows], still[rows.repeat(2)]])
    assert torch.equal(model.still.mask(), expected)


@pytest.mark.parametrize("method", METHODS)
def test_children_that_move_are_known_whatever_the_temporal_columns_are(method):
    model, _ = mixed(method)
    rows = torch.tensor([0, 1, 5, 6])
    for children in (model.clone_rows(rows), model.split_rows(rows, 2, seeded())):
        moving = ~model.still.mask()[rows.repeat(len(children["means"].values) // len(rows))]
        assert moving_children(children).tolist() == moving.nonzero()[:, 0].tolist()
    assert moving_children(model.canonical.clone_rows(rows)) is None


def test_children_of_rows_that_stand_still_are_those_of_static_gaussians():
    model, _ = mixed("4d-rotor")
    rows = torch.tensor([1, 2, 4])  # None of which moves.
    children = model.split_rows(rows, 2, seeded())
    assert len(children["time_centers"].values) == 0
    shrunk = children["log_scales"].values - model.canonical.log_scales.values[rows.repeat(2)]
    torch.testing.assert_close(shrunk, torch.full_like(shrunk, -math.log(1.6)))


@pytest.mark.parametrize("method", ["spacetime", "4d-rotor"])
def test_what_stands_still_is_there_for_the_whole_sequence(method):
    model, _ = mixed(method)
    lifetimes = model.lifetimes().detach()
    assert lifetimes[model.still.rows()].tolist() == [1.0] * len(model.still.rows())
    assert lifetimes[model.still.moving()].max().item() < 0.99


def test_a_model_says_how_many_rows_stand_still_and_what_it_takes():
    model, table = standing("spacetime", n=10)
    static = model.summary()
    model.start_(table, torch.tensor([4]), torch.tensor([0.5], dtype=torch.float64))
    summary = model.summary()
    assert (summary["static_rows"], summary["moving_rows"]) == (9, 1)
    assert summary["static_share"] == 0.9
    time_values = 1 + 1 + 9 + 4
    assert summary["model_bytes"] - static["model_bytes"] == 8 * time_values


@pytest.mark.parametrize("method", [name for name in METHODS if name != "adaptive"])
def test_with_static_none_every_row_changes_and_no_column_is_ragged(method):
    config, splats = CONFIGS[method], random_splats(5, degree=0)
    model = config.build().build_model(moving_scene(), Operators(), seeded(), splats)
    assert model.still is None
    assert model.moving() is None
    assert all(column.offsets is None for column in model.columns().values())
    assert "static_rows" not in model.summary()


def test_a_refusal_names_the_method_as_it_is_registered():
    method = CONFIGS["4dgs"].build()
    method.registered_as = "method 'mine' (gsfw-mine 0.1)"
    with pytest.raises(ConfigError, match=r"^method 'mine' \(gsfw-mine 0.1\) is for captures of"):
        method.check_scene(moving_scene(num_times=1))


def test_new_rows_at_errors_are_at_rest_unless_a_model_says_otherwise():
    model, _ = mixed("written")
    points = torch.rand(3, 3, dtype=torch.float64, generator=seeded())
    children = model.rows_at(points, points, torch.full((3,), 0.1), 0.5)
    assert children.keys() == model.columns().keys()
    assert torch.equal(children["means"].values, points)
    assert not children["paths"].values.any()


def test_the_parts_of_a_split_keep_the_path_of_their_parent():
    model, _ = mixed("written")
    assert model.still is not None
    row = model.still.moving()[1:2]
    children = model.split_rows(row, 2, seeded())
    assert torch.equal(children["paths"].values, model.paths.values[1:2].repeat(2, 1, 1))
    assert not torch.equal(children["means"].values[0], children["means"].values[1])


class Restless(MovingMethod):
    """A method that passes no settings of static rows."""

    def __init__(self, config):
        super().__init__(config)

    def build_model(self, scene, operators, generator, initial):
        raise NotImplementedError


def test_a_method_whose_rows_all_move_refuses_static_rows():
    assert Restless(WRITTEN.WrittenConfig()).still_rows(4) is None
    with pytest.raises(ConfigError, match=r"^static=auto: all Gaussians of this method move"):
        Restless(WRITTEN.WrittenConfig(static="auto"))
