"""The page in Chromium: what is seen, and what its buttons do."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.chromium import Page, needs_chromium
from support.fast_rasterizer import fast_rasterizer
from support.small_scene import SMALL_SCENE
from support.viewing import OneView, captured_model, moving_model, served, still_model

from gsfw.viewer.frame import FrameMaker
from gsfw.viewer.panels import path_panel
from gsfw.viewer.view_state import CapturedView, Comparison, Pose

pytestmark = [pytest.mark.slow, needs_chromium]

ALLOWED_ERRORS = (
    # viser tells of WebGL in software, and three.js of empty shapes; both are harmless.
    "computeBoundingSphere",
    "GPU stall due to ReadPixels",
)
SCENE_BOX = (slice(200, 720), slice(0, 930))
"""Rows and columns of the page that neither panel nor messages cover."""
CANVAS = 956
"""Width of the image beside the panel, on a page of 1280 pixels."""
SHOTS = os.environ.get("GSFW_SHOTS", "")
"""A folder for screenshots to look at."""


@contextmanager
def shown(browser, folder, *models) -> Iterator[tuple]:
    """The session of some models, with one page open, at rest."""
    with served(folder, *models) as session:
        page = browser.open(session.server.address)
        page.wait_for("document.body.innerText.includes('Background')")
        try:
            yield session, page
        finally:
            errors = page.errors(ALLOWED_ERRORS)
            page.close()
            assert not errors


def viewport(session, number=-1):
    return session.session.service._viewports[number]


def settle(session, number=-1, seconds=60.0):
    """Wait until a page has its newest state at full size."""
    end = time.monotonic() + seconds
    while not session.session.service._viewports and time.monotonic() < end:
        time.sleep(0.02)
    port = viewport(session, number)
    while time.monotonic() < end:
        done = port._rendered == port._version and port._scale == 1.0 and not port._sending
        if done and time.monotonic() - port._changed > 0.5:
            return
        time.sleep(0.02)
    raise AssertionError("the page never came to rest")


def until(condition, seconds: float = 60.0) -> None:
    """Wait until a condition of this process is true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def seen(page: Page, name: str) -> np.ndarray:
    """The part of the page that shows the scene, once it stands still: viser fades it in."""
    path = Path(SHOTS) / f"{name}.png" if SHOTS else None
    last, end = page.screenshot(), time.monotonic() + 30
    while True:
        time.sleep(0.4)
        image = page.screenshot(path)
        if (image == last).all() or time.monotonic() > end:
            return image[SCENE_BOX].astype(float)
        last = image


def psnr(first: np.ndarray, second: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / max(((first - second) ** 2).mean(), 1e-9)))


def differ(first: np.ndarray, second: np.ndarray) -> bool:
    """True if more than noise has changed: one pixel of a thousand, by a tenth of the range."""
    return float((np.abs(first - second).max(2) > 25).mean()) > 1e-3


def test_the_page_asks_no_other_machine_for_anything(browser, tmp_path):
    with shown(browser, tmp_path, still_model(rasterizer=fast_rasterizer())) as (session, page):
        settle(session)
        asked = [place for place in page.requests() if not place.startswith(("data:", "blob:"))]
        own = session.server.address
        assert asked
        assert not [place for place in asked if not place.startswith(own)]


def test_the_splats_of_the_page_are_those_of_a_direct_render(browser, tmp_path):
    model = still_model(count=400, rasterizer=fast_rasterizer())
    with shown(browser, tmp_path, model) as (session, page):
        settle(session)
        end, found = time.monotonic() + 30, 0.0
        while found < 35 and time.monotonic() < end:  # viser fades the scene in.
            image = seen(page, "still")
            whole = FrameMaker([model]).make(viewport(session).state).image
            wanted = whole[SCENE_BOX].astype(float)
            if whole.shape[:2] == (720, CANVAS):
                found = psnr(image, wanted)
        assert wanted.std() > 10  # There is something to see.
        assert found >= 35
        assert not [url for url in page.requests() if not url.startswith(session.server.address)]


def test_orbiting_changes_the_image(browser, tmp_path):
    with shown(browser, tmp_path, still_model(rasterizer=fast_rasterizer())) as (session, page):
        settle(session)
        before = seen(page, "orbit-before")
        pose = viewport(session).state.pose
        page.drag((400, 400), (520, 430))
        until(lambda: viewport(session).state.pose != pose)
        settle(session)
        until(lambda: differ(before, seen(page, "orbit-after")))


def test_the_time_slider_moves_the_scene_and_play_goes_on(browser, tmp_path):
    with shown(browser, tmp_path, moving_model(fast_rasterizer())) as (session, page):
        settle(session)
        before = seen(page, "time-0")
        x, y = page.evaluate(
            """(() => {
              const track = [...document.querySelectorAll('.mantine-Slider-track')][0];
              const box = track.getBoundingClientRect();
              return [box.x + box.width * 0.9, box.y + box.height / 2];
            })()"""
        )
        page.click((x, y))
        until(lambda: viewport(session).state.time == pytest.approx(0.9, abs=0.05))
        settle(session)
        until(lambda: differ(before, seen(page, "time-1")))
        page.click_text("Play")
        page.wait_for("[...document.querySelectorAll('button')].some(b => b.innerText === 'Pause')")
        first = viewport(session).state.time
        until(lambda: viewport(session).state.time != first)


