"""The callback against a small stand-in of wandb, which records the same calls."""

import json
import os
import subprocess
import sys

import pytest
from gsfw_wandb import callback

from gsfw.api import ConfigError
from gsfw.testing import conformance

# Without the package wandb, what concerns its runs is skipped.
test_conforms = conformance("plugin", "gsfw-wandb")

RECORDER = """
import json
import os
from types import SimpleNamespace

class Image:
    def __init__(self, pixels, caption=""):
        self.shape, self.caption = list(pixels.shape), caption

class Run:
    id = "abc123"
    def __init__(self, **given):
        given["settings"] = len(given.pop("config"))
        self.calls = [["init", given]]
        self.summary = SimpleNamespace(update=lambda values: self.note("summary", values))
    def note(self, name, values):
        self.calls.append([name, values])
    def log(self, figures, step):
        self.note("log", {"step": step, **figures})
    def finish(self):
        with open(os.environ["RECORD"], "w") as file:
            json.dump(self.calls, file, default=vars)

def init(**given):
    return Run(**given)
"""
SCENE = (
    *("datamanager.views=4", "datamanager.eval_views=2", "datamanager.width=32"),
    *("datamanager.height=24", "datamanager.points=100", "device=cpu", "report=false"),
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The calls of a run of 20 steps, and its folder."""
    folder = tmp_path_factory.mktemp("wandb")
    (folder / "wandb.py").write_text(RECORDER)
    subprocess.run(
        [
            *(sys.executable, "-m", "gsfw", "train", "method=3dgs", *SCENE, "steps=20"),
            *("eval_every=10", f"out={folder / 'run'}", "callbacks.wandb.enabled=true"),
            *("callbacks.wandb.mode=offline", "callbacks.wandb.images=1"),
        ],
        env={**os.environ, "RECORD": str(folder / "calls.json"), "PYTHONPATH": str(folder)},
        check=True,
        capture_output=True,
    )
    return json.loads((folder / "calls.json").read_text()), folder / "run"


def test_a_run_starts_with_its_settings_in_its_folder(recorded):
    calls, folder = recorded
    name, given = calls[0]
    assert name == "init"
    assert given["mode"] == "offline"
    assert given["dir"] == str(folder)
    assert given["name"] == "run"
    assert given["settings"] > 50
    assert (folder / "wandb_run_id.txt").read_text() == "abc123"


def test_curves_and_held_out_images_are_logged_in_order(recorded):
    calls, _ = recorded
    logged = [values for name, values in calls if name == "log"]
    assert [values["step"] for values in logged] == sorted(values["step"] for values in logged)
    assert {"loss/total", "loss/l1", "train/psnr", "gaussians"} <= set(logged[0])
    evaluated = [values for values in logged if "eval/psnr" in values]
    assert [values["step"] for values in evaluated] == [10, 20]
    (image,) = [value for key, value in evaluated[0].items() if key.startswith("view/")]
    assert image["shape"] == [24, 64, 3]
    assert image["caption"] == "photo, render"


def test_the_summary_holds_the_final_figures(recorded):
    calls, _ = recorded
    assert calls[-1][0] == "summary"
    assert calls[-1][1]["psnr"] > 0


def test_a_missing_package_is_named_before_training(monkeypatch):
    monkeypatch.setattr(callback, "find_spec", lambda name: None)
    with pytest.raises(ConfigError) as caught:
        callback.WandbConfig(enabled=True).check()
    assert "pip install wandb" in str(caught.value)
