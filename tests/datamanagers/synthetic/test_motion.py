"""Solids of the built-in scene move, deform, appear and vanish; their tracks are true."""

import pytest
import torch

from gsfw.core.datamanager import Split
from gsfw.datamanagers.synthetic.dome import HELD_OUT, dome
from gsfw.datamanagers.synthetic.raycast import photograph, project, rays
from gsfw.datamanagers.synthetic.scene import SyntheticScene, solids


def test_solids_translate_rotate_deform_appear_and_vanish():
    poses = {solid.name: [solid.motion(time) for time in (0.0, 0.5, 1.0)] for solid in solids(0)}
    shift = {name: float((p[2].center - p[0].center).norm()) for name, p in poses.items()}
    change = {name: float((p[1].linear - p[0].linear).norm()) for name, p in poses.items()}
    assert shift["ball"] > 0.5
    assert change["ball"] == 0
    turned = poses["crate"][0].linear.inverse() @ poses["crate"][1].linear
    assert torch.allclose(turned @ turned.T, torch.eye(3, dtype=torch.float64))
    assert change["crate"] > 0.1
    squashed = [float(pose.linear.det()) for pose in poses["drop"]]
    assert squashed == pytest.approx([squashed[0]] * 3)
    assert change["drop"] > 0.1
    assert shift["table"] == change["table"] == shift["column"] == change["column"] == 0
    there = {time: {s.name for s in solids(0) if s.is_present(time)} for time in (0.0, 0.5, 1.0)}
    assert "cone" not in there[0.0]
    assert {"cone", "pebble"} <= there[0.5]
    assert "pebble" not in there[1.0]


def test_drops_foot_stays_on_the_table_while_it_is_deformed():
    (drop,) = (solid for solid in solids(0) if solid.name == "drop")
    foot = torch.tensor([[0.0], [0.0], [-1.0]], dtype=torch.float64)
    expected = drop.motion(0.0).to_world(foot)
    for time in (0.3, 0.5, 1.0):
        assert torch.allclose(drop.motion(time).to_world(foot), expected)


def test_solids_that_move_deform_appear_or_vanish_change():
    changing = {solid.name for solid in solids(0) if solid.changes}
    assert changing == {"crate", "ball", "drop", "pebble", "cone"}


def test_tracks_pass_through_every_point_at_its_time(moving):
    times = [0.0, 0.5, 1.0]
    tracks = moving.tracks(times)
    rows = (moving.scene.point_times * 2).long()
    columns = torch.arange(len(rows))
    error = (tracks.positions[rows, columns] - moving.scene.points).norm(dim=1)
    assert float(error.max()) < 1e-6
    assert bool(tracks.present[rows, columns].all())


def test_at_any_time_rays_meet_moved_points_where_their_tracks_say(moving):
    scene, world = SyntheticScene(solids(0), 0.5), moving.scene.world_from_scene
    tracks = moving.tracks([0.5])
    points = world.apply(tracks.positions[0][tracks.present[0]]).T
    met = torch.zeros(points.shape[1], dtype=torch.bool)
    for camera in [dome(8, 0.0, 400, 300, 0).select([i]) for i in range(8)]:
        hits = scene.trace(*rays(camera, project(camera, points)))
        met |= (hits.points - points).norm(dim=0) < 1e-5
    # What is not met lies in the shade of another solid, or faces the table.
    assert float(met.float().mean()) > 0.9


def test_the_moving_mask_holds_all_that_moving_solids_ever_cover(moving, static):
    assert static.moving_mask(Split.EVAL, 0) is None
    camera = dome(2, HELD_OUT, 32, 24, 0).select([1])
    over_time = [photograph(SyntheticScene(solids(0), time), camera) for time in (0.0, 0.5, 1.0)]
    alpha = torch.stack(over_time)[..., 3].int()
    mask = moving.moving_mask(Split.EVAL, 1)[..., 0]
    # Shadows do not change what is covered, so all that does is a solid that moves.
    assert bool(mask[alpha.amax(0) - alpha.amin(0) == 255].all())
    assert 0.05 < float(mask.double().mean()) < 0.4
    # At every time the same: also where a solid has been, and where it will be.
    assert torch.equal(mask, moving.moving_mask(Split.EVAL, 1)[..., 0])
