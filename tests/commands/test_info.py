"""`gsfw info` says what a splat file, a run or a data set is."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from support.checked_captures import write_moving
from support.scenes import random_splats

from gsfw.commands.main import main
from gsfw.core.exchange import SplatFile
from gsfw.core.loop.run_folder import RunFolder
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.formats.ply import PlyExporter
from gsfw.plugins.registry import installed


@pytest.fixture
def splat_file(tmp_path):
    """Twenty splats of degree 1."""
    path = tmp_path / "a.ply"
    content = SplatFile(random_splats(20, 1, dtype=torch.float64), antialiased=True, up="z")
    PlyExporter().write(path, content)
    return path


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy that may be changed."""
    return shutil.copytree(finished_run, tmp_path / "run")


def document(capsys, *arguments):
    assert main(["info", *map(str, arguments), "json=true"]) == 0
    said = capsys.readouterr()
    assert "checkpoints" not in said.err
    return json.loads(said.out)


def refusal(capsys, *arguments):
    assert main(["info", *map(str, arguments)]) == 2
    return capsys.readouterr().err


def test_a_splat_file_is_described(splat_file, capsys):
    found = document(capsys, splat_file)
    given = random_splats(20, 1, dtype=torch.float64)
    assert (found["kind"], found["format"]) == ("splat file", "ply")
    assert (found["num_gaussians"], found["sh_degree"]) == (20, 1)
    assert (found["antialiased"], found["up"]) == (True, "z")
    assert found["bytes"] == splat_file.stat().st_size
    assert found["bytes_per_splat"] == round(found["bytes"] / 20, 1)
    assert found["extent"]["min"] == pytest.approx(given.means.amin(dim=0).tolist())
    assert found["opacity"]["max"] == pytest.approx(float(given.opacities.max()))
    assert found["scale"]["min"] == pytest.approx(float(given.scales.min()))
    assert found["longest_to_shortest_axis"]["min"] >= 1


