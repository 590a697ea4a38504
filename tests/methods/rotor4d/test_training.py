"""Whole runs of method 4d-rotor on the built-in scene that moves."""

from dataclasses import replace

import pytest
import torch
from support.moving_runs import train
from support.resuming import resumed_to_the_same_bits
from support.scenes import front_camera

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.formats.ply import PlyImporter
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SHORT = (
    *("steps=30", "checkpoint_every=15", "eval_every=0", "neighbors_every=8"),
    *("strategy.refine_start=4", "strategy.refine_every=10"),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings", [(), ("rotation=two-quaternions", "strategy=mcmc")], ids=["rotor", "quaternions"]
)
def test_a_run_resumes_to_the_same_bits(tmp_path, settings):
    arguments = (*SHORT, *settings, "seed=3")
    figures = train(tmp_path / "whole", "method=4d-rotor", *arguments)
    assert figures["num_gaussians"] != 150, "rows must have been added or removed"
    resumed_to_the_same_bits(tmp_path / "whole")


@pytest.mark.slow
def test_a_run_is_exported_as_it_is_at_any_time(tmp_path):
    run = tmp_path / "run"
    train(run, "method=4d-rotor", "steps=20")
    assert RunFolder(run).splats.is_file()
    composition = restore(RunFolder(run), installed()).composition
    model, data = composition.parts.model, composition.parts.data
    # The file is in the world of the data: so must be the camera that looks at it.
    camera = front_camera()
    pose = data.scene.world_from_scene.camera(camera.world_to_camera).float()
    moved = replace(camera, world_to_camera=pose)
    for time in (0.0, 0.6):
        out = tmp_path / "splats.ply"
        assert main(["export", str(run), f"time={time}", f"out={out}"]) == 0
        with torch.no_grad():
            expected = ReferenceRasterizer().render(model.splats(torch.tensor(time)), camera)
            written = PlyImporter().read(out).splats.map(torch.Tensor.float)
            found = ReferenceRasterizer().render(written, moved)
        assert float((expected.color - found.color).abs().max()) < 1e-3


@pytest.mark.slow
def test_a_scene_that_moves_is_drawn_better_than_as_if_it_stood_still(tmp_path):
    settings = ("datamanager.views=40", "datamanager.width=48", "datamanager.height=36")
    settings += ("datamanager.points=1000", "datamanager.eval_views=4", "steps=300", "eval_every=0")
    moving = train(tmp_path / "moving", "method=4d-rotor", *settings)
    still = ("method=3dgs", "ignore_time=true", "sampler.views_per_step=2")
    blurred = train(tmp_path / "still", *settings, *still)
    assert moving["moving_psnr"] > blurred["moving_psnr"] + 3.0
