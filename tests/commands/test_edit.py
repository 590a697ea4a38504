"""`gsfw edit` applies steps to splats and models, in order, and writes another file."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from support.made_once import MadeOnce
from support.moving_runs import train
from support.scenes import random_splats

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.exchange import SplatFile
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.plugins.registry import installed


@pytest.fixture
def ply(tmp_path):
    """Forty splats of degree 1 in the unit ball, and one far away."""
    splats = random_splats(41, 1, dtype=torch.float64)
    means = splats.means.clone()
    means[7] = torch.tensor([50.0, 0, 0])
    path = tmp_path / "in.ply"
    PlyExporter().write(path, SplatFile(replace(splats, means=means), up="-y"))
    return path


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy that may be changed."""
    return shutil.copytree(finished_run, tmp_path / "run")


def document(capsys, *arguments):
    assert main(["edit", *map(str, arguments), "json=true"]) == 0
    return json.loads(capsys.readouterr().out)


def refusal(capsys, *arguments):
    assert main(["edit", *map(str, arguments)]) == 2
    return capsys.readouterr().err


def read(path):
    return PlyImporter().read(Path(path)).splats


def test_each_step_is_counted_and_the_sizes_are_said(ply, tmp_path, capsys):
    before, out = ply.read_bytes(), tmp_path / "out.ply"
    steps = ["crop.sphere=0,0,0,20", "rotate=x,90", "sh_degree=0"]
    assert main(["edit", str(ply), *steps, f"out={out}"]) == 0
    assert capsys.readouterr().out == (
        "crop.sphere: 41 -> 40 Gaussians\n"
        "rotate: 40 Gaussians\n"
        "sh_degree: 40 Gaussians (SH degree 1 -> 0)\n"
        f"40 Gaussians, 5 kB -> 3 kB: {out}\n"
        f"the steps, to repeat them: edits={out}.edits.json\n"
    )
    assert ply.read_bytes() == before
    assert len(read(out)) == 40
    assert PlyImporter().read(out).up == "-z"


def test_steps_are_applied_in_the_order_of_the_command_line(ply, tmp_path, capsys):
    far, back = "crop.sphere=50,0,0,1", "move=-50,0,0"
    found = document(capsys, ply, far, back)
    assert found["num_gaussians"] == 1
    assert float(read(found["written"]).means.abs().max()) == 0
    assert "leaves none of the 41" in refusal(capsys, ply, back, far)


def test_the_steps_of_an_edit_can_be_repeated_among_others(ply, tmp_path, capsys):
    first = document(capsys, ply, "crop.sphere=0,0,0,20", "move=0,0,5", f"out={tmp_path / 'a.ply'}")
    assert first["edits"] == f"{tmp_path / 'a.ply'}.edits.json"
    again = document(capsys, ply, f"edits={first['edits']}", "scale=2", f"out={tmp_path / 'b.ply'}")
    assert [step["edit"] for step in again["steps"]] == ["crop.sphere", "move", "scale"]
    assert torch.allclose(read(again["written"]).means, 2 * read(first["written"]).means)


def test_a_dry_run_counts_and_writes_nothing(ply, tmp_path, capsys):
    found = document(capsys, ply, "crop.sphere=0,0,0,20", "--dry-run")
    assert (found["num_gaussians"], found["written"]) == (40, None)
    assert [path.name for path in tmp_path.iterdir()] == ["in.ply"]


def test_the_input_is_never_written_to(ply, tmp_path, capsys):
    said = refusal(capsys, ply, "scale=2", f"out={ply}")
    assert "is the input, which is never changed" in said
    assert "is a folder" in refusal(capsys, ply, "scale=2", f"out={tmp_path}")
    assert "new is a folder" in refusal(capsys, ply, "scale=2", "format=ply", "out=new/")
    assert "nothing writes splats or models" in refusal(capsys, ply, f"out={tmp_path / 'a.xyz'}")
    assert "there is nothing to do" in refusal(capsys, ply)
    assert "over_time=all" in refusal(capsys, ply, "over_time=all", f"out={tmp_path / 'a.ply'}")
    assert "crop.sphere=0,0,9,1 leaves none" in refusal(capsys, ply, "crop.sphere=0,0,9,1")
    assert "is a file of splats, and has no steps" in refusal(capsys, ply, "scale=2", "step=1")
    for key, remedy in (
        ("merge", "Give the path of a file of splats"),
        ("edits", "Give the path of an .edits"),
    ):
        said = refusal(capsys, ply, f"{key}=no.ply")
        assert said.startswith(f"error: {key}=no.ply: there is no such file.\n{remedy}")
    out = f"out={tmp_path / 'a.ksplat'}"
    assert "format ksplat holds degree 2 at most" in refusal(capsys, ply, "sh_degree=3", out)
    assert "ply have format ply" in refusal(capsys, ply, "format=spz", f"out={tmp_path / 'a.ply'}")
    assert "FILE is the folder that" in refusal(capsys, tmp_path / "no.ply", "scale=2")
    assert [path.name for path in tmp_path.iterdir()] == ["in.ply"]


