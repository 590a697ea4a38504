"""Paths of a page: key frames, their preview and their films."""

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from support.viewing import moving_model, still_model

from gsfw.core.scene import Scene
from gsfw.rendering.film import choose_format
from gsfw.rendering.key_frames import CameraPath, KeyFrame, camera_path_of, path_frames
from gsfw.viewer import film_task as films
from gsfw.viewer.film_task import FilmOrder, film_task
from gsfw.viewer.key_frames import PathStates, with_key_frame, without_seconds
from gsfw.viewer.playback import Flight
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import CapturedView, Pose, ViewState

FRONT = Pose((0.0, 0.0, -4.0), (1.0, 0.0, 0.0, 0.0), 0.8)
STATE = ViewState(pose=FRONT, width=48, height=36)


def key(z: float, **more) -> KeyFrame:
    pose = torch.eye(4, dtype=torch.float64)
    pose[2, 3] = z
    return KeyFrame(pose, 45.0, **more)


def states(*keys: KeyFrame, fps: float = 4.0, seconds: float = 1.0) -> PathStates:
    nothing = torch.zeros(0, 3)
    scene = Scene("small", nothing, nothing, nothing, 1.0)
    return PathStates.of(CameraPath(keys, fps=fps, seconds=seconds), scene)


def test_a_key_frame_after_timed_ones_comes_as_long_after_them():
    keys = with_key_frame([key(-4, seconds=0.0), key(-5, seconds=2.0)], key(-6))
    assert [item.seconds for item in keys] == [0.0, 2.0, 4.0]
    path = CameraPath(tuple(keys), fps=2.0)
    assert len(path_frames(path).fovs) == 8
    again = camera_path_of(json.loads(json.dumps(path.document())), Path("file"))
    assert again.key_frames[2].seconds == 4


def test_key_frames_without_seconds_stay_so():
    assert with_key_frame([key(-4)], key(-5))[1].seconds is None
    timed = [key(-4, seconds=0.0), key(-5, seconds=2.0)]
    assert [item.seconds for item in without_seconds(timed)] == [None, None]


def test_a_preview_gives_back_where_the_page_was_and_nothing_else():
    from gsfw.core.datamanager import Split

    home = replace(STATE, time=0.25, view=CapturedView(Split.TRAIN, 0))
    flight = Flight(states(key(-4, time=0.5), key(-8, time=1.0)), home)
    flying = flight.state(home, 10.0)
    assert flying.view is None
    assert flying.time == 0.5
    changed = replace(flying, channel="depth", splat_scale=0.5)  # While it flies.
    flying = flight.state(changed, 10.5)
    assert (flying.channel, flying.splat_scale) == ("depth", 0.5)
    landed = flight.state(flying, 12.0)
    assert flight.ended
    assert landed == replace(home, channel="depth", splat_scale=0.5)


@pytest.fixture
def ordered(tmp_path, monkeypatch):
    """Gives a film: its order, what the page is told, and its session."""
    frames = tmp_path / "frames"
    frames.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(frames))

    def order(state, *keys, model=None):
        session, told = Session((model or still_model(),), tmp_path, "run"), []
        stem = session.free_path("films", "flight", ".mp4", ".webp")
        film = FilmOrder(states(*keys), state, stem, lambda count: None, told.append)
        return film_task(film, session), told, frames

    return order


def test_all_frames_of_a_film_of_values_have_one_scale(ordered, monkeypatch):
    written = []
    monkeypatch.setattr(films, "write_image", lambda path, image: written.append(image) or path)
    monkeypatch.setattr(films, "_encode", lambda *given: None)
    task, _, _ = ordered(replace(STATE, channel="depth"), key(-4), key(-12))
    for _ in task:
        pass
    # The same surface is far away in the last frame: by a scale of its own it would look as near.
    middle = [image[18, 24] for image in written]
    near = still_frame(replace(STATE, channel="depth"), -4)
    assert not torch.allclose(middle[0], middle[-1], atol=0.05)
    assert not np.allclose(near, np.asarray(written[0]), atol=0.02)


def still_frame(state, z):
    from gsfw.viewer.frame import FrameMaker

    pose = Pose((0.0, 0.0, float(z)), (1.0, 0.0, 0.0, 0.0), 0.8)
    return FrameMaker([still_model()]).make(replace(state, pose=pose)).image / 255


def test_a_film_that_is_given_up_leaves_nothing_behind(ordered):
    task, told, frames = ordered(STATE, key(-4), key(-5))
    next(task)
    assert any(frames.iterdir())
    task.close()
    assert not any(frames.iterdir())
    assert told == ["There is no film: the viewer was closed before it was rendered."]


def test_orders_that_are_not_done_are_given_up_with_the_service(ordered):
    task, told, frames = ordered(STATE, key(-4), key(-5))
    service = Session((still_model(),), frames, "run").service
    service.order(task)
    assert service.serve_one()
    assert service.has_orders
    service.close()
    assert not service.has_orders
    assert not any(frames.iterdir())
    assert told


def test_a_film_leaves_no_frames_behind(ordered, tmp_path):
    task, told, frames = ordered(STATE, key(-4), key(-5))
    for _ in task:
        pass
    end = time.monotonic() + 60
    while not told and time.monotonic() < end:
        time.sleep(0.01)
    assert told == [str(tmp_path / "films" / f"flight.{choose_format('auto')}")]
    while any(frames.iterdir()) and time.monotonic() < end:
        time.sleep(0.01)
    assert not any(frames.iterdir())


def differs(first, second) -> bool:
    """True if a line of pixels has another colour."""
    return (np.abs(first.astype(int) - second).max(2) > 20).sum() >= 4


def test_tracks_are_drawn_on_the_frames_of_a_page_and_follow_its_time():
    from gsfw.viewer.frame import FrameMaker

    maker = FrameMaker([moving_model()])
    state = replace(STATE, width=96, height=72, time=0.5, tracks=True)
    plain = maker.make(state).image  # Nobody has followed any Gaussian.
    maker.make_trails(state)
    drawn = maker.make(state).image
    assert differs(drawn, plain)
    later = replace(state, time=0.51)  # Between two of the times at which they are known.
    moved = maker.make(replace(later, tracks=False)).image
    assert differs(maker.make(later).image, moved)
    assert np.array_equal(maker.make(replace(state, tracks=False)).image, plain)


@pytest.mark.slow
def test_a_webp_holds_every_frame_and_opens_one_at_a_time(tmp_path, monkeypatch):
    from gsfw.rendering import film

    files = []
    for number in range(6):
        files.append(tmp_path / f"{number}.png")
        Image.new("RGB", (16, 12), (40 * number, 0, 0)).save(files[-1])
    alive, most = [], 0
    read = film._picture

    def counted(file):
        nonlocal most
        import gc
        import weakref

        gc.collect()
        picture = read(file)
        alive.append(weakref.ref(picture))
        most = max(most, sum(one() is not None for one in alive))
        return picture

    monkeypatch.setattr(film, "_picture", counted)
    (path,) = film.write_film(tmp_path / "film", files, 10, "webp")
    with Image.open(path) as made:
        assert made.n_frames == 6
        made.seek(5)
        assert made.convert("RGB").getpixel((8, 6))[0] == pytest.approx(200, abs=6)
    assert most <= 2
