"""Tests of gsfw.plugins.registry."""

import pytest
from support.fake_parts import FakePlugin, fake_registry, registry_of

from gsfw.core.errors import ConfigError
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.registry import Registry, did_you_mean
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


def test_of_two_packages_with_one_name_the_first_is_taken_and_both_are_named():
    registry = registry_of(FakePlugin(), Twin())
    assert registry.slot("strategy")["adc"].distribution == "pkg0"
    assert [str(item) for item in registry.broken] == [
        "strategy 'adc' (pkg1 1.0) is skipped: this name is taken by pkg0 1.0. The first one "
        "is used; for the other, uninstall pkg0."
    ]


def test_the_built_in_part_wins_over_a_package_that_takes_its_name():
    discovery = Discovery()
    discovery.load_builtin()
    discovery.add(Twin(), PluginSource("twin", "a-twin", "2.0"))
    registry = Registry(discovery)
    assert registry.find("strategy", "adc").distribution == "gsfw"
    assert [item.distribution for item in registry.broken] == ["a-twin"]


def test_a_name_that_a_run_had_from_a_package_says_which_and_how_to_install_it():
    with pytest.raises(ConfigError) as caught:
        fake_registry().find("strategy", "revising", ("gsfw-revising 0.3", "pkg0 1.0"))
    assert str(caught.value) == (
        "no strategy 'revising' is installed here. The run was made with gsfw-revising 0.3.\n"
        "Install it, if you trust it: pip install gsfw-revising==0.3"
    )


def test_a_run_whose_rasterizer_is_missing_can_go_on_with_another():
    with pytest.raises(ConfigError) as caught:
        fake_registry().find("rasterizer", "dots", ("gsfw-dots 0.3", "pkg0 1.0"))
    assert caught.value.advice == (
        "Install it, if you trust it: pip install gsfw-dots==0.3\n"
        "A run can be resumed with another one: gsfw resume RUN rasterizer=cpu; if it is finished, "
        "with steps=N too."
    )


def test_a_part_of_another_tool_suggests_ours():
    assert did_you_mean("splatfacto", ["3dgs", "4dgs"]) == " Did you mean '3dgs'?"
    assert did_you_mean("splatfacto", ["4dgs"]) == ""


def test_nothing_is_suggested_for_what_resembles_nothing():
    assert did_you_mean("zzz", ["adc", "mcmc"]) == ""


def test_a_spec_loads_its_target():
    assert fake_registry().find("method", "demo").load().__name__ == "Demo"


def test_a_name_that_a_file_has_taken_names_the_file():
    discovery = Discovery()
    discovery.add(FakePlugin(), PluginSource("base", "from /home/me/base.py", ""))
    discovery.add(Twin(), PluginSource("twin", "a-twin", "2.0"))
    registry = Registry(discovery)
    registry.slot("strategy")
    (skipped,) = registry.broken
    assert skipped.reason == "this name is taken by the plugin at /home/me/base.py"


def test_a_skipped_plugin_is_told_once():
    registry = registry_of(FakePlugin(), Twin())
    registry.slot("strategy")
    with pytest.raises(ConfigError, match="\nnote: strategy 'adc'"):
        registry.find("strategy", "none")
    said: list[str] = []
    registry.tell_broken(said.append)
    registry.tell_broken(said.append)
    assert said == [str(registry.broken[0])]
    with pytest.raises(ConfigError) as caught:
        registry.find("strategy", "none")
    assert "note: " not in str(caught.value)