def test_files_are_merged_at_the_higher_degree(ply, tmp_path, capsys):
    other = tmp_path / "other.ply"
    PlyExporter().write(other, SplatFile(random_splats(9, 2, dtype=torch.float64)))
    merged = read(document(capsys, ply, f"merge={other}")["written"])
    assert (len(merged), merged.colors.degree) == (50, 2)
    assert torch.equal(merged.means[:41], read(ply).means)
    assert float(merged.colors.coefficients[:41, 4:].abs().max()) == 0


def test_a_run_is_edited_with_its_own_cameras_and_stays_as_it_is(run, capsys):
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    tilted = document(capsys, run, "rotate=1,2,0,25", "align=cameras,z", "--dry-run")
    assert tilted["steps"][1]["note"].endswith("; turned by 25.0 degrees to z")
    steps = ["align=cameras,-y", "crop.views=3", "prune.views=1", "prune.contribution=0.1"]
    found = document(capsys, run, *steps, "decimate.count=60")
    assert found["written"] == str(run / "edited.ply")
    assert found["num_gaussians"] == 60
    assert PlyImporter().read(run / "edited.ply").up == "-y"
    assert "time=0.5" in refusal(capsys, run, "time=0.5", f"out={run / 'a.gsfw'}")
    assert "is the run's own file" in refusal(capsys, run, "scale=2", f"out={run / 'splats.ply'}")
    assert all(path.read_bytes() == content for path, content in before.items())


@pytest.mark.slow
def test_a_file_is_edited_with_the_cameras_of_a_run(run, tmp_path, capsys):
    own = document(capsys, run, "prune.views=4")
    assert main(["export", str(run), f"out={tmp_path / 'a.ply'}"]) == 0
    capsys.readouterr()
    with_views = document(capsys, tmp_path / "a.ply", "prune.views=4", f"views={run}")
    assert with_views["num_gaussians"] == own["num_gaussians"]
    assert "holds splats, and no cameras" in refusal(capsys, tmp_path / "a.ply", "prune.views=4")


def opened(path):
    return restore_run(find_run(str(path), print), installed())


def images(path, time=None):
    restored = opened(path)
    parts, settings = restored.composition.parts, restored.composition.plan.settings
    camera = parts.data.views(Split.EVAL).cameras[0]
    moment = None if time is None else torch.tensor(time)
    return render_model(parts.model, parts.rasterizer, camera, settings, moment).color


def test_a_model_file_keeps_its_images_in_another_world_and_its_rows_are_left_out(run, capsys):
    out = run / "turned.gsfw"
    assert main(["edit", str(run), "rotate=x,50", "scale=2", f"out={out}"]) == 0
    assert torch.equal(images(run), images(out))
    before, after = (opened(path).composition.scene.world_from_scene for path in (run, out))
    assert after.scale == pytest.approx(2 * before.scale)
    capsys.readouterr()
    found = document(capsys, out, "prune.contribution=0.5", "sh_degree=1", "color.brightness=0.5")
    assert found["written"] == str(run / "turned.edited.gsfw")
    small = opened(found["written"]).composition.parts.model
    assert small.num_rows == found["num_gaussians"]
    assert small.sh_rest.values.shape[1] == 3
    assert found["bytes"] < 0.4 * found["bytes_before"]


def test_formats_and_their_options_are_those_of_export(ply, tmp_path, capsys):
    steps = [ply, "crop.sphere=0,0,0,20"]
    page = document(capsys, *steps, f"out={tmp_path / 'a.html'}")
    assert (page["format"], page["num_gaussians"]) == ("html", 40)
    assert Path(page["written"]).read_bytes().startswith(b"<!")
    plain = document(capsys, *steps, f"out={tmp_path / 'a.gsfw'}")
    small = document(capsys, *steps, f"out={tmp_path / 'b.gsfw'}", "format.precision=compressed")
    assert small["bytes"] < plain["bytes"]
    beside = document(capsys, *steps, "format=splat")
    assert beside["written"] == str(tmp_path / "in.edited.splat")
    assert "format.version=9" in refusal(capsys, *steps, "format=spz", "format.version=9")
    assert "format ply has no option 'step'" in refusal(capsys, *steps, "format.step=2")


