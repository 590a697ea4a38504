"""Tests of gsfw.plugins.discovery."""

import pytest
from support.fake_parts import registry_of

from gsfw.plugins.discovery import BUILTIN, Discovery, PluginError
from gsfw.plugins.specs import Spec, hookimpl


class Failing:
    @hookimpl
    def gsfw_strategies(self):
        raise RuntimeError("no network")


class Misspelt:
    @hookimpl
    def gsfw_strategy(self):
        return []


class Strange:
    @hookimpl
    def gsfw_zzz(self):
        return []


def test_the_built_in_plugins_are_loaded_by_the_public_hooks(monkeypatch):
    discovery = Discovery()
    discovery.load_builtin()
    names = {spec.name for spec in discovery.specs("gsfw_metrics")}
    assert names == {"psnr", "ssim"}
    assert {spec.distribution for spec in discovery.specs("gsfw_commands")} == {"gsfw"}
    assert len(BUILTIN) == len(set(BUILTIN))


def test_a_plugin_that_fails_to_answer_is_skipped_and_told_once():
    registry = registry_of(Failing())
    assert registry.slot("strategy") == {}
    assert registry.slot("strategy") == {}
    assert [str(item) for item in registry.broken] == [
        "plugin 'plugin0' (pkg0) is skipped: gsfw_strategies raised RuntimeError: no network"
    ]


def test_an_unknown_hook_suggests_the_right_one():
    with pytest.raises(PluginError) as caught:
        registry_of(Misspelt())
    assert str(caught.value) == (
        "plugin 'plugin0' (pkg0): there is no hook 'gsfw_strategy'. Did you mean 'gsfw_strategies'?"
    )
    with pytest.raises(PluginError, match=r"there is no hook 'gsfw_zzz'\. The hooks are: gsfw_"):
        registry_of(Strange())


def test_specs_carry_the_distribution_that_brings_them():
    class Plugin:
        @hookimpl
        def gsfw_samplers(self):
            return [Spec("mine", "my sampler", "nowhere:Mine")]

    spec = registry_of(Plugin()).find("sampler", "mine")
    assert (spec.distribution, spec.version) == ("pkg0", "1.0")


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "returned NoneType, expected a list of Spec"),
        (Spec("a", "", "b:C"), "returned Spec, expected a list of Spec"),
        (["adc"], "returned a list with str, expected a list of Spec"),
    ],
)
def test_a_hook_that_returns_no_specs_is_skipped_and_told_once(answer, said):
    class Odd:
        @hookimpl
        def gsfw_metrics(self):
            return answer

    registry = registry_of(Odd())
    assert registry.slot("metric") == registry.slot("metric") == {}
    assert [item.reason for item in registry.broken] == [f"gsfw_metrics {said}"]
