"""`gsfw convert` writes splats in another format, and says what is lost."""

import json
import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from support.scenes import random_splats

from gsfw.commands import convert
from gsfw.commands.main import main
from gsfw.core.exchange import Motion, MotionFile, SplatFile
from gsfw.core.metrics import PSNR_MAX
from gsfw.core.motion.evaluation import splats_at
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.formats.splatv import SplatvExporter, SplatvImporter
from gsfw.plugins import motion_quality, orbit_psnr

pytestmark = pytest.mark.unchecked

PLUGIN = """
from gsfw.api import Exporter, Holds, Spec, hookimpl


class Site(Exporter):
    suffix = ""
    is_folder = True

    def write(self, path, source):
        path.mkdir(exist_ok=True)
        (path / "index").write_text(str(len(source.splat_file().splats)))


class Moving(Exporter):
    suffix = ".moving"
    holds = Holds.MOTION

    def write(self, path, source):
        content = source.motion_file()
        path.write_text(f"{len(content.content.splats)} {content.is_still}")


@hookimpl
def gsfw_exporters():
    place = "formats_to_convert_to:"
    return [Spec("site", "a folder", place + "Site"), Spec("moving", "motion", place + "Moving")]
"""


@pytest.fixture(autouse=True)
def _small_images(monkeypatch, tmp_path):
    monkeypatch.setattr(orbit_psnr, "WIDTH", 48)
    monkeypatch.setattr(orbit_psnr, "HEIGHT", 27)
    monkeypatch.chdir(tmp_path)


def splats(count=20, degree=2):
    return random_splats(count, degree, dtype=torch.float64)


@pytest.fixture
def source(tmp_path):
    """A PLY of 20 splats, of which one is too faint to be seen, and one is not finite."""
    content = splats()
    opacities = content.opacities.clone()
    opacities[3] = 0.001
    path = tmp_path / "in.ply"
    PlyExporter().write(path, SplatFile(replace(content, opacities=opacities), up="z"))
    raw = bytearray(path.read_bytes())
    raw[-4:] = b"\x00\x00\xc0\x7f"  # The last quaternion is NaN.
    path.write_bytes(raw)
    return path


def converted(capsys, *words):
    """The document of a conversion."""
    assert main(["convert", *map(str, words), "json=true"]) == 0
    return json.loads(capsys.readouterr().out)


def refusal(capsys, *words):
    assert main(["convert", *map(str, words)]) == 2
    return capsys.readouterr().err.removeprefix("error: ")


def test_counts_sizes_and_the_loss_are_said(source, tmp_path, capsys):
    assert main(["convert", str(source), "out.ply"]) == 0
    written = tmp_path / "out.ply"
    said = capsys.readouterr().out
    assert said.startswith(f"18 splats of {source} to out.ply, 4 kB (")
    assert "left out: 1 that are not finite, 1 too faint to be seen\n" in said
    assert said.endswith(
        "PSNR against IN in 12 images from all around: 100.0 dB or more: no difference\n"
    )
    assert len(PlyImporter().read(written).splats) == 18


def test_json_is_one_document(source, tmp_path, capsys):
    found = converted(capsys, source, "out.ply")
    assert found == {
        "source": str(source),
        "written": "out.ply",
        "format": "ply",
        "bytes_before": source.stat().st_size,
        "bytes": (tmp_path / "out.ply").stat().st_size,
        "num_gaussians": 18,
        "num_dropped": 1,
        "num_invisible": 1,
        "psnr": PSNR_MAX,
        "views": 12,
        "sh_degree": 2,
        "notes": [],
    }


def test_what_is_lost_is_seen_in_the_psnr(source, capsys):
    one = converted(capsys, source, "one.ply", "sh_degree=1")
    none = converted(capsys, source, "none.ply", "sh_degree=0")
    assert (one["sh_degree"], none["sh_degree"]) == (1, 0)
    assert none["psnr"] < one["psnr"] < 60
    assert none["bytes"] < one["bytes"]
    assert main(["convert", str(source), "none.ply", "sh_degree=0"]) == 0
    assert "view dependence (SH): degree 2 before, 0 now\n" in capsys.readouterr().out


