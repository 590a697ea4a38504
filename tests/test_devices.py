"""One configuration on the CPU and on a GPU: the same images, and runs that may move between.

The CPU's side is drawn by the reference, so that torch and NVRTC are all that is needed.
"""

import json
from pathlib import Path

import pytest
import torch
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.machine_memory import gpu_memory
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore
from gsfw.plugins.settings import COMMAND_LINE, Layer

pytestmark = [pytest.mark.cuda, pytest.mark.slow]

ON_CPU = ("device=cpu", "rasterizer=reference")
ON_GPU = ("device=cuda", "rasterizer=cuda")

REFINING = ("strategy.refine_start=20", "strategy.refine_every=25")
"""Lets rows be added several times: from 150 to 1000 in 200 steps of adc."""

SETTLED = 0.1
"""dB by which runs without density control may differ after 200 steps: rounding alone separates
them. (The reference and the native rasterizer, both on the CPU, differ by less than 0.01.)"""

DRAWN = {"adc": 1.8, "error": 1.4, "mcmc": 0.6}
"""dB by which runs may differ that draw other random numbers for new rows. (The PSNR of 14 seeds on
the CPU lies within 1.6, 1.2 and 0.4 dB.)"""


@pytest.fixture(autouse=True)
def gpu() -> None:
    """A GPU, and what it takes to draw on it."""
    if not torch.cuda.is_available():
        pytest.skip("torch sees no GPU here")
    if why := rasterizer_capabilities(installed())["cuda"].unavailable:
        pytest.skip(why)


MOVING = ("datamanager.moving=true", "datamanager.times=4", "sampler.views_per_step=2")

RECORDED = {
    "3dgs": (),
    "3dgs corrected": ("exposure=true", "refine_poses=true", "sampler.views_per_step=2"),
    "4dgs": (*MOVING, "coarse_steps=60"),
    "spacetime": MOVING,
    "spacetime static": (*MOVING, "static=auto", "motion=adaptive"),
    "4d-rotor": (*MOVING, "neighbors_every=50"),
    "4d-rotor static": (*MOVING, "static=auto"),
    "dynamic3dgs": (*MOVING, "sampler.first_steps=80"),
}
"""Settings of runs whose steps are recorded, by method."""


def train(out: Path, *settings: str, method: str = "3dgs") -> dict:
    """The summary of a run on the small built-in scene."""
    assert main(["train", f"method={method}", *SMALL_SCENE, f"out={out}", *settings]) == 0
    return json.loads(RunFolder(out).summary.read_text())


def restored(out: Path, where: tuple[str, ...]):
    """A run as it was left, on one device."""
    values = dict(item.split("=") for item in where)
    return restore(RunFolder(out), installed(), changed=Layer(COMMAND_LINE, values))


@pytest.mark.parametrize(("strategy", "tolerance"), [("none", SETTLED), *DRAWN.items()])
def test_both_devices_train_to_the_same_quality(tmp_path, strategy, tolerance):
    settings = ("steps=200", f"strategy={strategy}")
    if strategy != "none":
        settings += REFINING
    here = train(tmp_path / "cpu", *settings, *ON_CPU)
    there = train(tmp_path / "gpu", *settings, *ON_GPU)
    assert there["psnr"] == pytest.approx(here["psnr"], abs=tolerance)
    assert there["psnr"] > 15
    assert there["skipped_steps"] == 0
    assert there["peak_gpu_memory_mb"] > 0
    assert "peak_gpu_memory_mb" not in here


@pytest.mark.parametrize("case", RECORDED)
def test_recorded_steps_train_as_others_do(tmp_path, case):
    settings, method = ("steps=200", "strategy=none", *RECORDED[case], *ON_GPU), case.split()[0]
    recorded = train(tmp_path / "recorded", *settings, method=method)
    usual = train(tmp_path / "usual", *settings, "graph=off", method=method)
    assert recorded["psnr"] == pytest.approx(usual["psnr"], abs=SETTLED)
    assert recorded["skipped_steps"] == 0
    assert "not recorded" not in (tmp_path / "recorded" / "log.txt").read_text()


def test_images_that_stay_and_images_that_pass_train_alike(tmp_path):
    settings = ("steps=100", "strategy=none", *ON_GPU)
    passing = train(tmp_path / "passing", *settings, "gpu_cache_mb=0")
    staying = train(tmp_path / "staying", *settings)
    assert passing["psnr"] == pytest.approx(staying["psnr"], abs=SETTLED)


