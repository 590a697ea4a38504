"""Tests of gsfw.plugins.registry."""

import pytest
from support.fake_parts import FakePlugin, fake_registry, registry_of

from gsfw.core.errors import ConfigError
from gsfw.plugins.discovery import PluginError
from gsfw.plugins.registry import did_you_mean
from gsfw.plugins.specs import Spec, hookimpl


class Twin:
    @hookimpl
    def gsfw_strategies(self):
        return [Spec("adc", "another adc", "elsewhere:Adc")]


def test_names_are_listed_in_order():
    assert list(fake_registry().slot("rasterizer")) == ["fast", "gone", "slow"]


def test_an_unknown_name_suggests_the_nearest_and_lists_all():
    with pytest.raises(ConfigError) as caught:
        fake_registry().find("strategy", "mcm")
    assert str(caught.value) == "no strategy 'mcm'. Did you mean 'mcmc'?\nInstalled: adc, mcmc."


def test_a_name_that_two_packages_chose_is_an_error_that_names_both():
    with pytest.raises(PluginError) as caught:
        registry_of(FakePlugin(), Twin()).slot("strategy")
    assert str(caught.value) == (
        "strategy 'adc' is registered by both 'pkg0' and 'pkg1'.\n"
        "Uninstall one of them, or load only some with GSFW_PLUGINS=name,name."
    )


def test_nothing_is_suggested_for_what_resembles_nothing():
    assert did_you_mean("zzz", ["adc", "mcmc"]) == ""


def test_a_spec_loads_its_target():
    assert fake_registry().find("method", "demo").load().__name__ == "Demo"
