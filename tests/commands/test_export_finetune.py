"""`gsfw export RUN finetune=N` trains a run on for the rounding of its file."""

import json

import pytest

from gsfw.commands.main import main
from gsfw.formats.model_file import read_model_file
from gsfw.plugins import fine_tuning

COMPRESSED = ("format=gsfw", "format.precision=compressed", "format.step=6")


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("words", [(), ("format=gsfw",), ("format=spz",)])
def test_only_compressed_model_files_are_fine_tuned_for(finished_run, words, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["export", str(finished_run), *words, "finetune=3", f"out={out}"]) == 2
    assert "Add format=gsfw format.precision=compressed" in capsys.readouterr().err
    assert not out.exists()


def test_model_files_and_negative_numbers_are_refused(finished_run, tmp_path, capsys):
    model = tmp_path / "model.gsfw"
    assert main(["export", str(finished_run), *COMPRESSED, f"out={model}"]) == 0
    assert main(["export", str(model), *COMPRESSED, "finetune=3"]) == 2
    assert "Give the folder of the run that it was exported from." in capsys.readouterr().err
    assert main(["export", str(finished_run), *COMPRESSED, "finetune=-1"]) == 2
    assert "finetune=-1: expected a number of at least 0." in capsys.readouterr().err


def test_nothing_is_written_when_it_is_interrupted(finished_run, tmp_path, monkeypatch):
    def interrupted(self, step, control):
        raise KeyboardInterrupt

    monkeypatch.setattr(fine_tuning._Progress, "on_tick", interrupted)
    before, out = contents(finished_run), tmp_path / "out.gsfw"
    assert main(["export", str(finished_run), *COMPRESSED, "finetune=3", f"out={out}"]) == 130
    assert list(tmp_path.iterdir()) == []
    assert contents(finished_run) == before


@pytest.mark.slow
def test_a_fine_tuned_file_is_nearer_to_the_photos_and_the_run_stays_as_it_is(
    trained, tmp_path, capsys
):
    run = trained(
        "method=3dgs", "steps=150", "datamanager.views=12", "datamanager.eval_views=3",
        "datamanager.width=48", "datamanager.height=36", "datamanager.points=500",
    )  # fmt: skip
    before, out = contents(run), tmp_path / "out.gsfw"
    capsys.readouterr()
    words = [*COMPRESSED, "finetune=100", f"out={out}", "json=true"]
    assert main(["export", str(run), *words]) == 0
    psnr = json.loads(capsys.readouterr().out)["psnr"]
    assert psnr["rounded"] < psnr["usual"] - 0.2
    assert psnr["fine_tuned"] > psnr["rounded"] + 0.2
    assert contents(run) == before
    assert read_model_file(out).step == 250


@pytest.mark.slow
def test_moving_models_are_fine_tuned_unless_their_times_are_over(trained, tmp_path, capsys):
    scene = (
        "datamanager.moving=true", "datamanager.times=3", "datamanager.views=6",
        "datamanager.eval_views=2", "datamanager.width=32", "datamanager.height=24",
        "datamanager.points=150", "steps=30",
    )  # fmt: skip
    words = [*COMPRESSED, "finetune=5", "json=true"]
    for method in ("4d-rotor", "4dgs"):
        run = trained(f"method={method}", *scene)
        capsys.readouterr()
        assert main(["export", str(run), *words, f"out={tmp_path / method}.gsfw"]) == 0
        assert json.loads(capsys.readouterr().out)["psnr"]["fine_tuned"] > 5
    run = trained("method=dynamic3dgs", *scene)
    assert main(["export", str(run), *words, f"out={tmp_path / 'late.gsfw'}"]) == 2
    assert "trains one time after another" in capsys.readouterr().err
    assert not (tmp_path / "late.gsfw").exists()