def test_the_psnr_is_that_of_a_known_error():
    before = SplatFile(splats(60, 0))
    assert orbit_psnr.orbit_psnr(before, before) == PSNR_MAX
    colors = before.splats.colors
    darker = replace(colors, coefficients=colors.coefficients * 0 - 10)
    black = SplatFile(replace(before.splats, colors=darker))
    scene, cameras = orbit_psnr.surroundings("x", before)
    image = orbit_psnr._viewer(before, scene)
    squares = [image(camera.resized(48, 27)).double().square().mean() for camera in cameras[::2]]
    expected = -10 * torch.log10(sum(squares) / 12)
    assert orbit_psnr.orbit_psnr(before, black) == pytest.approx(float(expected), abs=1e-4)


def test_the_check_is_left_out_on_demand_and_for_many_splats(source, capsys, monkeypatch):
    assert converted(capsys, source, "out.ply", "check=false")["psnr"] is None
    monkeypatch.setattr(convert, "MOST", 10)
    assert main(["convert", str(source), "out.ply"]) == 0
    said = capsys.readouterr().out
    assert "not compared: images of 19 splats would take over a minute; check=true" in said
    assert converted(capsys, source, "out.ply", "check=true")["psnr"] == PSNR_MAX


def test_folders_motion_and_whole_models_are_written_too(source, tmp_path, capsys, plugin_path):
    (tmp_path / "formats_to_convert_to.py").write_text(PLUGIN)
    plugin_path(tmp_path / "formats_to_convert_to.py")
    assert converted(capsys, source, "www", "format=site")["psnr"] is None
    assert (tmp_path / "www" / "index").read_text() == "18"
    assert converted(capsys, source, "a.moving")["format"] == "moving"
    assert (tmp_path / "a.moving").read_text() == "18 True"
    assert converted(capsys, source, "a.gsfw")["format"] == "gsfw"
    assert converted(capsys, "a.gsfw", "again.ply")["num_gaussians"] == 18
    said = refusal(capsys, "a.gsfw", "b.moving", "time=0.5")
    assert said.startswith("format moving holds splats at all times: time and sh_degree are for")


@pytest.mark.slow
def test_a_run_is_converted_at_a_time(moving_run, capsys):
    first = converted(capsys, moving_run, "first.ply", "check=false")
    converted(capsys, moving_run, "later.ply", "time=1", "check=false")
    assert first["bytes_before"] is None
    means = [
        PlyImporter().read(path).splats.means for path in map(Path, ("first.ply", "later.ply"))
    ]
    assert not torch.equal(*means)


def test_a_moving_run_in_formats_of_all_times_has_its_counts_and_its_loss(moving_run, capsys):
    for out in ("a.html", "a.splatv"):
        found = converted(capsys, moving_run, out)
        assert (found["num_gaussians"], found["fit_psnr"] > 40) == (found["num_pieces"], True)
        assert main(["convert", str(moving_run), out]) == 0
        assert f" moving splats, {found['fit_psnr']:.1f} dB from" in capsys.readouterr().out
    count = converted(capsys, moving_run, "a.gsfw")["num_gaussians"]
    assert main(["convert", "a.gsfw", "b.gsfw"]) == 0
    assert f" with {count:,} Gaussians, of a.gsfw to b.gsfw, " in capsys.readouterr().out
    assert converted(capsys, "a.splatv", "b.html")["num_gaussians"] == found["num_gaussians"]


def test_a_name_of_another_format_is_refused(source, tmp_path, capsys):
    assert refusal(capsys, source, "z.ply", "format=spz") == (
        "z.ply: files that end in .ply have format ply, and format=spz is given.\n"
        "Leave format out, or give another name: z.spz\n"
    )
    assert refusal(capsys, source, "z.ply", "format=web").endswith("give a folder: z\n")
    assert refusal(capsys, source, "z.compressed.ply", "format=ply").endswith("name: z.ply\n")
    assert not list(tmp_path.glob("z*"))
    assert converted(capsys, source, "z.ply", "format=compressed-ply")["num_gaussians"] == 18
    assert converted(capsys, source, "z.bin", "format=ply")["num_gaussians"] == 18


