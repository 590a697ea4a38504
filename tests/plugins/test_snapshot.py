"""Snapshots of models for files."""

import torch
from support.gaussians import gaussians, table_of
from support.scenes import random_splats

from gsfw.core.column import Column
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.model import PrimitiveModel
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.plugins.snapshot import snapshot


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
