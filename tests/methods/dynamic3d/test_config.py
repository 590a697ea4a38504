"""Settings of method dynamic3dgs."""

import pytest

from gsfw.core.errors import ConfigError
from gsfw.plugins.compose import check
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve


def settings(**typed: str):
    values = {key.replace("__", "."): value for key, value in typed.items()}
    values |= {"method": "dynamic3dgs", "datamanager.moving": "true", "device": "cpu"}
    return resolve(installed(), [Layer(COMMAND_LINE, values)])


@pytest.mark.parametrize("steps", ["30", "100", "301", "1000", "3000", "30000", "70000"])
@pytest.mark.parametrize("rescale", ["true", "false"])
def test_rows_come_and_go_at_the_first_time_only_whatever_the_length(steps, rescale):
    found = settings(steps=steps, rescale=rescale)
    flat = found.flat()
    assert flat["sampler"] == "sequential"
    assert flat["strategy.refine_stop"] <= flat["sampler.first_steps"]
    assert flat["strategy.reset_every"] == 0
    check(found, installed())
    if rescale == "true":
        assert flat["strategy.refine_stop"] == pytest.approx(int(steps) / 6, abs=1)
        assert flat["sampler.first_steps"] == pytest.approx(int(steps) / 3, abs=1)


@pytest.mark.parametrize(
    "given",
    [{"strategy": "mcmc"}, {"strategy__refine_stop": "1500"}, {"sampler__first_steps": "9"}],
)
def test_rows_that_would_come_and_go_later_are_refused_with_advice(given):
    found = settings(steps="3000", **given)
    with pytest.raises(ConfigError) as caught:
        check(found, installed())
    flat = found.flat()
    stop, first = flat["strategy.refine_stop"], flat["sampler.first_steps"]
    assert str(caught.value) == (
        f"strategy.refine_stop={stop}: method 'dynamic3dgs' adds and removes Gaussians at the "
        f"first time only, which ends after sampler.first_steps={first} steps.\n"
        f"Give strategy.refine_stop={first // 2} or so."
    )


def test_no_density_control_is_no_trouble():
    check(settings(strategy="none"), installed())
    check(settings(strategy="mcmc", strategy__refine_stop="500"), installed())


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("rigid", "-1", "rigid=-1: expected a finite number of at least 0."),
        ("isometry", "inf", "isometry=inf: expected a finite number of at least 0."),
        ("neighbors", "0", "neighbors=0: expected a number of at least 1."),
        (
            "neighbors_per_step",
            "21",
            "neighbors_per_step=21: expected at most neighbors=20",
        ),
        (
            "optim.tracked_decay",
            "0",
            "optim.tracked_decay=0: expected a number above 0",
        ),
        ("optim.tracked_means_lr", "-1", "optim.tracked_means_lr=-1: expected a finite number of"),
    ],
)
def test_values_that_make_no_sense_are_one_message(key, value, expected):
    with pytest.raises(ConfigError) as caught:
        check(settings(**{key.replace(".", "__"): value}), installed())
    assert str(caught.value).startswith(expected)


def test_fewer_neighbours_than_those_of_a_step_are_refused_with_the_setting_to_change():
    with pytest.raises(ConfigError) as caught:
        check(settings(neighbors="3"), installed())
    assert caught.value.advice == "Give neighbors_per_step=3 or less, or more neighbors."
