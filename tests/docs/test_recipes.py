"""The recipes of docs/plugins/recipes.md: each block is a plugin that trains on a small scene."""

from dataclasses import replace

import pytest
import torch
from support.page_plugins import PLUGINS, blocks, composed, module_of, registry_with, specs_of

from gsfw.api import Resampling, Split, ViewMap, WrappedDataManager
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.loading import make_callbacks

pytestmark = pytest.mark.unchecked

RECIPES = blocks(PLUGINS / "recipes.md")
METHODS = [title for title, code in RECIPES.items() if "gsfw_methods" in code]


class WithMaps(WrappedDataManager):
    """The built-in scene with maps that a folder of the user would bring."""

    def views(self, split):
        return replace(self.given.views(split), maps={"depth": 1, "features": 3})

    def load(self, split, indices, device):
        return [with_maps(batch) for batch in self.given.load(split, indices, device)]


def with_maps(batch):
    """The batch with a depth of 1 everywhere, and its own colours as features."""
    depth = ViewMap.of(torch.ones_like(batch.images[..., :1]), Resampling.DEPTH)
    return replace(batch, maps={"depth": depth, "features": ViewMap.of(batch.images)})


def test_the_page_has_recipes():
    assert len(METHODS) == 9  # As docs/plugins/slots/method.md says.


@pytest.mark.parametrize("title", [name for name, code in RECIPES.items() if "@hookimpl" in code])
def test_a_recipe_registers_a_part_that_loads(title):
    assert [spec.load() for spec in specs_of(module_of(RECIPES[title])).values()]


@pytest.mark.slow
@pytest.mark.parametrize("title", METHODS)
def test_a_recipe_of_a_method_trains(title, tmp_path):
    module = module_of(RECIPES[title])
    name = specs_of(module)["gsfw_methods"].name
    run = composed(registry_with(module), WithMaps, method=name)
    assert run.trainer(RunFolder(tmp_path / "run")).fit()["steps"] == 6


@pytest.mark.slow
def test_the_recipe_of_a_metric_is_measured(tmp_path):
    run = composed(registry_with(module_of(RECIPES["A metric"])))
    assert 0 < run.trainer(RunFolder(tmp_path / "run")).fit()["mae"] < 1


@pytest.mark.slow
def test_the_recipe_of_a_scalar_writes_events(tmp_path):
    module = module_of(RECIPES["A TensorBoard scalar"])
    registry = registry_with(module)
    run = composed(registry)
    callbacks = make_callbacks(run.settings.config.callbacks, registry)
    own = [item for item in callbacks if type(item).__module__ == module.__name__]
    run.trainer(RunFolder(tmp_path / "run"), own).fit()
    assert list((tmp_path / "run" / "tb" / "sizes").glob("events.*"))


def test_the_recipe_of_a_map_adds_it_to_every_batch():
    wrapper = module_of(RECIPES["Per-view map"]).WithBrightness
    data = composed(registry_with(), wrapper).parts.data
    assert data.views(Split.TRAIN).maps == {"brightness": 1}
    batch = data.load(Split.TRAIN, [0], torch.device("cpu"))[0]
    assert batch.maps["brightness"].values.shape == (1, 24, 32, 1)