def test_a_click_on_a_frustum_shows_the_photo_of_its_view(browser, tmp_path):
    model = captured_model((0.9, 0.2, 0.1), rasterizer=fast_rasterizer())
    with shown(browser, tmp_path, model) as (session, page):
        settle(session)
        page.click_text("Cameras")
        page.wait_for("document.body.innerText.includes('Show cameras')")
        page.click_text("Show cameras")
        home = viewport(session).state.pose
        page.wheel(500, 400, 600)  # Back, so that the camera is in front.
        until(lambda: viewport(session).state.pose != home)
        settle(session)
        seen(page, "cameras")  # The browser has drawn them.
        page.click(frustum_place(session))
        port = viewport(session)
        until(lambda: port.state.view is not None)
        assert port.state.comparison is Comparison.SIDE_BY_SIDE
        settle(session)
        red, end = np.array([230.0, 51.0, 26.0]), time.monotonic() + 20
        image = np.zeros((720, 1280, 3))
        while np.abs(image[330, 400] - red).max() >= 8 and time.monotonic() < end:
            image = page.screenshot(Path(SHOTS) / "frustum.png" if SHOTS else None).astype(float)
        assert np.abs(image[330, 400] - red).max() < 8
        assert "PSNR" in page.text()
        page.drag((400, 400), (500, 420))
        until(lambda: port.state.view is None)  # Whoever moves looks from elsewhere.


def frustum_place(session) -> tuple[float, float]:
    """A place on the page where the line of the camera's frustum is."""
    from gsfw.viewer.camera_frusta import SIZE

    state = viewport(session).state
    pose = Pose.of(session.session.model.camera(CapturedView(*_first_view())))
    world_to_camera = state.pose.world_to_camera().numpy()
    inner = np.linalg.inv(pose.world_to_camera().numpy())
    length = SIZE * session.session.first.size
    tip = inner[:3, 3] + 0.0 * length * inner[:3, 2]
    x, y, z = world_to_camera[:3, :3] @ tip + world_to_camera[:3, 3]
    focal = 0.5 * state.height / np.tan(0.5 * state.pose.fov)
    return 0.5 * state.width + focal * x / z, 0.5 * state.height + focal * y / z


def _first_view():
    from gsfw.core.datamanager import Split

    return Split.TRAIN, 0


def test_key_frames_become_a_file_and_a_film(browser, tmp_path, monkeypatch):
    monkeypatch.setattr(path_panel, "SECONDS", 2.0)
    monkeypatch.setattr(path_panel, "FPS", 10.0)
    with shown(browser, tmp_path, still_model(rasterizer=fast_rasterizer())) as (session, page):
        settle(session)
        page.click_text("Path")
        page.wait_for("document.body.innerText.includes('Add key frame')")
        page.click_text("Add key frame")
        start = viewport(session).state.pose
        page.drag((400, 400), (520, 430))
        until(lambda: viewport(session).state.pose != start)
        settle(session)
        page.click_text("Add key frame")
        page.wait_for("document.body.innerText.includes('Save path')")
        page.click_text("Save path")
        wait_for_file(tmp_path / "paths" / "flight.json")
        document = json.loads((tmp_path / "paths" / "flight.json").read_text())
        assert len(document["key_frames"]) == 2
        home = viewport(session).state.pose
        page.click_text("Preview")
        until(lambda: viewport(session).state.pose != home)
        page.click_text("Render film")
        page.screenshot(Path(SHOTS) / "path.png" if SHOTS else None)
        films = wait_for_file(tmp_path / "films" / "flight.mp4", tmp_path / "films" / "flight.webp")
        assert films.stat().st_size > 1000


def wait_for_file(*paths: Path, seconds: float = 60.0) -> Path:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for path in paths:
            if path.is_file():
                return path
        time.sleep(0.1)
    raise AssertionError(f"none of {paths} was written")


def test_two_pages_have_their_own_cameras_and_one_that_dies_harms_no_other(browser, tmp_path):
    with shown(browser, tmp_path, still_model(rasterizer=fast_rasterizer())) as (session, page):
        settle(session)
        other = browser.open(session.server.address)
        other.wait_for("document.body.innerText.includes('Background')")
        settle(session)
        page.to_front()
        home = viewport(session, 0).state.pose
        page.drag((400, 400), (520, 430))
        until(lambda: viewport(session, 0).state.pose != home)
        settle(session, 0)
        settle(session, 1)
        assert viewport(session, 0).state.pose != viewport(session, 1).state.pose
        other.to_front()
        second = seen(other, "page-two")
        page.to_front()
        assert differ(seen(page, "page-one"), second)
        other.to_front()
        other.drag((400, 400), (420, 430))
        other.close()  # In mid-frame.
        page.to_front()
        page.drag((400, 400), (450, 430))
        until(lambda: session.session.service.pages == 1)
        settle(session, 0)


