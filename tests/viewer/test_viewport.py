"""Viewports: the newest state of a page, and what is rendered of it."""

import threading
import time
from dataclasses import replace

import numpy as np

from gsfw.viewer.frame import Frame
from gsfw.viewer.playback import DURATION, Playback
from gsfw.viewer.view_state import ViewState
from gsfw.viewer.viewport import REST_SECONDS, Viewport

LATER = 10 * REST_SECONDS


def frame(request, seconds=0.01):
    width, height = request.state.full_size()
    size = (round(height * request.scale), round(width * request.scale), 3)
    return Frame(np.zeros(size, np.uint8), seconds)


def make(send=lambda frame, still: None):
    return Viewport(ViewState(), send, lambda: None)


def deliver(viewport, request, seconds=0.01):
    viewport.deliver(request, frame(request, seconds))
    end = time.monotonic() + 10
    while viewport._sending and time.monotonic() < end:
        time.sleep(0.001)


def at(viewport, fraction):
    return lambda state: replace(state, time=fraction)


def test_only_the_newest_state_is_rendered():
    viewport = make()
    for moment in (0.1, 0.2, 0.3):
        viewport.change(at(viewport, moment))
    request = viewport.wanted(time.monotonic(), 0.05)
    assert request.state.time == 0.3
    deliver(viewport, request)
    assert viewport.wanted(time.monotonic(), 0.05) is None


def test_a_moving_page_gets_small_frames_that_are_refined_at_rest():
    viewport = make()
    viewport.change(at(viewport, 0.5))
    now = time.monotonic()
    deliver(viewport, viewport.wanted(now, 0.05), seconds=1.0)
    viewport.change(at(viewport, 0.6))
    moving = viewport.wanted(time.monotonic(), 0.05)
    assert moving.scale < 0.5
    deliver(viewport, moving, seconds=0.05)
    scales = []
    while (request := viewport.wanted(time.monotonic() + LATER, 0.05)) is not None:
        scales.append(request.scale)
        deliver(viewport, request)
    assert scales == sorted(scales)
    assert scales[-1] == 1.0


def test_a_model_that_changes_keeps_an_image_at_rest_sharp():
    viewport = make()
    later = time.monotonic() + LATER
    while (request := viewport.wanted(later, 0.05)) is not None:
        deliver(viewport, request, seconds=1.0)
    viewport.refresh()
    assert viewport.wanted(later, 0.05).scale == 1.0


def test_an_equal_state_is_no_change():
    viewport = make()
    later = time.monotonic() + LATER
    while (request := viewport.wanted(later, 0.05)) is not None:
        deliver(viewport, request)
    viewport.change(replace)
    assert viewport.wanted(later, 0.05) is None


def test_a_slow_page_gets_nothing_new_until_it_has_taken_the_last_frame():
    taken = threading.Event()
    viewport = make(lambda frame, still: taken.wait(10))
    request = viewport.wanted(time.monotonic(), 0.05)
    started = time.monotonic()
    viewport.deliver(request, frame(request))
    assert time.monotonic() - started < 1.0  # Who renders does not wait.
    viewport.change(at(viewport, 0.4))
    assert viewport.wanted(time.monotonic(), 0.05) is None
    taken.set()


def test_a_page_that_breaks_in_mid_frame_harms_nobody():
    def broken(frame, still):
        raise ConnectionError("gone")

    viewport = make(broken)
    deliver(viewport, viewport.wanted(time.monotonic(), 0.05))
    viewport.change(at(viewport, 0.4))
    assert viewport.wanted(time.monotonic(), 0.05) is not None


def test_a_closed_page_wants_nothing():
    viewport = make()
    viewport.close()
    assert viewport.wanted(time.monotonic(), 0.05) is None


def test_a_state_that_fails_is_told_once():
    viewport, told = make(), []
    viewport.problem = told.append
    viewport.fail(viewport.wanted(time.monotonic(), 0.05), "there is no such channel")
    assert told == ["there is no such channel"]
    assert viewport.wanted(time.monotonic() + LATER, 0.05) is None


def test_playback_loops_at_its_speed():
    playback = Playback(playing=True, speed=2.0)
    assert playback.advance(0.9, 10.0) == 0.9  # The clock starts with the first call.
    moved = playback.advance(0.9, 10.0 + 0.1 * DURATION)
    assert abs(moved - 0.1) < 1e-6


def test_playback_without_a_loop_ends_at_the_last_time():
    playback = Playback(playing=True, loop=False)
    playback.advance(0.9, 0.0)
    assert playback.advance(0.9, DURATION) == 1.0
    assert not playback.playing


def test_a_page_that_plays_moves_by_itself():
    viewport = make()
    viewport.play(True)
    viewport.wanted(0.0, 0.05)
    assert viewport.wanted(0.25 * DURATION, 0.05).state.time == 0.25


def test_a_playback_goes_on_where_it_stopped():
    playback = Playback(playing=True)
    playback.advance(0.2, 0.0)
    playback.play(False)
    playback.play(True)
    assert playback.advance(0.2, 10.0) == 0.2


def test_a_page_that_closes_while_a_frame_is_made_is_no_error():
    viewport = make()
    viewport.change(at(viewport, 0.5))
    request = viewport.wanted(time.monotonic(), 0.05)
    viewport.close()
    viewport.deliver(request, frame(request))
    assert viewport.wanted(time.monotonic(), 0.05) is None


def test_a_state_that_cannot_be_rendered_is_told_once():
    viewport, told = make(), []
    viewport.problem = told.append
    viewport.change(at(viewport, 0.5))
    for _ in range(3):
        viewport.fail(viewport.wanted(time.monotonic(), 0.05), "no such channel")
        viewport.refresh()
    assert told == ["no such channel"]
