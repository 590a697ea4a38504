"""Trails: which rows are followed, and what is drawn of them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from support.drifting_run import drifting_run
from support.moving_scene import WHITE, camera_at, two_balls

from gsfw.commands.main import main
from gsfw.core.cameras import Cameras
from gsfw.core.temporal_metrics.tracks import Tracks
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.rendering.trails import Trails, make_trails, spread


def path_of(*xs: float, opacities=None) -> Tracks:
    """One row that moves along the x axis."""
    positions = torch.tensor([[[x, 0.0, 0.0]] for x in xs])
    shown = torch.ones(len(xs), 1) if opacities is None else torch.tensor(opacities)[:, None]
    return Tracks(tuple(index / len(xs) for index in range(len(xs))), positions, shown)


def drawn(tracks: Tracks, depth=None, length: int = 10, frame: int | None = None) -> torch.Tensor:
    """How much each pixel of a white image of 32 x 24 changes."""
    trails = Trails(tracks, length, tracks.positions[0])
    white = torch.ones(24, 32, 3)
    frame = len(tracks.times) - 1 if frame is None else frame
    return (1 - trails.draw_on(white, depth, camera_at(None), frame)).amax(2)


def test_a_trail_leads_to_where_the_row_is_now_and_fades_towards_its_past():
    changed = drawn(path_of(-0.6, -0.2, 0.2, 0.6))
    rows, columns = changed.nonzero().T
    assert set(rows.tolist()) <= {10, 11, 12, 13}
    # x = 0.6 at depth 3 of a lens of 38.4 pixels is 7.68 pixels from the middle.
    assert 22 <= int(columns.max()) <= 25
    assert 7 <= int(columns.min()) <= 9
    along = changed[11:13].amax(0)
    assert float(along[22]) > float(along[16]) > float(along[10]) > 0.3


def test_a_trail_reaches_back_over_so_many_frames():
    columns = drawn(path_of(-0.6, -0.2, 0.2, 0.6), length=1).nonzero()[:, 1]
    assert int(columns.min()) >= 16


def test_edges_are_smooth():
    values = drawn(path_of(-0.6, 0.6, 0.6)).unique()
    assert len(values) >= 4, "neither on nor off"


def test_what_is_not_there_or_faint_leaves_no_trail():
    assert not bool(drawn(path_of(-0.6, 0.6, opacities=[1.0, 0.0])).any())
    broken = drawn(path_of(-0.6, -0.2, 0.2, 0.6, opacities=[1.0, 0.1, 1.0, 1.0]))
    assert int(broken.nonzero()[:, 1].min()) >= 16
    behind = path_of(-0.6, 0.6)
    behind.positions[:, :, 2] = -9.0
    assert not bool(drawn(behind).any())


def test_a_surface_in_front_hides_a_trail_and_one_behind_does_not():
    depth = torch.zeros(24, 32, 1)
    depth[:, :16] = 2.0
    depth[:, 16:] = 4.0
    columns = drawn(path_of(-0.6, 0.0, 0.6), depth).nonzero()[:, 1]
    assert int(columns.min()) == 16
    assert int(columns.max()) >= 22


def test_nothing_outside_the_image_is_drawn():
    assert not bool(drawn(path_of(50.0, 60.0)).any())
    assert bool(drawn(path_of(-0.2, 50.0)).any()), "a part of it is inside"


def test_places_are_chosen_far_from_one_another_and_always_the_same():
    places = torch.cat([torch.zeros(50, 2), torch.tensor([[9.0, 0], [0, 9.0], [9, 9.0]])])
    chosen = spread(places, 4)
    assert {tuple(place) for place in places[chosen].tolist()} == {(0, 0), (9, 0), (0, 9), (9, 9)}
    assert torch.equal(spread(places, 4), chosen)
    assert spread(places, 99).tolist() == list(range(53))


def test_rows_behind_the_surface_are_not_followed():
    model = two_balls()
    with torch.no_grad():
        model.means.values[1] = torch.tensor([-0.4, -0.4, 1.0])  # Behind the first at the start,
        model.velocities.values[1] = torch.tensor([0.8, 0.0, 0.0])  # and always.
        model.log_scales.values[1] -= 1.0
    cameras = Cameras.cat([camera_at(index / 4) for index in range(5)])
    trails = make_trails(model, ReferenceRasterizer(), cameras, WHITE, count=5, length=3)
    assert trails._positions.shape == (5, 1, 3)
    assert trails._positions[:, 0, 0].tolist() == pytest.approx([-0.4, -0.2, 0.0, 0.2, 0.4])
    nothing = make_trails(
        model, ReferenceRasterizer(), replace(cameras, world_to_camera=-cameras.world_to_camera),
        WHITE, count=5, length=3,
    )  # fmt: skip
    assert nothing._positions.shape[1] == 0


# Through the command line.

SCENE = (
    "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "datamanager.moving=true",
    "datamanager.times=3", "steps=5", "init_opacity=0.9",
)  # fmt: skip


@pytest.fixture(scope="module")
def moving_run(tmp_path_factory):
    """A run of a method whose splats drift, on the built-in scene that moves."""
    with drifting_run(tmp_path_factory.mktemp("runs") / "moving", *SCENE) as out:
        yield out


@pytest.mark.slow
def test_tracks_are_drawn_where_time_passes(moving_run, tmp_path):
    for tracks in ("false", "true"):
        arguments = ["render", str(moving_run), f"tracks={tracks}", f"out={tmp_path / tracks}"]
        assert main([*arguments, "frames=3", "video=none", "what=time"]) == 0
    images = [
        np.asarray(Image.open(tmp_path / tracks / "time" / "0002.png")).astype(int)
        for tracks in ("false", "true")
    ]
    assert np.abs(images[0] - images[1]).max() > 50


@pytest.mark.slow
def test_tracks_of_what_does_not_move_are_refused(moving_run, capsys):
    assert main(["render", str(moving_run), "tracks=true", "what=orbit"]) == 2
    assert capsys.readouterr().err == (
        "error: tracks=true what=orbit: nothing moves there.\n"
        "Render what=time or what=orbit-time, or leave tracks out.\n"
    )
    assert main(["render", str(moving_run), "tracks=true", "tracks_frames=0"]) == 2
    assert "tracks_frames=0: expected a number of at least 1." in capsys.readouterr().err


def test_paths_are_exported_in_the_world_of_the_data(moving_run, tmp_path, capsys):
    out = tmp_path / "tracks.npz"
    assert main(["export", str(moving_run), "format=tracks", f"out={out}"]) == 0
    assert "Gaussians at 3 times after 5 steps" in capsys.readouterr().out
    ply = tmp_path / "splats.ply"
    assert main(["export", str(moving_run), "time=0.5", f"out={ply}"]) == 0
    from gsfw.formats.ply import PlyImporter

    with np.load(out) as found:
        world = found["positions"] + found["origin"]
        assert found["data_times"].tolist() == [0.0, 0.5, 1.0]
        assert bool(found["present"].all())
    expected = PlyImporter().read(ply).splats.means.numpy()
    np.testing.assert_allclose(world[1], expected, atol=1e-5)


def test_paths_take_two_times(moving_run, capsys):
    assert main(["export", str(moving_run), "format=tracks", "times=1"]) == 2
    assert capsys.readouterr().err == (
        "error: tracks at 1 times: expected at least 2.\n"
        "Paths need a moving model: gsfw export RUN format=tracks times=50\n"
    )
