"""Opening: runs, model files, and splats of other tools."""

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from support.view_models import ByView
from support.viewer_page import open_page
from support.viewing import still_model

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.exchange import SplatFile
from gsfw.formats.ply import PlyExporter
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer
from gsfw.rendering.key_frames import camera_path_of
from gsfw.viewer.export import export_splats
from gsfw.viewer.film_task import FilmOrder, film_task
from gsfw.viewer.first_view import first_view
from gsfw.viewer.frame import FrameMaker
from gsfw.viewer.key_frames import CameraPath, PathStates, key_frame, pose_of
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import CapturedView, Pose, ViewState
from gsfw.viewer.viewed_model import ViewedModel

FRONT = Pose((0.0, 0.0, -4.0), (1.0, 0.0, 0.0, 0.0), 0.8)
STATE = ViewState(pose=FRONT, width=48, height=36)


def opened(path):
    found = find_run(str(path), print, splats=True)
    restored = restore_run(found, installed(), Layer("the test", {"device": "cpu"}))
    return ViewedModel.of(found.name, restored, has_cameras=found.splat_file is None)


@pytest.fixture(scope="module")
def run(finished_run):
    return opened(finished_run)


def test_a_run_opens_with_its_cameras_and_photos(run):
    assert run.has_photos
    assert len(run.captured()) == len(run.data.views(Split.TRAIN)) + len(run.data.views(Split.EVAL))
    state = replace(STATE, view=CapturedView(Split.EVAL, 0))
    assert FrameMaker([run]).make(state).psnr > 5


def test_the_first_view_is_that_of_the_first_camera_and_looks_ahead(run):
    first = first_view(run)
    camera = run.data.views(Split.TRAIN).cameras[0]
    assert np.allclose(first.pose.position, camera.centers[0].numpy(), atol=1e-5)
    ahead = first.pose.world_to_camera()[2, :3] @ (
        torch.tensor(first.target, dtype=torch.float64)
        - torch.tensor(first.pose.position, dtype=torch.float64)
    )
    assert float(ahead) > 0
    assert first.sh_degree == 3


def test_a_model_file_shows_the_same_as_its_run(run, finished_run, tmp_path):
    path = tmp_path / "model.gsfw"
    assert main(["export", str(finished_run), "format=gsfw", f"out={path}"]) == 0
    file = opened(path)
    pose = first_view(run).pose
    state = replace(STATE, pose=pose)
    assert np.array_equal(FrameMaker([run]).make(state).image, FrameMaker([file]).make(state).image)
    assert not file.has_photos


def test_splats_of_another_tool_show_as_what_they_are(tmp_path):
    model = still_model(count=30)
    path = tmp_path / "splats.ply"
    double = model.model.splats().map(torch.Tensor.double)
    PlyExporter().write(path, SplatFile(double))
    file = opened(path)
    assert not file.captured()  # Nobody stood at the cameras that it is seen from.
    world = file.scene.world_from_scene
    camera = STATE.pose.cameras(48, 36)
    placed = world.inverse().camera(camera.world_to_camera).float()
    seen = Pose.of(replace(camera, world_to_camera=placed))
    first = FrameMaker([model]).make(STATE).image
    second = FrameMaker([file]).make(replace(STATE, pose=seen)).image
    assert np.abs(first.astype(int) - second).max() <= 1
    view = first_view(file)
    image = FrameMaker([file]).make(replace(STATE, pose=view.pose)).image
    assert image.any()  # From outside, looking at it.


def test_an_export_holds_what_the_page_shows(run, tmp_path):
    state = replace(STATE, splat_scale=0.5)
    path = tmp_path / "view.ply"
    count, notes = export_splats(run, state, path)
    assert len(opened(path).model.splats()) == count
    assert notes == []


def test_an_export_of_splats_that_depend_on_the_view_says_so(run, tmp_path):
    by_view = replace(run, model=ByView(run.model))
    _, (note,) = export_splats(by_view, STATE, tmp_path / "view.ply")
    assert note.startswith("the splats of this model depend on the view: a file of splats has")