@pytest.mark.parametrize("name", ["a.mesh.ply", "a.npz"])
def test_formats_that_only_a_run_fills_are_refused_by_name(name, ply, tmp_path, capsys):
    said = refusal(capsys, ply, "scale=2", f"out={tmp_path / name}")
    assert "an edit writes splats or models" in said
    assert "format web is a folder" in refusal(capsys, ply, "scale=2", "format=web")
    assert [path.name for path in tmp_path.iterdir()] == ["in.ply"]


def test_splats_become_a_model_file(ply, tmp_path, capsys):
    steps = ["crop.sphere=0,0,0,20", f"merge={ply}", "move=0,1,0", "sh_degree=0"]
    found = document(capsys, ply, *steps, f"out={tmp_path / 'a.gsfw'}")
    restored = opened(found["written"])
    assert found["num_gaussians"] == restored.composition.parts.model.num_rows == 81
    world = restored.composition.scene.world_from_scene
    means = world.apply(restored.composition.parts.model.splats().means)
    expected = read(ply).means[:7] + torch.tensor([0.0, 1, 0])
    assert torch.allclose(means[:7], expected, atol=1e-4)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a.gsfw", "a.gsfw.edits.json", "in.ply",
    ]  # fmt: skip


def test_splats_beyond_float32_become_no_model_file(ply, tmp_path, capsys):
    out = tmp_path / "a.gsfw"
    expected = (
        f"error: {out}: format gsfw cannot hold this: 41 splats have values beyond float32.\n"
        "clean=all leaves out what no format can hold.\n"
    )
    for steps in (["scale=1e300"], ["scale=1e300", "decimate.mb=0.001"]):
        assert refusal(capsys, ply, *steps, f"out={out}") == expected
    one = "cannot hold this: 1 splat has values beyond float32."
    assert one in refusal(capsys, ply, "scale=1e37", f"out={out}")
    assert [path.name for path in tmp_path.iterdir()] == ["in.ply"]


def test_views_that_are_no_run_are_refused_with_the_option_that_named_them(ply, tmp_path, capsys):
    said = refusal(capsys, ply, "views=nowhere", "crop.views=2", f"out={tmp_path / 'a.ply'}")
    assert said.startswith(
        "error: there is no run nowhere.\nviews=RUN: the folder that gsfw train made, a checkpoint "
    )


@pytest.mark.slow
def test_the_floor_of_the_tilted_built_in_scene_makes_it_level(trained, tmp_path, capsys):
    run = trained(
        "method=3dgs", "device=cpu", "datamanager.views=16", "datamanager.width=80",
        "datamanager.height=60", "datamanager.points=1000", "steps=250", "report=false",
    )  # fmt: skip
    capsys.readouterr()
    out = tmp_path / "a.ply"
    found = document(capsys, run, "rotate=1,2,0,25", "align=floor,z", "floor=0", f"out={out}")
    note = found["steps"][1]["note"]
    degrees = float(note.partition("turned by ")[2].partition(" degrees")[0])
    assert degrees == pytest.approx(25, abs=1)
    # The table is level at height 0: its centres are now around it.
    heights = read(out).means[:, 2]
    assert float((heights.abs() < 0.05).double().mean()) > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["spacetime", "4d-rotor", "4dgs", "dynamic3dgs"])
def test_every_moving_method_is_edited_at_all_times(method, made_once: MadeOnce, tmp_path, capsys):
    run = made_once(lambda out: train(out, f"method={method}", "steps=12"), f"edit-{method}")
    capsys.readouterr()
    out = tmp_path / "m.gsfw"
    found = document(capsys, run, "rotate=y,30", "crop.sphere=0,0,0,100", f"out={out}")
    assert found["num_gaussians"] == opened(run).composition.parts.model.num_rows
    for time in (0.0, 0.6):
        assert torch.equal(images(run, time), images(out, time))
    steps = ["prune.contribution=0.4", "sh_degree=1", "prune.opacity=0.01"]
    found = document(capsys, out, *steps, f"out={tmp_path / 'small.gsfw'}")
    model = opened(found["written"]).composition.parts.model
    assert model.num_rows == found["num_gaussians"]
    assert images(found["written"], 0.6).isfinite().all()
    splats = document(capsys, out, "time=0.5", f"out={tmp_path / 'at.ply'}")
    assert splats["num_gaussians"] > 0
    assert RunFolder(run).config.is_file()