def test_the_size_of_a_folder_counts_all_of_its_files(source, tmp_path, capsys):
    converted(capsys, source, "a.sog")
    with zipfile.ZipFile("a.sog") as archive:
        archive.extractall("a")
    (tmp_path / "a" / "notes.txt").write_text("not a part of it")
    whole = sum(path.stat().st_size for path in (tmp_path / "a").glob("[!n]*"))
    for given in ("a/meta.json", "a"):
        assert converted(capsys, given, "b.ply", "check=false")["bytes_before"] == whole
    assert main(["edit", "a/meta.json", "clean=all", "out=c.ply", "json=true"]) == 0
    assert json.loads(capsys.readouterr().out)["bytes_before"] == whole
    assert main(["info", "a/meta.json", "json=true"]) == 0
    assert json.loads(capsys.readouterr().out)["bytes"] == whole


def test_a_full_disk_leaves_nothing_and_the_advice_names_out(tmp_path, tiny_disk, capsys):
    PlyExporter().write(tmp_path / "large.ply", SplatFile(splats(50_000, degree=1)))
    for out, *form in (("site/new", "format=web"), ("new/a.ply",)):
        said = refusal(capsys, "large.ply", tiny_disk / out, *form)
        assert said.startswith("the disk is full: ")
        assert said.endswith("Free some space, or choose another place for OUT.\n")
        assert list(tiny_disk.iterdir()) == []


def test_a_folder_as_out_takes_the_name_of_the_input(source, tmp_path, capsys):
    (tmp_path / "there").mkdir()
    found = converted(capsys, source, "there", "format=ply", "check=false")
    assert found["written"] == "there/in.ply"
    found = converted(capsys, source, "new.ply/", "format=splat", "check=false")
    assert found["written"] == "new.ply/in.splat"
    assert "since it is a folder" in refusal(capsys, source, "new/")


@pytest.mark.parametrize("out", ["circle.ply", "circle.ply/a.ply"])
def test_a_link_to_itself_as_out_is_no_bug(source, tmp_path, capsys, out):
    (tmp_path / "circle.ply").symlink_to("circle.ply")
    if out == "circle.ply":
        assert converted(capsys, source, out, "check=false")["written"] == out
        assert not (tmp_path / out).is_symlink()
    else:
        assert "circle.ply/a.ply cannot be written" in refusal(capsys, source, out)


def test_an_input_is_never_overwritten(source, tmp_path, capsys):
    before = source.read_bytes()
    os.link(source, tmp_path / "other.ply")
    for out in (source, "in.ply", "./in.ply", "other.ply"):
        said = refusal(capsys, source, out)
        assert said.startswith(f"IN and OUT are the same: {source} would be overwritten by ")
    assert refusal(capsys, source, ".", "format=ply").endswith("Give OUT another name.\n")
    assert source.read_bytes() == before


def test_wrong_input_is_refused_with_cause_and_remedy(source, tmp_path, capsys):
    said = refusal(capsys, source, "out.plx")
    assert said.startswith(
        "out.plx: the format of OUT is not known, since no format ends in '.plx'.\n"
    )
    assert "Suffixes that can be written: " in said
    assert refusal(capsys, source, "out").startswith(
        "out: the format of OUT is not known, since it has no suffix"
    )
    assert refusal(capsys, source, tmp_path).startswith(
        f"{tmp_path}: the format of OUT is not known, since it is"
    )
    assert "is missing" in refusal(capsys, source)
    assert refusal(capsys, "inn.ply", "out.ply").startswith(
        "there is no run or splat file inn.ply. Did you mean 'in.ply'?\n"
    )
    assert "IN is the folder that gsfw train made" in refusal(capsys, "inn.ply", "out.ply")
    (tmp_path / "empty").mkdir()
    assert "empty is not a run" in refusal(capsys, "empty", "out.ply")
    (tmp_path / "notes.txt").write_text("nothing")
    assert "is not a splat file that can be read" in refusal(capsys, "notes.txt", "out.ply")
    assert refusal(capsys, source, "out.npz") == (
        "out.npz: format tracks cannot hold this model: there are no tracks to write.\n"
    )
    assert refusal(capsys, source, "notes.txt/out.ply").startswith("notes.txt/out.ply cannot be")
    assert "time=2: expected a number from 0 to 1." in refusal(capsys, source, "o.ply", "time=2")
    assert "expected a degree from 0 to 4" in refusal(capsys, source, "o.ply", "sh_degree=-1")
    assert refusal(capsys, source, "o.ksplat", "sh_degree=3").startswith(
        "sh_degree=3: format ksplat holds degree 2 at most.\n"
    )
    source.write_bytes(source.read_bytes()[:700])
    assert "in.ply" in refusal(capsys, "in.ply", "out.ply")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "in.ply", "notes.txt"]