def test_models_are_called_by_method_and_scene_where_these_tell_them_apart(run, tmp_path):
    def names(*subjects: str) -> list[str]:
        models = (replace(run, name=f"runs/{place}", subject=subject)
                  for place, subject in enumerate(subjects))  # fmt: skip
        return Session(tuple(models), tmp_path, "run").names

    assert names("3dgs on fox") == ["3dgs on fox"]
    assert names("3dgs on fox", "4dgs on fox") == ["3dgs on fox", "4dgs on fox"]
    assert names("3dgs on fox", "3dgs on fox") == ["0", "1"]
    assert names("3dgs on fox", "") == ["0", "1"], "the second is a file"


def test_no_file_of_a_page_replaces_another(run, tmp_path):
    session = Session((run,), tmp_path, "run")
    first = session.free_path("films", "my film/../x", ".mp4", ".webp")
    assert first == tmp_path / "films" / "my-film----x"
    second = session.free_path("films", "my film/../x", ".mp4", ".webp")
    assert second.name == "my-film----x_2"  # Though neither is written yet.
    (tmp_path / "films" / "old.webp").touch()
    assert session.free_path("films", "old", ".mp4", ".webp").name == "old_2"


def test_a_key_frame_survives_the_world_of_the_data(run):
    pose = first_view(run).pose
    frame = key_frame(replace(STATE, pose=pose), run.scene, moves=False)
    assert frame.time is None
    back = pose_of(frame.camera_to_world, frame.fov, run.scene)
    assert np.allclose(back.position, pose.position, atol=1e-6)
    assert np.allclose(np.abs(back.wxyz), np.abs(pose.wxyz), atol=1e-6)
    assert back.fov == pytest.approx(pose.fov)


def test_a_path_of_the_page_is_a_file_that_render_reads(run):
    keys = [key_frame(replace(STATE, pose=pose), run.scene, False) for pose in poses(run)]
    path = CameraPath(tuple(keys), fps=5.0, seconds=1.0)
    again = camera_path_of(json.loads(json.dumps(path.document())), Path("file"))
    states = PathStates.of(again, run.scene)
    assert len(states) == 5
    assert np.allclose(states.at(0, STATE).pose.position, poses(run)[0].position, atol=1e-4)


def poses(run):
    cameras = run.data.views(Split.TRAIN).cameras
    return [Pose.of(camera) for camera in cameras[:3]]


def test_a_film_is_rendered_part_by_part(run, tmp_path):
    keys = [key_frame(replace(STATE, pose=pose), run.scene, False) for pose in poses(run)]
    states = PathStates.of(CameraPath(tuple(keys), fps=4.0, seconds=1.0), run.scene)
    told, counts = [], []
    order = FilmOrder(states, STATE, tmp_path / "film", counts.append, told.append)
    parts = sum(1 for _ in film_task(order, Session((run,), tmp_path, "run")))
    import threading

    for thread in threading.enumerate():
        if thread.name == "viewer-film":
            thread.join(60)
    assert parts == len(counts) == 4
    (film,) = tmp_path.glob("film.*")
    assert told == [str(film)]


@pytest.mark.slow
def test_the_verb_serves_a_page_until_it_is_interrupted(finished_run, tmp_path):
    command = [sys.executable, "-u", "-m", "gsfw", "view", str(finished_run), "json=true"]
    with (
        (tmp_path / "told").open("w+") as told,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=told, text=True) as process,
    ):
        assert process.stdout is not None
        lines = []
        for line in process.stdout:  # It ends with the process, if that fails.
            lines.append(line)
            if line.strip() == "}":
                break
        document = json.loads("".join(lines))
        with open_page(document["address"]) as page:
            page.look(FRONT)
            page.wait_for_frame()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert "closed" in (tmp_path / "told").read_text()
