"""`gsfw export` writes a run's splats in the world of the data."""

import json
import re
import shutil
from dataclasses import replace

import pytest
import torch

from gsfw.commands.interface.exported_splats import splat_notes
from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.exchange import SplatFile
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.splats import Sh, Splats
from gsfw.formats.ply import PlyImporter
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.plugins.exporters import writable_suffixes
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy that may be changed, without the file that training leaves."""
    copy = shutil.copytree(finished_run, tmp_path / "run")
    RunFolder(copy).splats.unlink(missing_ok=True)
    return copy


def some_splats(n=4):
    return Splats(
        means=torch.rand(n, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64),
        opacities=torch.full((n,), 0.5, dtype=torch.float64),
        colors=Sh(torch.zeros(n, 4, 3, dtype=torch.float64), 1),
        quats=torch.ones(n, 4, dtype=torch.float64),
        scales=torch.full((n, 3), 0.01, dtype=torch.float64),
    )


def test_export_writes_the_file_into_the_run_and_says_what_is_in_it(run, capsys):
    assert main(["export", str(run)]) == 0
    said = capsys.readouterr().out
    path = RunFolder(run).splats
    count = len(PlyImporter().read(path).splats)
    assert said.startswith(f"{count:,} splats after 20 steps, ")
    assert said.endswith(f": {path}\n")


def test_a_format_that_rounds_says_how_near_its_images_are(run, tmp_path, capsys, monkeypatch):
    out = tmp_path / "small.splat"
    assert main(["export", str(run), f"out={out}"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "view dependence (SH): degree 3 before, 0 now"
    found = re.fullmatch(r"PSNR against the model in 12 images from all around: (.*) dB", lines[2])
    assert main(["convert", str(run), str(tmp_path / "again.splat"), "json=true"]) == 0
    same = json.loads(capsys.readouterr().out)["psnr"]
    assert float(found[1]) == pytest.approx(same, abs=0.06)
    assert 20 < same < 60
    monkeypatch.setattr("gsfw.commands.export.MOST_COMPARED", 3)
    assert main(["export", str(run), f"out={out}", "json=true"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["psnr"] is None
    again = f"gsfw convert {run} FILE format=splat check=true"
    assert f"may round values; {again} writes another file and compares it\n" in said.err
    assert main(again.replace("FILE", str(tmp_path / "b.splat")).split()[1:]) == 0


NOTE = "the splats of this model depend on the view: a file of splats has those without a view"


@pytest.mark.parametrize("words", [["export"], ["convert"], ["edit", "scale=2"]])
def test_a_file_of_splats_that_depend_on_the_view_is_warned_of(
    run, tmp_path, capsys, monkeypatch, words
):
    verb, *steps = words
    out = tmp_path / "scene.ply"
    place = [str(out)] if verb == "convert" else [f"out={out}"]
    plain = StaticGaussians.splats
    for depends in (True, False):
        monkeypatch.setattr(StaticGaussians, "depends_on_view", depends)
        monkeypatch.setattr(StaticGaussians, "splats", _fainter_in_views if depends else plain)
        assert main([verb, str(run), *place, *steps]) == 0
        assert (NOTE in capsys.readouterr().err) == depends


PLAIN_SPLATS = StaticGaussians.splats


def _fainter_in_views(self, time=None, cameras=None):
    splats = PLAIN_SPLATS(self, time, cameras)
    return splats if cameras is None else replace(splats, opacities=splats.opacities * 0.5)


def _fewer_in_views(self, time=None, cameras=None):
    splats = PLAIN_SPLATS(self, time, cameras)
    return splats if cameras is None else splats.take(torch.arange(len(splats) // 2))


def test_keep_is_refused_where_the_splats_of_a_view_do_not_name_their_rows(
    run, capsys, monkeypatch
):
    monkeypatch.setattr(StaticGaussians, "depends_on_view", True)
    monkeypatch.setattr(StaticGaussians, "splats", _fewer_in_views)
    assert main(["export", str(run), "keep=0.5"]) == 2
    said = capsys.readouterr().err
    assert "error: keep=0.5: the splats of this model do not name their rows.\n" in said


def test_a_cut_of_levels_of_detail_is_not_warned_of(run, tmp_path, capsys):
    words = ["export", str(run), "format=html", "budget=50", f"out={tmp_path / 'page.html'}"]
    assert main(words) == 0
    assert NOTE not in capsys.readouterr().err


def test_json_is_one_document(run, tmp_path, capsys):
    out = tmp_path / "elsewhere" / "scene.ply"
    assert main(["export", str(run), "format=ply", f"out={out}", "step=20", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["written"] == str(out)
    assert document["bytes"] == out.stat().st_size
    assert (document["step"], document["num_dropped"], document["notes"]) == (20, 0, [])
    assert document["num_gaussians"] == len(PlyImporter().read(out).splats)


def test_an_exported_run_draws_the_same_held_out_pictures_in_the_world_of_the_data(run):
    assert main(["export", str(run)]) == 0
    content = PlyImporter().read(RunFolder(run).splats)
    restored = restore(RunFolder(run), installed())
    parts, world = restored.composition.parts, restored.composition.scene.world_from_scene
    settings = restored.composition.plan.settings
    assert content.up == "z"
    camera = parts.data.views(Split.EVAL).cameras[0]
    before = render_model(parts.model, parts.rasterizer, camera, settings).color
    moved = replace(
        camera.to(dtype=torch.float64), world_to_camera=world.camera(camera.world_to_camera)
    )
    exact = replace(settings, background=settings.background.double())
    splats = content.splats.map(torch.Tensor.double)
    after = parts.rasterizer.render(splats, moved, exact).color
    assert float(before.std()) > 0.05
    assert float((before - after).abs().max()) < 1e-4


def test_a_checkpoint_and_a_folder_are_named_after_the_step(run, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    checkpoint = RunFolder(run).latest_checkpoint()
    assert main(["export", str(checkpoint), f"out={tmp_path / 'out'}"]) == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["splats_000000020.ply"]


def test_a_slash_at_the_end_of_out_makes_a_folder(run, tmp_path):
    assert main(["export", str(run), "format=splat", f"out={tmp_path / 'v1.5'}/"]) == 0
    assert [path.name for path in (tmp_path / "v1.5").iterdir()] == ["splats.splat"]


def test_a_step_without_a_checkpoint_lists_those_there_are(run, capsys):
    assert main(["export", str(run), "step=7"]) == 2
    steps = sorted(int(p.stem[5:]) for p in RunFolder(run).checkpoints.iterdir())
    assert capsys.readouterr().err == (
        f"error: {run} has no checkpoint after 7 steps.\n"
        f"There are checkpoints after {', '.join(map(str, steps))} steps.\n"
    )


def test_an_unknown_format_names_those_there_are(run, capsys):
    assert main(["export", str(run), "format=plx"]) == 2
    names = ", ".join(sorted(installed().slot("exporter")))
    assert (
        capsys.readouterr().err
        == f"error: no exporter 'plx'. Did you mean 'ply'?\nInstalled: {names}.\n"
    )
    assert not RunFolder(run).splats.exists()


@pytest.mark.parametrize("name", ["m.gsfw", "M.PLY"])
def test_the_suffix_of_the_file_chooses_the_format_as_in_model_save(run, tmp_path, name):
    out = tmp_path / name
    assert main(["export", str(run), f"out={out}"]) == 0
    assert out.read_bytes().startswith(b"ply\n") == name.endswith("PLY")


def test_a_suffix_that_nothing_writes_is_refused_unless_the_format_is_given(run, tmp_path, capsys):
    out = tmp_path / "splats.xyz"
    assert main(["export", str(run), f"out={out}"]) == 2
    assert capsys.readouterr().err == (
        f"error: out={out}: no exporter writes files that end in '.xyz'.\n"
        f"Suffixes that can be written: {writable_suffixes(installed())}. Or give the format: "
        "format=ply\n"
    )
    assert not out.exists()
    assert main(["export", str(run), f"out={out}", "format=ply"]) == 0
    assert out.read_bytes().startswith(b"ply\n")


def test_a_time_out_of_range_is_refused(run, capsys):
    assert main(["export", str(run), "time=2"]) == 2
    assert "time=2: expected a number from 0 to 1." in capsys.readouterr().err


def test_a_place_that_cannot_be_written_to_is_one_message(run, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["export", str(run), f"out={tmp_path / 'file' / 'a.ply'}"]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_splats_that_are_not_finite_are_noted():
    taken = SplatFile(some_splats(), num_dropped=3)
    assert splat_notes(taken) == ["3 splats were left out: they are not finite."]
    assert splat_notes(SplatFile(some_splats(0))) == []


def test_coordinates_too_far_from_the_origin_for_float32_are_noted():
    splats = some_splats()
    far = replace(splats, means=splats.means + 5e6)
    assert splat_notes(SplatFile(far)) == [
        "coordinates reach 5e+06, where float32 numbers are 0.5 apart, and the median splat is "
        "0.01 in size: the file looks coarser than the model. Move the data set nearer to its "
        "origin."
    ]


def test_a_sequence_of_a_static_run_is_refused_with_advice(run, capsys):
    for times in ("5", "all"):
        assert main(["export", str(run), f"times={times}"]) == 2
        assert capsys.readouterr().err == (
            f"error: times={times}: synthetic has no times, so all files would be the same.\n"
            "Leave times out for one file.\n"
        )
    assert main(["export", str(run), "times=1"]) == 0
    assert [path.name for path in sorted((run / "splats").iterdir())] == [
        "splats_0000.ply", "times.json",
    ]  # fmt: skip


def test_a_degree_for_a_format_of_all_times_is_refused_once(run, capsys):
    refusals = set()
    for degree in (0, 1):
        assert main(["export", str(run), "format=splatv", f"sh_degree={degree}"]) == 2
        refusals.add(capsys.readouterr().err)
    (said,) = refusals
    assert said.startswith("error: format=splatv: keep and sh_degree cut down one set of splats.")


@pytest.mark.parametrize("times", ["0", "-2", "many", "2.5", "٣"])
def test_times_are_a_number_of_files_or_all(run, capsys, times):
    assert main(["export", str(run), f"times={times}"]) == 2
    assert capsys.readouterr().err == (
        f"error: times={times}: expected a whole number of at least 1, or all.\n"
    )


def test_one_time_and_many_contradict_each_other(run, capsys):
    assert main(["export", str(run), "times=3", "time=0.5"]) == 2
    assert capsys.readouterr().err == (
        "error: time=0.5 and times=3 are both given.\n"
        "Give time for one file, or times for a sequence.\n"
    )
