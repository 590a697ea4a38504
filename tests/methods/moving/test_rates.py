"""Learning rates of moving methods: higher in short runs, those of the papers in preset paper."""

import pytest

from gsfw.core.learning_rate import LearningRate
from gsfw.methods.gaussians3d.config import GaussiansConfig
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

FIELDS_AND_PATHS = ("4dgs", "4d-rotor", "spacetime")


def config(method: str, **values: str) -> GaussiansConfig:
    given = {"method": method, "device": "cpu", **values}
    found = resolve(installed(), [Layer(COMMAND_LINE, given)]).config
    assert isinstance(found, GaussiansConfig)
    return found


def rates(method: str, **values: str) -> dict[str, LearningRate]:
    return config(method, **values).learning_rates(1.0)


@pytest.mark.parametrize("method", [*FIELDS_AND_PATHS, "dynamic3dgs"])
def test_positions_learn_faster_in_shorter_runs(method):
    short, long = (rates(method, steps=steps)["means"].initial for steps in ("600", "3000"))
    assert short > 1.5 * long
    paper = rates(method, steps="600", preset="paper")["means"].initial
    assert paper == pytest.approx(1.6e-4)


@pytest.mark.parametrize("method", FIELDS_AND_PATHS)
def test_opacities_learn_at_the_rate_of_a_long_static_run(method):
    assert rates(method, steps="800")["opacity_logits"].initial == pytest.approx(0.05, rel=0.1)
    assert rates(method, preset="paper")["opacity_logits"].initial == pytest.approx(0.05)


@pytest.mark.parametrize("method", FIELDS_AND_PATHS)
def test_the_rates_of_what_moves_cool_down_at_the_end(method):
    def last(**values: str) -> float:
        return config(method, steps="600", **values).optim.settings(600).cooldown.factor(600)

    assert last() == pytest.approx(0.1)
    assert last(preset="paper") == 1.0


def test_tracked_gaussians_do_not_cool_down_as_their_rates_decay_at_every_time():
    assert config("dynamic3dgs", steps="600").optim.settings(600).cooldown.factor(600) == 1.0
