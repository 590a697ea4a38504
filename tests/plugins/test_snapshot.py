"""Snapshots of models for files."""

from dataclasses import replace

import torch
from support.gaussians import gaussians, table_of
from support.scenes import front_camera, random_splats
from support.view_models import ByView

from gsfw.core.column import Column
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.model import PrimitiveModel
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.plugins.snapshot import snapshot, view_notes


def scene() -> Scene:
    points = random_splats(4, degree=0).means
    return Scene("a", points, points.abs(), points, 1.0)


def test_a_model_that_has_lost_all_rows_is_a_snapshot_without_any():
    model = gaussians(3)
    table_of(model)[1].keep(torch.zeros(3, dtype=torch.bool))
    taken = snapshot(model, scene(), False)
    assert len(taken.splats) == taken.num_dropped == 0


def test_rows_that_are_not_finite_are_left_out_and_counted():
    model = gaussians(5)
    with torch.no_grad():
        model.means.values[2, 1] = torch.inf
    taken = snapshot(model, scene(), False)
    assert (len(taken.splats), taken.num_dropped) == (4, 1)


class Plain(PrimitiveModel):
    """Splats with three channels as colours, as a new plugin has."""

    def __init__(self, means):
        super().__init__()
        self.means = Column(means)

    def columns(self):
        return {"means": self.means}

    def splats(self, time=None, cameras=None):
        means = self.means.values
        ones = torch.ones(len(means))
        quats = torch.eye(1, 4).expand(len(means), 4)
        return Splats(means, 0.5 * ones, means.abs(), quats, ones[:, None].expand(-1, 3))


class Decoded(Plain):
    def decode(self, output, cameras):
        return output


def test_three_channels_that_nothing_decodes_are_colours_of_a_file():
    means = random_splats(4, degree=0).means.float()
    colors = snapshot(Plain(means), scene(), False).splats.colors
    assert isinstance(colors, Sh)
    torch.testing.assert_close(dc_to_rgb(colors.coefficients[:, 0]).float(), means.abs())
    assert not isinstance(snapshot(Decoded(means), scene(), False).splats.colors, Sh)


class ExtraByView(ByView):
    """Its extra channels alone are of the view."""

    def splats(self, time=None, cameras=None):
        splats = self.given.splats(time)
        extra = None if cameras is None else cameras.centers.expand(len(splats), 3)
        return replace(splats, extra=extra)


def test_a_warning_says_that_the_splats_of_views_are_others_than_those_of_files():
    model, camera = gaussians(5), front_camera()
    assert view_notes(model, camera) == []
    (note,) = view_notes(ByView(model), camera)
    assert "may look different from renders of the model" in note


def test_extra_channels_of_a_view_which_no_file_holds_are_not_warned_of():
    assert view_notes(ExtraByView(gaussians(5)), front_camera()) == []


class Brighter(ExtraByView):
    """It multiplies colours after rendering; a gain of 1 leaves them as they are."""

    def __init__(self, given, gain):
        super().__init__(given)
        self.gain = gain

    def decode(self, output, cameras):
        return replace(output, color=self.gain * output.color)


def test_a_warning_says_that_a_model_changes_colours_after_rendering():
    (note,) = view_notes(Brighter(gaussians(5), 1.5), front_camera())
    assert note.startswith("this model changes colours after rendering: a file of splats has ")
    assert view_notes(Brighter(gaussians(5), 1.0), front_camera()) == []


class Blurred(ExtraByView):
    """It needs images of at least six pixels."""

    def decode(self, output, cameras):
        channels_first = output.color.permute(0, 3, 1, 2)
        padded = torch.nn.functional.pad(channels_first, (5, 5, 5, 5), mode="reflect")
        blurred = torch.nn.functional.avg_pool2d(padded, 11, stride=1)
        return replace(output, color=blurred.permute(0, 2, 3, 1))


def test_decoding_is_tried_on_images_of_the_size_of_the_views():
    assert len(view_notes(Blurred(gaussians(5)), front_camera())) == 1
