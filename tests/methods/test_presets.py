"""What holds for every method for scenes that move, whatever its presets choose."""

import pytest

from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve

DYNAMIC = [
    (name, preset)
    for name, spec in installed().slot("method").items()
    if "dynamic" in spec.tags
    for preset in load("method", spec).presets
]


def flat(**values: object) -> dict[str, object]:
    # Not of the built-in scene, which recommends to have no resets itself.
    data = {"data": "folder", "datamanager": "blender", "device": "cpu"}
    return resolve(installed(), [Layer("command line", {**data, **values})]).flat()


@pytest.mark.parametrize(("method", "preset"), DYNAMIC)
def test_opacities_are_not_reset_unless_someone_asks(method, preset):
    chosen = flat(method=method, preset=preset)
    assert chosen.get("strategy.reset_every", 0) == 0
    explicit = flat(method=method, preset=preset, strategy="adc")
    assert explicit["strategy.reset_every"] == 0
    assert flat(method=method, strategy="adc")["strategy.reset_every"] == 0
    asked = {"strategy": "adc", "strategy.reset_every": 3000, "rescale": False}
    assert flat(method=method, preset=preset, **asked)["strategy.reset_every"] == 3000


def test_static_methods_keep_their_resets():
    assert flat(method="3dgs", rescale=False)["strategy.reset_every"] == 3000


@pytest.mark.parametrize("method", ["4dgs", "4d-rotor", "spacetime"])
def test_growth_over_all_times_has_a_limit_unless_someone_gives_another(method):
    assert flat(method=method, strategy="adc")["strategy.max_gaussians"] == 360_000
    wider = {"strategy": "adc", "strategy.max_gaussians": 1_000_000}
    assert flat(method=method, **wider)["strategy.max_gaussians"] == 1_000_000
    assert "strategy.max_gaussians" not in flat(method=method, strategy="mcmc")
