"""The examples of docs/examples train on the built-in scene, each as a plugin of one file."""

from importlib import import_module
from pathlib import Path

import pytest
import torch

from gsfw.core.errors import ConfigError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Layer, resolve

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
SCENE = {
    "datamanager.views": "6", "datamanager.eval_views": "2", "datamanager.width": "32",
    "datamanager.height": "24", "datamanager.points": "150", "device": "cpu", "eval_every": "0",
}  # fmt: skip


@pytest.fixture
def composed(monkeypatch):
    """Composes a run of an example from settings."""
    monkeypatch.syspath_prepend(str(EXAMPLES))

    def of(example: str, **settings: str) -> Composition:
        discovery = Discovery()
        discovery.load_builtin()
        discovery.add(import_module(example), PluginSource(example, example, "1.0"))
        values = {**SCENE, **{key.replace("__", "."): value for key, value in settings.items()}}
        registry = Registry(discovery)
        return compose(resolve(registry, [Layer("the test", values)]), registry)

    return of


def test_a_prototype_method_with_its_own_model_learns_without_density_control(composed, tmp_path):
    run = composed("prototype_method", method="blobs", strategy="none", steps="60", count="300")
    summary = run.trainer(RunFolder(tmp_path / "run")).fit()
    untrained = composed(
        "prototype_method", method="blobs", strategy="none", steps="1", count="300"
    )
    assert summary["psnr"] > untrained.trainer(RunFolder(tmp_path / "one")).fit()["psnr"] + 2
    assert summary["num_gaussians"] == 300


def test_density_control_names_what_a_prototype_lacks(composed):
    with pytest.raises(ConfigError) as caught:
        composed("prototype_method", method="blobs", strategy="adc")
    assert "BlobModel" in str(caught.value)
    assert "strategy=none" in str(caught.value)


@pytest.mark.parametrize("strategy", ["adc", "mcmc"])
def test_a_column_more_goes_through_density_control_and_is_measured(composed, tmp_path, strategy):
    run = composed(
        "feature_column", method="3dgs-bright", steps="60", rescale="false",
        strategy=strategy, strategy__refine_start="10", strategy__refine_every="10",
    )  # fmt: skip
    summary = run.trainer(RunFolder(tmp_path)).fit()
    assert summary["brightness_error"] < 0.5
    state = read_checkpoint(RunFolder(tmp_path).checkpoint(60))["model"]
    assert len(state["extra.brightness.values"]) == summary["num_gaussians"] != 150
    assert float(state["extra.brightness.values"].abs().max()) > 0.05


@pytest.mark.parametrize("budget", ["none", "160", "auto"])
def test_a_strategy_by_errors_grows_within_any_budget(composed, tmp_path, budget):
    run = composed(
        "error_strategy", method="3dgs", steps="40", rescale="false", strategy="by-error",
        strategy__every="5", strategy__budget=budget, strategy__budget_every="2",
    )  # fmt: skip
    summary = run.trainer(RunFolder(tmp_path)).fit()
    assert summary["num_gaussians"] > 170 if budget == "none" else summary["num_gaussians"] <= 170
    state = read_checkpoint(RunFolder(tmp_path).checkpoint(40))["refiners"]
    assert set(state) == ({"by-error"} if budget == "none" else {"budget", "by-error"})
    assert all(torch.isfinite(state["by-error"][name]).all() for name in state["by-error"])


def test_a_method_is_given_the_training_views_and_its_model_the_cameras(
    composed, tmp_path, monkeypatch
):
    example = import_module("feature_column")
    begun, rendered = [], []
    splats = example.BrightGaussians.splats

    def noted(self, time=None, cameras=None):
        rendered.append(cameras)
        return splats(self, time, cameras)

    monkeypatch.setattr(
        example.Bright, "begin", lambda self, scene, views, model: begun.append((views, model))
    )
    monkeypatch.setattr(example.BrightGaussians, "splats", noted)
    run = composed("feature_column", method="3dgs-bright", strategy="none", steps="2")
    ((views, model),) = begun
    assert model is run.parts.model
    assert len(views.names) == len(views.cameras) == 6
    assert all(camera.intrinsics.shape == (1, 3, 3) for camera in views.cameras)
    run.trainer(RunFolder(tmp_path)).fit()
    assert all((cameras.width, cameras.height) == (32, 24) for cameras in rendered)


def test_a_column_that_is_used_before_it_is_made_is_named(composed):
    model = composed("prototype_method", method="blobs", strategy="none").parts.model
    del model.logits
    with pytest.raises(RuntimeError, match=r"the columns of BlobModel: .*'logits'"):
        _ = model.num_rows
