"""Moving models: rows are left out by where they are over time, and worlds move around them."""

from dataclasses import replace

import pytest
import torch
from support.editing import WORLD, balls, edited
from support.moving_scene import WHITE
from support.view_models import ByView

from gsfw.core.column import Column
from gsfw.core.errors import ConfigError
from gsfw.core.loop.evaluation import render_model
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Sh
from gsfw.editing import colors

SCENE = Similarity()
RIGHT = "0,-1,-1,1,1,1"
"""A box that the drifting ball enters, and where the standing ball is on its face."""


def names(piece):
    """Which of the two balls are left: the red one moves."""
    red = piece.model.sh_dc.values[:, 0, 0] > 0
    return ["red" if is_red else "blue" for is_red in red.tolist()]


def image(piece, time=0.7):
    camera = piece.capture().cameras[0]
    return render_model(
        piece.model, piece.capture().rasterizer, camera, WHITE, torch.tensor(time)
    ).color


def test_a_row_stays_that_is_inside_at_any_time_or_at_all_times():
    assert names(edited(balls(world=SCENE), "crop.box", RIGHT).piece) == ["red", "blue"]
    assert names(edited(balls(True, SCENE), "crop.box", RIGHT).piece) == ["blue"]
    assert names(edited(balls(world=SCENE), "crop.sphere", "0.4,-0.4,0,0.1").piece) == ["red"]


def test_a_row_goes_that_is_in_the_cut_at_any_time_or_at_all_times():
    assert names(edited(balls(True, SCENE), "cut.box", RIGHT).piece) == ["red"]
    assert names(edited(balls(world=SCENE), "cut.sphere", "0.4,-0.4,0,0.1").piece) == ["blue"]


def test_regions_are_in_the_world_and_follow_what_was_moved():
    end = WORLD.apply(torch.tensor([0.4, -0.4, 0.0]))
    text = ",".join(map(str, end.tolist()))
    piece = balls()
    assert names(edited(balls(), "crop.sphere", f"{text},0.3").piece) == ["red"]
    moved = edited(piece, "move", "1,2,3").piece
    text = ",".join(map(str, (end + torch.tensor([1, 2, 3])).tolist()))
    assert names(edited(moved, "crop.sphere", f"{text},0.3").piece) == ["red"]


def test_a_transform_changes_no_parameter_and_leads_to_the_world_of_the_points():
    piece = balls()
    before = {name: value.clone() for name, value in piece.model.state_dict().items()}
    points = piece.splats().means
    turned = edited(edited(piece, "rotate", "y,70").piece, "scale", "2").piece
    state = turned.model.state_dict()
    assert all(torch.equal(before[name], state[name]) for name in before)
    angle = torch.deg2rad(torch.tensor(70.0, dtype=torch.float64))
    x, y, z = points.unbind(1)
    expected = 2 * torch.stack(
        [angle.cos() * x + angle.sin() * z, y, -angle.sin() * x + angle.cos() * z], dim=1
    )
    assert torch.allclose(turned.splats().means, expected)
    assert turned.up == "-y"


def test_colours_of_a_moving_model_are_those_of_the_image_after_the_change():
    piece = balls()
    before = image(piece)
    change = colors.contrast(0.8)
    after = image(piece.recolored(change))
    # The background is white, before and after.
    covered = 1 - render_model(
        two_black(), piece.capture().rasterizer, piece.capture().cameras[0], WHITE,
        torch.tensor(0.7),
    ).color  # fmt: skip
    object_colors = before - (1 - covered)
    expected = object_colors * 0.8 + 0.1 * covered + (1 - covered)
    assert float((after - before).abs().max()) > 0.05
    assert float((after - expected).abs().max()) < 1e-4


def two_black():
    """The same two balls, in black."""
    model = balls().model
    with torch.no_grad():
        model.sh_dc.values.fill_(-0.5 / 0.28209479177387814)
    return model


def test_a_method_that_makes_colours_of_more_than_its_columns_is_refused():
    piece = balls()
    model = piece.model

    def tinted(time=None, cameras=None):
        splats = type(model).splats(model, time)
        return replace(splats, colors=Sh(splats.colors.coefficients + 1, 0))

    model.splats = tinted
    with pytest.raises(ConfigError, match="drifting makes its colours of more than the columns"):
        piece.recolored(colors.brightness(2.0))


def test_upper_bands_are_left_out_of_ragged_and_of_dense_columns():
    piece = balls()
    piece.model.degree = piece.model.active_degree = 2
    rest = torch.ones(2, 8, 3)
    piece.model.sh_rest = Column(rest, piece.model.means.learning_rate, bands=True)
    assert piece.degree == 2
    values = piece.truncated(1).model.sh_rest.values
    assert values[:, :3].min() == 1
    assert values[:, 3:].abs().max() == 0


def test_what_a_row_adds_is_measured_at_the_time_of_each_view():
    contributions = balls().contributions()
    assert contributions.views.tolist() == [4, 4]
    assert (contributions.total > 10).all()
    assert names(edited(balls(), "decimate.count", "1").piece) != ["red", "blue"]


def test_no_other_splats_join_a_model():
    with pytest.raises(ConfigError, match="can only be left out, not added"):
        edited(balls(), "merge", "other.ply")


def test_a_static_model_is_decimated_with_refitted_colours_and_a_moving_one_without():
    moving = edited(balls(), "decimate.count", "1")
    assert (len(moving.piece), moving.note) == (1, "by contribution, colours as they were")
    still = replace(balls(), times=(0.0,))
    still = still.with_constants(torch.full((2, 3), 0.7))
    result = edited(still, "decimate.count", "1")
    assert len(result.piece) == 1
    assert "before colours were refitted" in result.note


class Tinted(ByView):
    """Its colours too are of the view."""

    def splats(self, time=None, cameras=None):
        splats = super().splats(time, cameras)
        if cameras is None:
            return splats
        return replace(splats, colors=Sh(splats.colors.coefficients.square(), 0))


def test_colours_that_depend_on_the_view_are_not_changed():
    change = colors.brightness(1.5)
    fading = replace(balls(), model=ByView(balls().model))
    assert fading.recolored(change) is fading
    tinted = replace(balls(), model=Tinted(balls().model))
    with pytest.raises(ConfigError, match="makes its colours of more than the columns"):
        tinted.recolored(change)


def test_rows_whose_splats_depend_on_the_view_are_pruned_by_their_views_and_not_refitted():
    still = replace(balls(), times=(0.0,))
    piece = replace(still, model=ByView(still.model))
    assert not piece.can_refit()
    assert (piece.contributions().total < still.contributions().total).all()
    assert set(piece.model.asked) == {1}


def test_a_model_fits_a_size():
    piece = balls()
    each = piece.row_bytes()
    assert each == sum(c.values[0].nbytes for c in piece.model.columns().values())
    assert len(edited(piece, "decimate.mb", "0.000150").piece) == 1