def test_a_run_grows_by_the_memory_of_its_gpu(tmp_path, monkeypatch):
    settings = ("steps=200", "strategy=adc", *REFINING, *ON_GPU)
    free = train(tmp_path / "free", *settings)
    memory = gpu_memory(torch.device("cuda"))
    assert 0 < memory.own < memory.allowed
    assert 0 < memory.free < memory.allowed
    unwatched = train(tmp_path / "unwatched", *settings, "check_memory=false")
    assert unwatched["psnr"] == pytest.approx(free["psnr"], abs=DRAWN["adc"])
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (10**8, 10**10))
    short = train(tmp_path / "short", *settings)
    assert short["num_gaussians"] <= 150 < free["num_gaussians"]
    assert "growth slows down" in (tmp_path / "short" / "log.txt").read_text()


def test_both_devices_draw_the_same_images(tmp_path):
    train(tmp_path / "run", "steps=60", *ON_GPU)
    images = []
    for where in (ON_CPU, ON_GPU):
        run = restored(tmp_path / "run", where).composition
        parts, settings = run.parts, run.plan.settings
        drawn = [
            render_model(parts.model, parts.rasterizer, camera.to(parts.device), settings)
            for camera in parts.data.views(Split.TRAIN).cameras
        ]
        images.append(torch.cat([output.color.cpu() for output in drawn]))
        run.parts.data.close()
    here, there = images
    assert float((here - there).norm() / here.norm()) < 1e-5
    assert float(((here - there).abs().amax(-1) > 1e-5).float().mean()) < 5e-4


@pytest.mark.parametrize("strategy", ["adc", "error", "mcmc"])
@pytest.mark.parametrize(("first", "second"), [(ON_CPU, ON_GPU), (ON_GPU, ON_CPU)], ids=str)
def test_a_run_goes_on_on_another_device(tmp_path, capsys, strategy, first, second):
    out = tmp_path / "run"
    before = train(out, "steps=50", f"strategy={strategy}", *REFINING, *first)
    # On the CPU without its rasterizer: that of the GPU does not draw there, and is replaced.
    moved = second[:1] if second is ON_CPU else second
    assert main(["resume", str(out), "steps=120", *moved]) == 0
    said = capsys.readouterr()
    assert "device was" in said.out + said.err
    after = json.loads(RunFolder(out).summary.read_text())
    assert after["steps"] == 120
    assert after["skipped_steps"] == 0
    assert after["psnr"] > before["psnr"] - 0.5
    state = read_checkpoint(RunFolder(out).latest_checkpoint())
    assert state["environment"]["device"] == second[0].removeprefix("device=")


def test_a_gpu_run_repeats_itself_when_it_is_resumed_there(tmp_path):
    out = tmp_path / "run"
    train(out, "steps=40", "strategy=none", "checkpoint_every=20", *ON_GPU)
    whole = read_checkpoint(RunFolder(out).checkpoint(40))
    half = read_checkpoint(RunFolder(out).checkpoint(20))
    run = restored(out, ON_GPU)
    assert run.state["model"]["means.values"].device.type == "cpu"
    trainer = run.composition.trainer(RunFolder(tmp_path / "again"))
    trainer.load_state_dict(half)
    trainer.fit()
    again, before = trainer.parts.model.state_dict()["means.values"].cpu(), whole["model"]
    # Not to the bit: rows without a gradient worth its name follow the order of its summation.
    difference = again - before["means.values"]
    assert float(difference.norm() / before["means.values"].norm()) < 1e-3


def test_every_verb_takes_a_gpu_run_to_the_cpu_and_back(tmp_path, capsys):
    out = tmp_path / "run"
    summary = train(out, "steps=30", *ON_GPU)
    figures = []
    for device in ("cpu", "cuda", "cuda:0", "auto"):
        capsys.readouterr()
        assert main(["eval", str(out), f"device={device}", "json=true"]) == 0
        figures.append(json.loads(capsys.readouterr().out)["psnr"])
        assert main(["export", str(out), f"device={device}"]) == 0
        assert main(["render", str(out), f"device={device}", "frames=2"]) == 0
    assert figures == pytest.approx([summary["psnr"]] * 4, abs=0.01)


def test_a_gpu_that_is_not_there_is_refused(tmp_path, capsys):
    out = f"out={tmp_path / 'run'}"
    assert main(["train", "method=3dgs", *SMALL_SCENE, "device=cuda:99", out]) == 2
    assert "device=cuda:99: this machine has cuda:0" in capsys.readouterr().err
