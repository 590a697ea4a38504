"""Training with method 4dgs: resuming across the change of phase, export, and what is gained."""

import json

import pytest
from support.resuming import resumed_to_the_same_bits

from gsfw.commands.main import main
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

MOVING = (
    "datamanager.moving=true", "datamanager.times=4", "datamanager.views=8",
    "datamanager.eval_views=2", "datamanager.width=32", "datamanager.height=24",
    "datamanager.points=150", "device=cpu",
)  # fmt: skip
SMALL_FIELD = (
    "hexplane.resolution=8", "hexplane.channels=8", "mlp.width=16", "mlp.depth=3",
    "hash.levels=3", "hash.finest=16", "hash.log2_rows=10",
)  # fmt: skip
SHORT = ("steps=20", "coarse_steps=13", "checkpoint_every=10", "log_every=1", "eval_every=0")
"""The first checkpoint is of the coarse phase, the second of the fine one."""


def train(out, *settings) -> RunFolder:
    assert main(["train", "method=4dgs", *MOVING, *SMALL_FIELD, *settings, f"out={out}"]) == 0
    return RunFolder(out)


@pytest.mark.slow
@pytest.mark.parametrize("encoder", ["hexplane", "mlp", "hash"])
def test_a_run_resumed_in_the_coarse_phase_ends_with_the_same_bits(tmp_path, encoder):
    whole = train(tmp_path / "whole", *SHORT, f"encoder={encoder}", "deform_opacity=true")
    resumed_to_the_same_bits(whole.path)
    moments = read_checkpoint(whole.checkpoint(20))["optimizer"]["moments"]["network"]
    assert {int(moment["count"]) for moment in moments} == {7}

    path = tmp_path / "splats.ply"
    assert main(["export", str(whole.path), "time=0.5", f"out={path}"]) == 0
    assert path.is_file()


@pytest.mark.slow
def test_regularizers_are_logged_in_the_fine_phase_only(tmp_path):
    run = train(tmp_path / "run", *SHORT)
    lines = [json.loads(line) for line in run.metrics_log.read_text().splitlines()]
    terms = {"plane_tv", "time_smoothness", "time_l1"}
    fine = [line["step"] for line in lines if terms <= {key.split("/")[-1] for key in line}]
    assert fine == list(range(14, 21))


@pytest.mark.slow
@pytest.mark.parametrize("encoder", ["hexplane", "hash"])
def test_a_short_training_follows_what_static_gaussians_blur(tmp_path, encoder):
    settings = (
        "datamanager.moving=true", "datamanager.times=6", "datamanager.views=36",
        "datamanager.eval_views=4", "datamanager.width=48", "datamanager.height=36",
        "datamanager.points=800", "strategy=none", "steps=200", "eval_every=0", "device=cpu",
        "optim.factor=1",
    )  # fmt: skip
    figures = {}
    for name, own in {
        "still": ("method=3dgs", "ignore_time=true"),
        "moving": ("method=4dgs", f"encoder={encoder}", "hexplane.resolution=32"),
    }.items():
        out = tmp_path / name
        assert main(["train", *settings, *own, f"out={out}"]) == 0
        figures[name] = json.loads(RunFolder(out).summary.read_text())["psnr"]
    assert figures["moving"] > figures["still"] + 1.5