def test_two_runs_are_compared_in_one_page(browser, tmp_path):
    rasterizer = fast_rasterizer()
    models = [still_model(name, 300, seed, rasterizer) for seed, name in enumerate(["one", "two"])]
    with shown(browser, tmp_path, *models) as (session, page):
        settle(session)
        assert viewport(session).state.comparison is Comparison.SIDE_BY_SIDE
        until(lambda: differ(*np.split(seen(page, "compare")[:, 30:920], [445], axis=1)))
        assert "one | two" in page.text()


@pytest.fixture
def training(tmp_path):
    """A run in a process of its own: the process, and the address of its page."""
    command = [sys.executable, "-u", "-m", "gsfw", "train", "method=3dgs", *SMALL_SCENE]
    command += ["steps=1000000", "rescale=false", f"out={tmp_path / 'run'}", "viewer=true"]
    command += ["device=cpu", "checkpoint_every=0", "eval_every=0"]
    with subprocess.Popen(
        [*command, "callbacks.tensorboard.enabled=false"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        found = next(filter(None, (re.search(r"http://127\S+", line) for line in process.stderr)))
        # A pipe that nobody empties would stop the run.
        drain = threading.Thread(target=process.stderr.read)
        drain.start()
        yield process, found[0], tmp_path / "run"
        process.kill()
        drain.join()


def step_of(page: Page) -> int:
    return int(re.search(r"step\s+([\d,]+) of", page.text())[1].replace(",", ""))


def test_pause_stops_the_counter_of_steps_and_resume_starts_it(browser, training):
    process, address, run = training
    page = browser.open(address)
    page.wait_for("document.body.innerText.includes('Run')")
    page.click_text("Run")
    page.wait_for("/step\\s+[\\d,]+ of/.test(document.body.innerText)")
    first = step_of(page)
    page.wait_for(f"!document.body.innerText.includes('{first:,} of')")
    page.click_text("Pause")
    page.wait_for("document.body.innerText.includes('3dgs: paused')")
    held = step_of(page)
    page.screenshot(Path(SHOTS) / "training.png" if SHOTS else None)
    page.click_text("Checkpoint")
    wait_for_file(run / "checkpoints" / f"step_{held:09d}.pt")
    page.wait_for("document.body.innerText.includes('last checkpoint')")
    assert step_of(page) == held
    page.click_text("Export as PLY")
    wait_for_file(run / "exports" / f"step_{held:06d}.ply")
    page.click_text("Resume")
    page.wait_for(f"!document.body.innerText.includes('{held:,} of')")
    assert step_of(page) > held
    assert not page.errors(ALLOWED_ERRORS)
    page.click_text("Stop")
    page.click_text("Stop it")
    process.wait(60)
    assert process.returncode == 0
    page.close()


def test_ctrl_c_ends_a_paused_run_with_a_checkpoint(browser, training):
    process, address, run = training
    page = browser.open(address)
    page.wait_for("document.body.innerText.includes('Run')")
    page.click_text("Run")
    page.wait_for("/step\\s+[\\d,]+ of/.test(document.body.innerText)")
    page.click_text("Pause")
    page.wait_for("document.body.innerText.includes('3dgs: paused')")
    held = step_of(page)
    process.send_signal(signal.SIGINT)
    process.wait(60)
    assert (run / "checkpoints" / f"step_{held:09d}.pt").is_file()
    page.close()


def test_an_export_of_a_run_that_trains_holds_it_for_a_moment(browser, training):
    _, address, run = training
    page = browser.open(address)
    page.wait_for("document.body.innerText.includes('Run')")
    page.click_text("Run")
    page.wait_for("/step\\s+[\\d,]+ of/.test(document.body.innerText)")
    page.click_text("Export as PLY")
    until(lambda: any((run / "exports").glob("step_*.ply")))
    exported = int(next((run / "exports").glob("*.ply")).stem.removeprefix("step_"))
    until(lambda: step_of(page) > exported)
    page.close()


def test_the_slider_follows_the_time_of_a_captured_view(browser, tmp_path):
    balls = moving_model(fast_rasterizer())
    model = replace(balls, data=OneView((0.9, 0.2, 0.1), time=0.75), has_cameras=True)
    with shown(browser, tmp_path, model) as (session, page):
        settle(session)
        page.click_text("Cameras")
        page.click_text("Next")
        until(lambda: viewport(session).state.view is not None)
        assert viewport(session).state.time == 0.75
        page.click_text("View")
        page.wait_for("[...document.querySelectorAll('input')].some(i => i.value === '0.75')")


def test_a_light_page_is_light(browser, tmp_path):
    with shown(browser, tmp_path, still_model(rasterizer=fast_rasterizer())) as (session, page):
        settle(session)
        page.click_text("Picture", selector="*")
        # Not by its place: the folder still opens.
        label = "[...document.querySelectorAll('label')].find(l => l.innerText === 'Light page')"
        page.wait_for(f"!!{label}")
        page.evaluate(f"{label}.click()")
        until(lambda: page.screenshot()[600, 1200].min() > 200)
        page.screenshot(Path(SHOTS) / "light.png" if SHOTS else None)