def test_people_get_a_table(splat_file, capsys):
    assert main(["info", str(splat_file)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == f"{splat_file}: splat file"
    assert {"format ply", "num gaussians 20", "sh degree 1", "antialiased yes"} <= set(lines)
    assert any(line.startswith("extent min -0.") for line in lines)


def test_a_run_is_described(run, capsys):
    found = document(capsys, run)
    assert (found["kind"], found["method"], found["datamanager"]) == ("run", "3dgs", "synthetic")
    assert (found["steps"], found["steps_done"], found["finished"]) == (20, 20, True)
    summary = json.loads(RunFolder(run).summary.read_text())
    assert found["metrics"]["psnr"] == summary["psnr"]
    assert "protocol" not in found["metrics"]
    assert found["checkpoints"][-1]["step"] == 20
    assert found["made_by"]["command line"].startswith("gsfw train method=3dgs")
    assert "next" not in found


def test_people_get_a_run_as_its_settings_figures_and_files(run, capsys):
    assert main(["info", str(run)]) == 0
    said = capsys.readouterr().out
    lines = [" ".join(line.split()) for line in said.splitlines()]
    summary = json.loads(RunFolder(run).summary.read_text())
    assert lines[0] == f"{run}: run, finished after 20 steps"
    assert {"data - format synthetic", "method 3dgs"} <= set(lines)
    assert any(line.startswith(f"PSNR {summary['psnr']:.2f} dB mean of ") for line in lines)
    assert "the last after 20 steps" in said
    assert f"next gsfw view {run}" in lines
    assert not any(key in said for key in ("num_gaussians", "baselines"))
    RunFolder(run).summary.write_text(json.dumps(summary | {"ssim": None}))  # A metric that failed.
    assert main(["info", str(run)]) == 0
    assert "SSIM nan" in " ".join(capsys.readouterr().out.split())
    del summary["num_gaussians"]  # Of an early version.
    RunFolder(run).summary.write_text(json.dumps(summary))
    assert main(["info", str(run)]) == 0
    assert f"psnr {summary['psnr']:.6g}" in " ".join(capsys.readouterr().out.split())
    RunFolder(run).summary.unlink()
    assert main(["info", str(run)]) == 0
    assert f"next gsfw resume {run}" in " ".join(capsys.readouterr().out.split())


def test_a_run_that_was_stopped_says_how_to_go_on(run, capsys):
    RunFolder(run).summary.unlink()
    with RunFolder(run).metrics_log.open("a") as log:
        log.write('{"step": 20, "lo')  # A crash cut this line short.
    found = document(capsys, run)
    assert not found["finished"]
    assert found["next"] == f"gsfw resume {run}"
    assert found["metrics"]["step"] == 20
    assert found["metrics"]["num_gaussians"] > 0
    for file in RunFolder(run).checkpoints.iterdir():
        file.unlink()
    RunFolder(run).metrics_log.unlink()
    found = document(capsys, run)
    assert (found["steps_done"], found["checkpoints"], found["metrics"]) == (0, [], {})


def test_a_model_without_the_rest_of_its_state_is_no_checkpoint_of_its_run(run, capsys):
    model = RunFolder(run).checkpoints / "model_000000020.pt"
    for path in (model, model.with_name("a_copy.pt")):
        path.touch()
    found = document(capsys, run)
    assert found["models_alone"] == [str(model)]
    assert all(Path(item["path"]).name.startswith("step_") for item in found["checkpoints"])
    assert main(["info", str(run)]) == 0
    assert f"model alone {model}" in " ".join(capsys.readouterr().out.split())


def test_a_checkpoint_stands_for_its_run(run, capsys):
    assert document(capsys, RunFolder(run).latest_checkpoint())["path"] == str(run)


def test_the_built_in_scene_is_described(capsys):
    found = document(capsys, "format=synthetic", "downscale=4")
    scene = SyntheticConfig()
    count, width, height = scene.views + scene.eval_views, scene.width // 4, scene.height // 4
    assert (found["views_train"], found["views_eval"]) == (scene.views, scene.eval_views)
    assert found["image_sizes"] == [f"{width}x{height} ({count})"]
    assert found["camera_models"] == [f"pinhole ({count})"]
    assert (found["alpha"], found["times"], found["time_range"]) == (True, 0, None)
    assert found["decoded_mb"] == pytest.approx(count * width * height * 4 / 1e6, abs=0.05)
    assert found["decoded_fits_cache"]
    assert found["next"] == "gsfw train method=3dgs datamanager=synthetic downscale=4"


@pytest.mark.parametrize(("cameras", "method"), [(1, "4dgs"), (4, "spacetime")])
def test_the_next_command_has_a_method_that_takes_times(cameras, method, tmp_path, capsys):
    path = write_moving(tmp_path / "moving", [0.0, 0.25, 0.5, 0.75, 1.0], cameras)
    assert document(capsys, f"data={path}")["next"] == f"gsfw train method={method} data={path}"


def test_a_data_set_is_described_with_why_its_format_was_chosen(shared_data, capsys):
    path = shared_data / "captures" / "fox"
    found = document(capsys, f"data={path}")
    assert (found["kind"], found["format"]) == ("data set", "colmap")
    assert found["why"].startswith("found sparse/0")
    assert (found["views_train"], found["views_eval"], found["points"]) == (43, 7, 12169)
    assert found["image_sizes"] == ["718x1280 (50)"]
    assert found["next"] == f"gsfw train method=3dgs data={path}"
    assert found == document(capsys, path) | {"path": str(path)}


def test_nothing_and_two_things_are_refused(splat_file, capsys):
    assert refusal(capsys) == (
        "error: gsfw info: the file, run or data set is missing.\n"
        "Give a splat file, a run, latest, or a data set; see gsfw info --help.\n"
    )
    assert "both" in refusal(capsys, splat_file, "data=somewhere")


def test_what_is_not_there_is_refused(tmp_path, capsys):
    said = refusal(capsys, tmp_path / "nothing")
    assert said.startswith(f"error: data={tmp_path}/nothing: there is no such file or folder.")


def test_a_file_of_no_known_kind_names_those_that_are(tmp_path, capsys):
    path = tmp_path / "notes.txt"
    path.write_text("hello")
    said = refusal(capsys, path)
    assert said.startswith(
        f"error: {path} is neither a splat file nor a data set that can be read here.\n"
        f"Splat files: {', '.join(installed().slot('importer'))}. Data sets: "
    )


def test_a_damaged_splat_file_and_a_wrong_factor_are_refused(tmp_path, capsys):
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nnothing")
    assert "is a damaged PLY: its header does not end." in refusal(capsys, path)
    assert "downscale=0.5: expected a finite number of at least 1." in refusal(
        capsys, "format=synthetic", "downscale=0.5"
    )
