"""`gsfw tradeoff RUN` measures what a finished model can give up, and recommends a command."""

import csv
import json
import shlex
import shutil
import sys

import pytest
from support.moving_runs import train as train_moving

from gsfw.commands.main import main
from gsfw.commands.tradeoff.model import AxisName
from gsfw.core.loop.run_folder import RunFolder
from gsfw.studies.tradeoff.runner import Runner
from gsfw.studies.tradeoff.variant import AXES

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

FIGURES = {
    "axis": str,
    "name": str,
    "psnr": float,
    "ssim": float,
    "color_corrected_psnr": float,
    "flip": float,
    "psnr_lost": float,
    "psnr_lost_error": float,
    "is_tie": bool,
    "relative_l2": float,
    "max_error": float,
    "num_gaussians": int,
    "floats": int,
    "bytes": int,
    "parameter_bytes": int,
    "file": str,
    "render_ms": float,
    "render_ms_spread": float,
    "render_ms_least": float,
    "render_ms_is_own": bool,
    "on_front": list,
    "command": str,
    "failure": str,
}
"""Of each variant in the document, and their types; file_bytes and
peak_memory_mb may be null."""


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy that may be changed."""
    return shutil.copytree(finished_run, tmp_path / "run")


def measured(capsys, *words):
    """The document of a run of the verb."""
    assert main(["tradeoff", *map(str, words), "json=true"]) == 0
    return json.loads(capsys.readouterr().out)


def test_axes_are_those_that_can_be_measured():
    assert AxisName.__args__ == AXES


def test_the_document_has_every_variant_and_the_files_lie_in_the_run(run, capsys):
    document = measured(capsys, run, "repeats=2", "axes=sh,precision,format,cutoffs")
    assert document["views"] == ["eval_000", "eval_001"]
    assert document["against"] == "photos"
    assert document["left_out"] == {}
    variants = document["variants"]
    formats = [variant["name"] for variant in variants if variant["axis"] == "format"]
    assert {"ply", "gsfw", "gsfw precision=float16"} <= {*formats}
    assert len(variants) == 1 + 3 + 2 + len(formats) + 3
    for variant in variants:
        assert variant.keys() == {*FIGURES, "file_bytes", "peak_memory_mb"}
        for name, kind in FIGURES.items():
            assert type(variant[name]) is kind, (variant["name"], name)
    folder = run / "tradeoff"
    kept = json.loads((folder / "tradeoff.json").read_text())
    assert kept["schema"] == 1
    assert kept["variants"] == variants
    with (folder / "tradeoff.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)] == [v["name"] for v in variants]
    assert (folder / "tradeoff.png").read_bytes().startswith(b"\x89PNG")


def test_without_its_package_flip_is_left_out_and_measured_when_it_is_there(
    run, capsys, monkeypatch
):
    why = "flip-evaluator is not installed; pip install 'gsfw[flip]'"
    with monkeypatch.context() as absent:
        absent.setitem(sys.modules, "flip_evaluator", None)
        document = measured(capsys, run, "repeats=1", "axes=antialias")
        assert document["left_out"] == {"flip": why}
        assert [variant["flip"] for variant in document["variants"]] == [None, None]
        assert main(["tradeoff", str(run), "repeats=1", "axes=antialias"]) == 0
        assert f"flip is left out: {why}\n" in capsys.readouterr().out
    again = measured(capsys, run, "repeats=1", "axes=antialias")
    assert again["left_out"] == {}
    assert all(0 < variant["flip"] < 1 for variant in again["variants"])
    for before, after in zip(document["variants"], again["variants"], strict=True):
        assert after == {**before, "flip": after["flip"]}, "nothing else is measured again"


def test_the_recommended_command_meets_the_budget_when_it_is_run(run, tmp_path, capsys):
    document = measured(capsys, run, "repeats=1", "axes=sh,prune", "budget.mb=0.02")
    words = shlex.split(document["recommended"]["command"])
    assert words[:3] == ["gsfw", "export", str(run)]
    out = tmp_path / "small.ply"
    assert main([*words[1:], f"out={out}"]) == 0
    assert out.stat().st_size <= 20_000
    within = [v for v in document["variants"] if (v["file_bytes"] or 1e9) <= 20_000]
    assert " ".join(words[3:]) in {v["command"].removeprefix("export ") for v in within}


def test_what_is_finished_is_kept_over_an_interruption(run, capsys, monkeypatch):
    whole = Runner.measure

    def interrupted(self):
        for number, variant in enumerate(whole(self)):
            if number == 1:
                raise KeyboardInterrupt
            yield variant

    monkeypatch.setattr(Runner, "measure", interrupted)
    assert main(["tradeoff", str(run), "axes=sh", "repeats=1"]) == 130
    path = run / "tradeoff" / "tradeoff.json"
    assert (
        f"stopped; 2 of 4 variants are measured and kept in {path}: the same command continues "
        "from there.\n"
    ) in capsys.readouterr().out
    monkeypatch.setattr(Runner, "measure", whole)
    assert main(["tradeoff", str(run), "axes=sh", "repeats=1"]) == 0
    said = capsys.readouterr().out
    assert "2 variants are measured already\n" in said
    assert "variants: 2 of 2 in " in said
    assert main(["tradeoff", str(run), "axes=sh", "repeats=1"]) == 0
    said = capsys.readouterr().out
    assert "variants: " not in said
    assert "rounds of timing" not in said


def test_other_views_are_measured_anew_and_that_is_said(run, capsys):
    measured(capsys, run, "axes=antialias", "repeats=1")
    assert main(["tradeoff", str(run), "axes=antialias", "repeats=1", "views=1"]) == 0
    path = run / "tradeoff" / "tradeoff.json"
    said = capsys.readouterr().out
    assert f"{run}, step 20: 1 held-out views\n" in said
    assert (
        f"{path}: its 2 variants are of another model or were measured in another way, and are "
        "measured anew\n"
    ) in said


def test_a_model_file_is_compared_with_its_own_renders(run, tmp_path, capsys):
    model = tmp_path / "model.gsfw"
    assert main(["export", str(run), "format=gsfw", f"out={model}"]) == 0
    capsys.readouterr()
    document = measured(capsys, model, "axes=sh,format", "repeats=1", f"out={tmp_path / 'out'}")
    assert document["against"] == "renders of the model as it is"
    by_name = {variant["name"]: variant for variant in document["variants"]}
    assert by_name["as it is"]["psnr"] == 100.0
    assert by_name["gsfw"]["psnr"] == 100.0
    assert by_name["gsfw"]["command"] == ""
    assert by_name["degree 0"]["psnr"] < 100.0


SMALL_FIELD = ("hexplane.channels=8", "hexplane.resolution=4", "hexplane.width=6")


@pytest.mark.parametrize(
    ("words", "floats_of_time"),
    [(("method=4dgs", *SMALL_FIELD), 0), (("method=spacetime",), 15)],
)
def test_a_moving_model_gives_up_what_a_still_one_can_and_time(
    words, floats_of_time, tmp_path, capsys
):
    run = tmp_path / "moving"
    train_moving(run, *words, "steps=8")
    capsys.readouterr()
    document = measured(capsys, run, "views=1", "repeats=1", "budget.mb=0.001")
    assert not document["left_out"].keys() & set(AXES)
    assert {variant["axis"] for variant in document["variants"]} == {"as it is", *AXES}
    assert not any(variant["failure"] for variant in document["variants"])
    found = {variant["name"]: variant for variant in document["variants"]}
    whole = found["as it is"]["floats"]
    assert found["degree 0"]["floats"] == whole - 150 * 45
    assert found["keep 50%"]["num_gaussians"] == 75
    assert found["keep 50%"]["floats"] == whole - 75 * (59 + floats_of_time)
    assert found["cull below 0.05"]["floats"] == whole
    assert found["50% still"]["floats"] == whole - 75 * floats_of_time
    assert found["still"]["floats"] == 150 * 59
    for metric in ("psnr", "ssim"):
        assert found["cull below 1/255"][metric] == found["as it is"][metric]
    # No verb cuts down a model that moves.
    others = [v for v in document["variants"] if v["axis"] != "format"]
    assert [v["name"] for v in others if v["command"]] == ["as it is", "1/2, enlarged"]
    assert found["gsfw precision=float16"]["file_bytes"] < 0.75 * found["gsfw"]["file_bytes"]
    assert found["as it is"]["command"] == "export format=gsfw"
    assert found["as it is"]["file_bytes"] == found["gsfw"]["file_bytes"]
    assert document["recommended"]["command"] == ""
    assert main(["export", str(run), "keep=0.5"]) == 2
    assert capsys.readouterr().err == (
        "error: keep=0.5: the model moves, and what a Gaussian adds differs from time to time.\n"
        "Leave keep out.\n"
    )


def test_a_moving_model_of_decoded_features_has_no_bands_to_give_up(tmp_path, capsys):
    run = tmp_path / "moving"
    train_moving(run, "method=spacetime", "preset=features", "steps=3")
    capsys.readouterr()
    document = measured(capsys, run, "repeats=1", "axes=sh,time")
    assert document["left_out"]["sh"] == (
        "a network makes its colours of channels, which have no SH bands"
    )
    found = {variant["name"]: variant["floats"] for variant in document["variants"]}
    # Fourteen numbers of shape and base colour and three features are left, and the decoder.
    assert found["still"] == 150 * (14 + 3) + 90


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("views=0", "views=0: expected a number of at least 1."),
        ("repeats=0", "repeats=0: expected a number of at least 1."),
        ("budget.mb=0", "budget.mb=0: expected a number above 0."),
        ("budget.ms=-1", "budget.ms=-1: expected a number above 0."),
    ],
)
def test_numbers_that_measure_nothing_are_refused(run, capsys, word, said):
    assert main(["tradeoff", str(run), word]) == 2
    assert capsys.readouterr().err == f"error: {said}\n"
    assert not (run / "tradeoff").exists()


def test_an_unknown_axis_names_those_there_are(run, capsys):
    assert main(["tradeoff", str(run), "axes=size"]) == 2
    assert ", ".join(AXES[:4]) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["keep=0"], "keep=0: expected a number above 0 and at most 1."),
        (["keep=1.5"], "keep=1.5: expected a number above 0 and at most 1."),
        (["sh_degree=-1"], "sh_degree=-1: expected a degree from 0 to 4."),
        (
            ["keep=0.5", "format=gsfw"],
            "format=gsfw: keep and sh_degree cut down one set of splats.\n"
            "Give them with format=ply, and without times.",
        ),
        (
            ["sh_degree=1", "times=all"],
            "times=all: keep and sh_degree cut down one set of splats.\n"
            "Give them with format=ply, and without times.",
        ),
    ],
)
def test_export_refuses_what_cannot_be_cut_down(run, capsys, words, said):
    assert main(["export", str(run), *words]) == 2
    assert capsys.readouterr().err == f"error: {said}\n"


def test_a_model_file_can_be_cut_down_too(run, tmp_path, capsys):
    model, small = tmp_path / "model.gsfw", tmp_path / "small.ply"
    assert main(["export", str(run), "format=gsfw", f"out={model}"]) == 0
    assert main(["export", str(model), "keep=0.5", "sh_degree=0", f"out={small}"]) == 0
    direct = tmp_path / "direct.ply"
    assert main(["export", str(run), "keep=0.5", "sh_degree=0", f"out={direct}"]) == 0
    assert small.read_bytes() == direct.read_bytes()
    assert RunFolder(run).config.is_file()
