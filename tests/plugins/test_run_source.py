"""A run as a source: colours of tracks, whatever form the model keeps its colours in."""

from dataclasses import replace

import torch
from support.moving_scene import two_balls

from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.splats import Sh
from gsfw.plugins.run_source import _first_colors


def test_rows_of_different_sh_degrees_have_their_base_colours(monkeypatch):
    model = two_balls()
    splats = model.splats(torch.tensor(0.0))
    dense = torch.rand(len(splats), 4, 3)
    degrees = torch.arange(len(splats)) % 2
    ragged = replace(splats, colors=Sh(dense, 1).of_degrees(degrees))
    monkeypatch.setattr(model, "splats", lambda time=None, cameras=None: ragged)
    assert torch.allclose(_first_colors(model, [0.0, 1.0]), dc_to_rgb(dense[:, 0]))
