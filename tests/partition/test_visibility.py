from dataclasses import replace

import numpy as np
import torch
from support.street import write_street

from gsfw.core.datamanager import DataRequest
from gsfw.datamanagers.frames import Sightings
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.partition.visibility import visibility


def test_views_see_the_points_below_them(tmp_path):
    data = TransformsConfig().build(DataRequest(write_street(tmp_path / "street")))
    seen = visibility(data)
    assert not seen.by_tracks
    left = seen.places[:, 0] < -4
    counts = seen.seen(left)
    assert counts[:4].min() > 0
    assert counts[-4:].max() == 0
    assert seen.views_per_point() > 2


def test_a_wall_hides_what_is_behind_it(tmp_path):
    data = TransformsConfig().build(DataRequest(write_street(tmp_path / "street")))
    x, y = torch.meshgrid(torch.linspace(-7, 7, 80), torch.linspace(-2, 2, 24), indexing="ij")
    roof = torch.stack([x.flatten(), y.flatten(), torch.full((x.numel(),), 1.0)], dim=1).double()
    below = data.recording.points
    points = torch.cat([below, roof])
    data.recording = replace(
        data.recording, points=points, point_colors=torch.zeros(len(points), 3)
    )
    seen = visibility(data)
    is_below = np.arange(len(seen.places)) < len(below)
    assert seen.seen(is_below).sum() < 0.05 * seen.seen(~is_below).sum()


def test_tracks_of_the_reconstruction_come_first(tmp_path):
    data = TransformsConfig().build(DataRequest(write_street(tmp_path / "street")))
    tracks = Sightings(np.array([0, 0, 5]), np.array([1, 2, 2]), np.zeros(400))
    data.recording = replace(data.recording, sightings=lambda: tracks)
    seen = visibility(data)
    assert seen.by_tracks
    assert seen.seen(np.ones(400, bool))[:4].tolist() == [0, 1, 2, 0]
