"""The bench of peers: one capture for all, fake trainers that leave a PLY, scores and curves."""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import peers.__main__ as bench
import pytest
import torch
from peers.__main__ import check_same_bench
from peers.capture import write_training_views
from peers.held_out import HeldOutViews, Score
from peers.job import Job, Order, Usage, run
from peers.opensplat import build_opensplat
from peers.results import Result, Results
from peers.trainers import gsfw_jobs, opensplat_jobs, original_jobs
from PIL import Image
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, ring, write_colmap

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Sh, Splats
from gsfw.formats.ply import PlyExporter
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer

FAR_AWAY = (100.0, -40.0, 7.0)
"""The scene frame is not the world of the data."""


def splats_at(points) -> Splats:
    generator = torch.Generator().manual_seed(3)
    n = len(points)
    return Splats(
        torch.tensor(points).double(),
        torch.full((n,), 0.9).double(),
        Sh(torch.randn(n, 4, 3, generator=generator).double(), 1),
        torch.tensor([[1.0, 0, 0, 0]]).double().repeat(n, 1),
        torch.full((n, 3), 0.3).double(),
    )


@pytest.fixture
def scene(tmp_path):
    """A COLMAP capture of eight photos of a model far from the origin, and the model's PLY."""
    capture = ring(views=8, size=5.0, origin=FAR_AWAY)
    splats = splats_at(capture.points)
    matrix = torch.tensor([[FOCAL[0], 0, CENTER[0]], [0, FOCAL[1], CENTER[1]], [0, 0, 1.0]])
    (tmp_path / "scene" / "images").mkdir(parents=True)
    for name, pose in zip(capture.names, capture.poses, strict=True):
        camera = Cameras(torch.tensor(pose)[None], matrix.double()[None], WIDTH, HEIGHT)
        color = CpuRasterizer().render(splats, camera).color[0]
        pixels = (255 * color.clamp(0, 1)).round().byte().numpy()
        Image.fromarray(pixels).save(tmp_path / "scene" / "images" / name)
    write_colmap(tmp_path / "scene" / "sparse" / "0", capture)
    PlyExporter().write(tmp_path / "made.ply", SplatFile(splats))
    return tmp_path


def fake_job(folder: Path, source: Path, peer="fake", length="10 steps") -> Job:
    target = folder / "fake" / peer / "splats.ply"
    copy = "import shutil, sys; shutil.copy(*sys.argv[1:]); print('copied')"
    command = (sys.executable, "-c", copy, str(source), str(target))
    return Job(peer, length, target.parent, command, target)


def result(peer="a", length="10 steps", repeat=1, seconds=2.0, psnr=20.0) -> Result:
    return Result(peer, length, repeat, seconds, 2 * seconds, psnr, 0.8, 1000)


def test_the_model_that_made_the_photos_scores_as_high_as_their_rounding_allows(scene):
    score = HeldOutViews.open(scene / "scene", 1).score(scene / "made.ply")
    assert score.psnr > 55
    assert score.ssim > 0.999
    assert score.gaussians == 20


def test_a_model_beside_its_place_scores_low(scene):
    made = splats_at(ring(views=8, size=5.0, origin=FAR_AWAY).points)
    PlyExporter().write(scene / "moved.ply", SplatFile(replace(made, means=made.means + 1)))
    assert HeldOutViews.open(scene / "scene", 1).score(scene / "moved.ply").psnr < 30


def test_a_model_is_rendered_over_the_background_of_its_trainer(scene):
    views = HeldOutViews.open(scene / "scene", 1)
    over_white = views.score(scene / "made.ply", (1.0, 1.0, 1.0))
    assert over_white.psnr < views.score(scene / "made.ply").psnr - 10