def test_a_file_of_moving_splats_keeps_its_motion_where_the_other_format_holds_it(tmp_path, capsys):
    still = Motion.none(20)
    motion = replace(still, path=still.path + 0.25)
    moving = MotionFile(SplatFile(splats(degree=0)), motion, (0.0, 2.0), frames=3)
    SplatvExporter().write(tmp_path / "a.splatv", moving)
    assert main(["convert", "a.splatv", "b.splatv"]) == 0
    again = SplatvImporter().read_motion(tmp_path / "b.splatv")
    assert (again.time_range, again.frames) == ((0.0, 2.0), 3)
    assert float((again.motion.path - motion.path).abs().max()) == 0
    assert main(["convert", "a.splatv", "c.ply"]) == 0
    assert len(PlyImporter().read(tmp_path / "c.ply").splats) == 20
    before = SplatvImporter().read_motion(tmp_path / "a.splatv")
    for verb in (["convert", "a.splatv", "d.ply"], ["edit", "a.splatv", "out=e.ply"]):
        assert main([*verb, "time=0.5"]) == 0
    for name in ("d.ply", "e.ply"):
        found = PlyImporter().read(tmp_path / name).splats.means
        assert float((found - splats_at(before, 0.5).means).abs().max()) < 1e-5
    assert "holds splats at all times" in refusal(capsys, "a.splatv", "f.html", "time=0.5")
    assert main(["convert", "d.ply", "g.splatv", "time=0.5"]) == 0


def test_rows_of_a_moving_file_that_are_not_finite_are_counted(tmp_path, capsys):
    still = Motion.none(20)
    moving = MotionFile(
        SplatFile(splats(degree=0)), replace(still, path=still.path + 1), (0.0, 1.0)
    )
    SplatvExporter().write(tmp_path / "a.splatv", moving)
    raw = bytearray((tmp_path / "a.splatv").read_bytes())
    start = 8 + int.from_bytes(raw[4:8], "little")
    raw[start : start + 4] = b"\x00\x00\xc0\x7f"  # The first mean is NaN.
    (tmp_path / "a.splatv").write_bytes(raw)
    assert main(["convert", "a.splatv", "b.splatv"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("19 moving splats, of a.splatv to b.splatv, ")
    assert said.endswith("left out: 1 that are not finite\n")
    found = converted(capsys, "a.splatv", "b.splatv")
    assert (found["num_gaussians"], found["num_dropped"]) == (19, 1)


def test_motion_is_compared_unless_the_check_is_left_out(moving_run, capsys, monkeypatch):
    def never(*_):
        raise AssertionError

    monkeypatch.setattr(motion_quality, "motion_psnr", never)
    assert converted(capsys, moving_run, "a.splatv", "check=false")["fit_psnr"] is None
    assert main(["convert", str(moving_run), "a.splatv", "check=false"]) == 0
    said = capsys.readouterr().out
    assert f" moving splats, of {moving_run} to a.splatv, " in said
    assert " dB" not in said
    monkeypatch.setattr(convert, "MOST", 1)
    assert main(["convert", str(moving_run), "a.splatv"]) == 0
    assert capsys.readouterr().out.startswith("not compared: images of ")


def test_paths_of_a_run_are_counted(moving_run, capsys):
    found = converted(capsys, moving_run, "a.npz")
    assert main(["convert", str(moving_run), "a.npz"]) == 0
    count, times = found["num_gaussians"], found["num_times"]
    expected = f"paths of {count:,} Gaussians at {times} times, of {moving_run} to a.npz, "
    assert capsys.readouterr().out.startswith(expected)
    with np.load("a.npz") as archive:
        assert any(
            array.shape[:2] in ((times, count), (count, times)) for array in archive.values()
        )


@pytest.mark.slow
def test_a_mesh_is_made_of_a_file_of_splats(tmp_path, capsys):
    PlyExporter().write(tmp_path / "a.ply", SplatFile(splats(2000, degree=0)))
    assert main(["convert", "a.ply", "b.obj", "format=mesh", "format.resolution=48"]) == 0
    assert (tmp_path / "b.obj").read_text().count("\nf ") > 100
    said = capsys.readouterr().out
    assert said.startswith("a.ply to b.obj, ")
    assert said.endswith(": the surface that views show\n")
