"""The recipes of docs/plugins/recipes.md: each block is a plugin that trains on a small scene."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
import torch

from gsfw.api import Batch, Resampling, Split, ViewMap, Views, WrappedDataManager
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import compose
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.loading import make_callbacks
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Layer, resolve

pytestmark = pytest.mark.unchecked

PAGE = Path(__file__).resolve().parents[2] / "docs" / "plugins" / "recipes.md"
BLOCKS = re.findall(r"^## (.+?)$.*?^```python\n(.+?)^```", PAGE.read_text("utf-8"), re.M | re.S)
SCENE = {
    "datamanager.views": "4", "datamanager.eval_views": "1", "datamanager.width": "32",
    "datamanager.height": "24", "datamanager.points": "120", "device": "cpu", "eval_every": "0",
    "steps": "6", "report": "false", "log_every": "1",
}  # fmt: skip


class WithMaps(WrappedDataManager):
    """The built-in scene with maps that a folder of the user would bring."""

    def views(self, split: Split) -> Views:
        return replace(self.given.views(split), maps={"depth": 1, "features": 3})

    def load(self, split, indices, device) -> list[Batch]:
        return [
            replace(
                batch,
                maps={
                    "depth": ViewMap.of(torch.ones_like(batch.images[..., :1]), Resampling.DEPTH),
                    "features": ViewMap.of(batch.images),
                },
            )
            for batch in self.given.load(split, indices, device)
        ]


@pytest.fixture
def module_of(monkeypatch):
    """Imports a block as the module of a plugin."""

    def imported(code: str) -> ModuleType:
        module = ModuleType("recipe_of_the_page")
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(compile(code, str(PAGE), "exec"), vars(module))
        return module

    return imported


def code_of(title: str) -> str:
    """The block below a heading."""
    return dict(BLOCKS)[title]


def chosen(discovery: Discovery) -> dict[str, str]:
    """The settings that use what a recipe registers."""
    for hook in ("gsfw_methods", "gsfw_callbacks", "gsfw_metrics"):
        for spec in discovery.specs(hook):
            if spec.distribution == "recipe":
                return {"method": spec.name if hook == "gsfw_methods" else "3dgs"}
    raise AssertionError("the recipe registers nothing")


def trained(module: ModuleType, folder: Path, **settings: str):
    """Train a few steps with what a recipe registers; the composition and the summary."""
    discovery = Discovery()
    discovery.load_builtin()
    discovery.add(module, PluginSource("recipe", "recipe", "1.0"))
    registry = Registry(discovery)
    values = {**SCENE, **chosen(discovery), **settings}
    resolved = resolve(registry, [Layer("the test", values)])
    run = compose(resolved, registry, data=WithMaps(open_data(resolved)))
    assert not registry.broken
    callbacks = [
        callback
        for callback in make_callbacks(resolved.config.callbacks, registry)
        if type(callback).__module__ == module.__name__
    ]
    return run, run.trainer(RunFolder(folder), callbacks).fit()


def test_the_page_has_recipes():
    assert len(BLOCKS) >= 10


@pytest.mark.parametrize("title", [title for title, code in BLOCKS if "@hookimpl" in code])
def test_a_recipe_registers_a_part_that_loads(title, module_of):
    discovery = Discovery()
    discovery.add(module_of(code_of(title)), PluginSource("recipe", "recipe", "1.0"))
    hooks = ("gsfw_methods", "gsfw_callbacks", "gsfw_metrics")
    found = [spec for hook in hooks for spec in discovery.specs(hook)]
    assert [spec.load() for spec in found]
    assert not discovery.broken


@pytest.mark.slow
@pytest.mark.parametrize(
    "title", [title for title, code in BLOCKS if "@hookimpl" in code and "gsfw_methods" in code]
)
def test_a_recipe_of_a_method_trains(title, module_of, tmp_path):
    run, summary = trained(module_of(code_of(title)), tmp_path / "run")
    assert summary["steps"] == 6
    assert run.settings.method.distribution == "recipe"


@pytest.mark.slow
def test_the_recipe_of_a_metric_is_measured(module_of, tmp_path):
    _, summary = trained(module_of(code_of("A metric")), tmp_path / "run")
    assert 0 < summary["mae"] < 1


@pytest.mark.slow
def test_the_recipe_of_a_scalar_writes_events(module_of, tmp_path):
    trained(module_of(code_of("A TensorBoard scalar")), tmp_path / "run")
    assert list((tmp_path / "run" / "tb" / "sizes").glob("events.*"))


def test_the_recipe_of_a_map_adds_it_to_every_batch(module_of):
    discovery = Discovery()
    discovery.load_builtin()
    values = {**SCENE, "method": "3dgs"}
    data = open_data(resolve(Registry(discovery), [Layer("the test", values)]))
    wrapped = module_of(code_of("Per-view map")).WithBrightness(data)
    assert wrapped.views(Split.TRAIN).maps == {"brightness": 1}
    batch = wrapped.load(Split.TRAIN, [0], torch.device("cpu"))[0]
    assert batch.maps["brightness"].values.shape == (1, 24, 32, 1)
