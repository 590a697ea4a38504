"""Methods for moving scenes without data: the built-in scene moves."""

import pytest

from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.methods.spacetime.config import SpacetimeConfig
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve

METHODS = [name for name, spec in installed().slot("method").items() if "dynamic" in spec.tags]


def settings(method: str, **typed: str) -> Settings:
    values = {key.replace("__", "."): value for key, value in typed.items()}
    line = Layer(COMMAND_LINE, {"method": method, "device": "cpu", **values})
    return resolve(installed(), [line])


@pytest.mark.parametrize("method", METHODS)
def test_the_built_in_scene_moves_without_being_asked_to_and_says_why(method):
    found = settings(method)
    assert found.flat()["datamanager.moving"] is True
    assert found.sources["datamanager.moving"] == "preset default"
    assert found.config.steps == 3000, "what the moving scene recommends, not the still one"


@pytest.mark.parametrize("method", METHODS)
def test_a_still_scene_can_be_asked_for_and_data_have_no_such_setting(method):
    assert settings(method, datamanager__moving="false").flat()["datamanager.moving"] is False
    flat = settings(method, data="capture", datamanager="transforms").flat()
    assert flat["datamanager"] == "transforms"
    assert "datamanager.moving" not in flat


def test_every_preset_keeps_the_motion_and_a_method_for_still_scenes_has_none():
    assert settings("spacetime", preset="freetime").flat()["datamanager.moving"] is True
    assert settings("3dgs").flat()["datamanager.moving"] is False


def test_a_preset_for_other_data_and_what_these_recommend_keep_their_settings(monkeypatch):
    presets = {"masked": {"datamanager": "transforms", "datamanager.masks": "none"}}
    monkeypatch.setattr(SpacetimeConfig, "presets", SpacetimeConfig.presets | presets)
    flat = settings("spacetime", preset="masked", data="capture").flat()
    assert (flat["datamanager"], flat["datamanager.masks"]) == ("transforms", "none")
    monkeypatch.setattr(TransformsConfig, "recommended", {"datamanager.masks": "none"})
    flat = settings("spacetime", data="capture", datamanager="transforms").flat()
    assert flat["datamanager.masks"] == "none"
