"""A model that moves is written as one file, with its motion in closed form."""

import json

import pytest
import torch
from support.moving_runs import train

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.maths.similarity import Similarity
from gsfw.core.motion.evaluation import in_world, splats_at
from gsfw.formats.splatv import SplatvImporter
from gsfw.plugins.motion_quality import motion_psnr
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore
from gsfw.plugins.run_source import RunSource


@pytest.mark.slow
def test_the_file_holds_all_times_in_the_world_and_says_how_near_it_is(
    moving_run, tmp_path, capsys
):
    out = tmp_path / "a.splatv"
    assert main(["export", str(moving_run), f"out={out}", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["written"] == str(out)
    assert document["bytes"] == out.stat().st_size
    assert document["num_pieces"] == document["num_gaussians"]
    assert document["fit_psnr"] > 60
    found = SplatvImporter().read_motion(out)
    assert len(found.content.splats) == document["num_gaussians"]
    source = RunSource(restore(RunFolder(moving_run), installed()))
    for time in (0.0, 0.4, 1.0):
        expected = source.at(time).splat_file().splats
        means = splats_at(found, time).means
        assert float(torch.cdist(means, expected.means).amin(1).max()) < 1e-3


def test_the_words_are_short(moving_run, capsys):
    assert main(["export", str(moving_run), "format=splatv"]) == 0
    said = capsys.readouterr().out
    assert "moving splats, " in said
    assert " dB from the model after 5 steps, " in said
    assert said.endswith(f": {moving_run / 'scene.splatv'}\n")


def test_a_time_does_not_fit_what_holds_all(moving_run, capsys):
    assert main(["export", str(moving_run), "format=splatv", "time=0.5"]) == 2
    assert capsys.readouterr().err == (
        "error: format=splatv holds splats at all times: leave out time and times.\n"
        "To write one time: format=ply time=0.5\n"
    )


def test_a_static_run_is_a_scene_at_rest(finished_run, tmp_path, capsys):
    out = tmp_path / "a.splatv"
    assert main(["export", str(finished_run), f"out={out}"]) == 0
    assert "static splats after 20 steps" in capsys.readouterr().out
    assert SplatvImporter().read_motion(out).is_still


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "in_pieces", "whole", "quantised"),
    [("4dgs", 40.0, 25.0, 25.0), ("spacetime", 60.0, 60.0, 40.0)],
)
def test_a_trained_model_looks_the_same_in_closed_form(
    tmp_path, capsys, method, in_pieces, whole, quantised
):
    """At 100 steps, before degrees of view dependence: splaTV has none."""
    train(tmp_path / "run", f"method={method}", "steps=100", "sh_degree=0")
    restored = restore(RunFolder(tmp_path / "run"), installed())
    source, out = RunSource(restored), tmp_path / "a.splatv"
    capsys.readouterr()
    assert motion_psnr(restored, source.fitted_motion().file) > in_pieces
    assert main(["export", str(tmp_path / "run"), f"out={out}", "json=true"]) == 0
    assert json.loads(capsys.readouterr().out)["fit_psnr"] > whole
    world: Similarity = restored.composition.scene.world_from_scene
    found = in_world(SplatvImporter().read_motion(out), world.inverse())
    assert motion_psnr(restored, found) > quantised
