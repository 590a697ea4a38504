"""Tests of the notes on typed values that change nothing in a run."""

import pytest

from gsfw.core.dependencies import unmet_dependencies
from gsfw.plugins.keys import keys
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve
from gsfw.strategies.adc import AdcConfig


def notes(*layers: Layer, **values: object) -> tuple[str, ...]:
    """Notes on the settings of method 3dgs, with keys typed (``__`` for a dot)."""
    given = {key.replace("__", "."): value for key, value in values.items()}
    typed = Layer(COMMAND_LINE, {"method": "3dgs", **given})
    return resolve(installed(), [*layers, typed]).notes


def test_typed_values_that_change_nothing_are_noted_with_what_they_need():
    assert notes(dense_points=99, strategy__grow_absgrad=1e-3) == (
        "dense_points=99 changes nothing without init=dense.",
        "strategy.grow_absgrad=0.001 changes nothing without strategy.absgrad=true.",
    )


def test_values_act_with_what_they_depend_on():
    values = {"exposure": True, "optim__exposure_lr": 0.1}
    assert notes(**values, strategy__absgrad=True, strategy__grow_absgrad=1e-3) == ()


def test_values_of_files_may_be_left_over_from_another_choice():
    assert notes(Layer("config file a.yaml", {"optim.poses_lr": 0.1})) == ()


def test_settings_of_a_callback_that_is_off_are_noted():
    assert notes(callbacks__autosave__enabled=False, callbacks__autosave__minutes=3) == (
        "callbacks.autosave.minutes=3.0 changes nothing without callbacks.autosave.enabled=true.",
    )


@pytest.mark.parametrize(
    ("condition", "cause"),
    [("absgrad == true", "is no condition"), ("nothing=1", "'nothing'"), ("absgrad>many", "many")],
)
def test_a_wrong_declaration_of_a_plugin_is_noted_and_stops_no_run(condition, cause, monkeypatch):
    monkeypatch.setattr(AdcConfig, "acts_with", {"grow_gradient": condition})
    (note,) = notes(strategy="adc", dense_points=99)
    assert note.startswith("settings that change nothing are not noted")
    assert cause in note


@pytest.mark.parametrize("slot", ["method", "strategy", "datamanager", "sampler", "rasterizer"])
def test_declared_dependencies_are_of_settings_that_exist(slot):
    for kind in load_all(slot, installed()).values():
        names = [key.name for key in keys(kind())]
        for unmet in unmet_dependencies(kind()):
            assert any(unmet.covers(name) for name in names), unmet
            assert set(unmet.asked) <= set(names), unmet