@pytest.mark.slow
def test_trainers_get_the_training_views_at_the_size_of_training_and_no_others(scene):
    views = HeldOutViews.open(scene / "scene", 2)
    folder = write_training_views(views.data, scene / "written")
    read = HeldOutViews.open(scene / "scene", 2).data.views(Split.TRAIN)
    assert sorted(path.name for path in (folder / "images").iterdir()) == sorted(read.names)
    again = HeldOutViews.open(folder, 1).data
    cameras = {
        name: camera
        for split in Split
        for name, camera in zip(again.views(split).names, again.views(split).cameras, strict=True)
    }
    for name, camera in zip(read.names, read.cameras, strict=True):
        assert (cameras[name].width, cameras[name].height) == (WIDTH // 2, HEIGHT // 2)
        torch.testing.assert_close(cameras[name].intrinsics, camera.intrinsics)
        written = again.scene.world_from_scene.camera(cameras[name].world_to_camera)
        given = views.data.scene.world_from_scene.camera(camera.world_to_camera)
        torch.testing.assert_close(written, given, atol=1e-4, rtol=0)
    (batch,) = views.data.load(Split.TRAIN, [0], torch.device("cpu"))
    pixels = np.asarray(Image.open(folder / "images" / read.names[0]))
    np.testing.assert_array_equal(pixels, (255 * batch.images[0]).round().byte().numpy())


def test_points_reach_the_trainers_where_they_were(scene):
    views = HeldOutViews.open(scene / "scene", 1)
    written = HeldOutViews.open(write_training_views(views.data, scene / "written"), 1)
    first, second = (
        data.scene.world_from_scene.apply(data.scene.points) for data in (views.data, written.data)
    )
    torch.testing.assert_close(second, first, atol=1e-4, rtol=0)


def test_a_capture_without_points_is_refused_with_the_remedy(scene):
    capture = replace(
        ring(views=8, size=5.0, origin=FAR_AWAY), points=np.zeros((0, 3)), colors=np.zeros((0, 3))
    )
    write_colmap(scene / "scene" / "sparse" / "0", capture)
    views = HeldOutViews.open(scene / "scene", 1)
    with pytest.raises(DataError, match=r"(?s)no points.*gsfw prepare"):
        write_training_views(views.data, scene / "written")


def test_images_with_alpha_are_refused_as_trainers_read_them_differently(scene):
    for path in (scene / "scene" / "images").iterdir():
        Image.open(path).convert("RGBA").save(path)
    views = HeldOutViews.open(scene / "scene", 1)
    with pytest.raises(DataError, match="alpha"):
        write_training_views(views.data, scene / "written")


def test_a_job_is_timed_and_its_words_are_kept(scene):
    job = fake_job(scene, scene / "made.ply")
    usage = run(job, threads=1)
    assert usage.cpu_seconds > 0
    assert usage.wall_seconds > 0
    assert (job.folder / "log.txt").read_text() == "copied\n"


def test_a_trainer_that_fails_is_named_with_its_log_and_its_command(scene):
    with pytest.raises(SystemExit, match=r"(?s)fake, 10 steps: ended with 1.*log\.txt.*-c"):
        run(fake_job(scene, scene / "missing.ply"), threads=1)


def test_a_trainer_that_leaves_no_model_is_named(scene):
    job = replace(fake_job(scene, scene / "made.ply"), splats=scene / "elsewhere.ply")
    with pytest.raises(SystemExit, match="left no PLY"):
        run(job, threads=1)


@pytest.mark.slow
def test_the_bench_scores_fake_trainers_and_goes_on_where_it_stopped(scene, monkeypatch, capsys):
    made = scene / "made.ply"
    fakes = [fake_job(scene, made), fake_job(scene, made, peer="other")]
    monkeypatch.setattr(bench, "jobs", lambda given, capture: fakes)
    out = scene / "out"
    monkeypatch.setattr(sys, "argv", ["peers", str(scene / "scene"), "--out", str(out)])
    bench.main()
    said = capsys.readouterr()
    assert said.err.count("20 Gaussians") == 2
    assert "| trainer | length | CPU s | wall s | Gaussians | PSNR | SSIM |" in said.out
    assert (out / "curves.png").stat().st_size > 1000
    bench.main()
    assert capsys.readouterr().err == ""


def test_results_are_medians_over_repeats_in_order_of_time(tmp_path):
    results = Results(tmp_path / "results.jsonl")
    for repeat, seconds in enumerate((1.0, 9.0, 2.0), 1):
        results.add(result(repeat=repeat, seconds=seconds))
    results.add(result(length="5 steps", seconds=0.5, psnr=15.0))
    read = Results(tmp_path / "results.jsonl")
    assert [(row.length, row.cpu_seconds) for row in read.medians()] == [
        ("5 steps", 0.5),
        ("10 steps", 2.0),
    ]
    assert read.medians()[1].repeat == 3


def test_time_to_a_quality_is_that_of_the_cheapest_training_that_has_it(tmp_path):
    results = Results(tmp_path / "results.jsonl")
    results.add(result(seconds=1.0, psnr=20.0))
    results.add(result(length="30 steps", seconds=4.0, psnr=25.0))
    results.add(result(peer="b", seconds=8.0, psnr=24.0))
    assert results.times_to((20, 25)).splitlines()[2:] == ["| a | 1.0 | 4.0 |", "| b | 8.0 | - |"]


def test_every_trainer_gets_the_same_capture_and_a_folder_of_its_own(tmp_path):
    (tmp_path / "train.py").touch()
    order = Order(tmp_path / "capture", tmp_path / "runs", (300, 1000))
    jobs = gsfw_jobs(order, (1.0,)) + gsfw_jobs(order, (), "sh=adaptive seed=1")
    jobs += opensplat_jobs(order, tmp_path / "opensplat")
    jobs += original_jobs(order, tmp_path)
    assert len({job.folder for job in jobs}) == len(jobs) == 11
    assert jobs[3].command[-2:] == ("sh=adaptive", "seed=1")
    assert all(str(order.capture) in " ".join(job.command) for job in jobs)
    assert all(job.splats.is_relative_to(job.folder) for job in jobs)


def test_sources_that_are_none_are_refused_with_the_remedy(tmp_path):
    with pytest.raises(SystemExit, match="git clone"):
        build_opensplat(tmp_path, tmp_path / "build")
    with pytest.raises(SystemExit, match=r"train\.py is missing"):
        original_jobs(Order(tmp_path, tmp_path, (1,)), tmp_path)


def test_a_result_has_the_figures_of_its_job():
    job = Job("a", "10 steps", Path(), (), Path())
    made = Result.of(job, 1, Usage(2.0, 4.0), Score(20.0, 0.8, 1000))
    assert made == result()


def test_a_folder_with_results_of_other_work_is_refused(tmp_path):
    given = argparse.Namespace(
        data=Path("fox"), downscale=4.0, threads=1, opensplat=None, original=None, out=tmp_path
    )
    check_same_bench(given)
    given.opensplat = Path("OpenSplat")
    check_same_bench(given)  # One more trainer.
    given.downscale = 2.0
    with pytest.raises(DataError, match=r"downscale=4\.0, not 2\.0"):
        check_same_bench(given)


def test_a_line_that_was_cut_off_is_written_again(tmp_path):
    file = tmp_path / "results.jsonl"
    whole = Results(file)
    whole.add(Result("gsfw", "300 steps", 1, 9.0, 9.5, 21.0, 0.7, 100))
    file.write_text(file.read_text() + '{"peer": "gs')
    assert Results(file).rows == whole.rows
    assert Results(file).rows == whole.rows, "the file is whole again"
