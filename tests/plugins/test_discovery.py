"""Tests of gsfw.plugins.discovery."""

from importlib import import_module
from types import ModuleType

import pytest
from support.fake_parts import FakePlugin, registry_of

from gsfw.plugins.discovery import BUILTIN, Discovery, PluginSource
from gsfw.plugins.skipped import other_version
from gsfw.plugins.specs import Spec, hookimpl


class Failing:
    @hookimpl
    def gsfw_strategies(self):
        raise RuntimeError("no network")


class Strange:
    @hookimpl
    def gsfw_zzz(self):
        return []


def unchecked(name: str, description: object) -> Spec:
    """A spec as a package makes it that is not checked for its types."""
    spec = Spec(name, "", "b:C")
    object.__setattr__(spec, "description", description)
    return spec


def test_the_built_in_plugins_are_loaded_by_the_public_hooks(monkeypatch):
    discovery = Discovery()
    discovery.load_builtin()
    names = {spec.name for spec in discovery.specs("gsfw_metrics")}
    assert names == {"psnr", "ssim", "color_corrected_psnr"}
    assert {spec.distribution for spec in discovery.specs("gsfw_commands")} == {"gsfw"}
    assert len(BUILTIN) == len(set(BUILTIN))


def test_a_plugin_that_fails_to_answer_is_skipped_and_told_once():
    registry = registry_of(Failing())
    assert registry.slot("strategy") == {}
    assert registry.slot("strategy") == {}
    assert [str(item) for item in registry.broken] == [
        "hook 'gsfw_strategies' (pkg0 1.0) is skipped: it raised RuntimeError: no network. "
        + other_version("pkg0")
    ]


def test_an_unknown_hook_is_named_and_the_other_hooks_of_the_plugin_work():
    class Newer(FakePlugin):
        @hookimpl
        def gsfw_strategy(self):
            return []

    registry = registry_of(Newer(), Strange())
    assert list(registry.slot("strategy")) == ["adc", "mcmc"]
    assert [(item.name, item.reason) for item in registry.broken] == [
        (
            "gsfw_strategy",
            "there is no such hook (did you mean 'gsfw_strategies'?), the others are used",
        ),
        ("gsfw_zzz", "there is no such hook, the others are used"),
    ]
    assert "install the version of pkg0 that was made for it" in registry.broken[0].advice


def test_a_plugin_without_hooks_is_skipped():
    registry = registry_of(ModuleType("idle"))
    (found,) = registry.broken
    assert found.reason == "its module 'idle' has no hook"
    assert found.advice.startswith("Write one of gsfw_callbacks, gsfw_commands, ")


def test_a_folder_in_the_place_of_a_plugin_is_named(tmp_path, monkeypatch):
    (tmp_path / "hidden_plugin").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    registry = registry_of(import_module("hidden_plugin"))
    (found,) = registry.broken
    assert found.reason == (
        f"the folder {tmp_path / 'hidden_plugin'}, which has no __init__.py, takes the place of "
        "its module 'hidden_plugin'"
    )
    assert found.advice.startswith("Start Python in another folder, or rename this one.")


def test_a_field_of_spec_that_a_newer_gsfw_has_is_named_without_a_type_error():
    class Newer:
        @hookimpl
        def gsfw_methods(self):
            return [Spec("future", "", "future:Config", api_version=3)]

    registry = registry_of(Newer(), FakePlugin())
    assert list(registry.slot("method")) == ["demo", "moving"]
    assert [item.reason for item in registry.broken] == [
        "it registers a Spec with the field 'api_version', which this version does not have"
    ]


def test_plugins_of_two_distributions_may_have_one_name():
    discovery = Discovery()
    for distribution in ("b", "a"):
        discovery.add(FakePlugin(), PluginSource("same", distribution, "1.0"))
    assert {spec.distribution for spec in discovery.specs("gsfw_samplers")} == {"a", "b"}
    discovery.remove("same")
    assert list(discovery.specs("gsfw_samplers")) == []


def test_code_belongs_to_the_plugin_whose_module_it_is():
    discovery = Discovery()
    discovery.load_builtin()
    discovery.add(FakePlugin(), PluginSource("fake", "gsfw-fake", "1.0", "fake_entry"))
    assert str(discovery.owner("support.fake_parts")) == "gsfw-fake 1.0"
    assert str(discovery.owner("fake_entry.parts.deep")) == "gsfw-fake 1.0"
    assert discovery.owner("gsfw.core.config") is discovery.owner("torch.nn") is None


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
        ([unchecked("a", 3)], "registers 'a' with a field that is no text"),
        ([Spec("a b", "", "b:C")], "registers the name 'a b', which cannot be typed as a value"),
        ([Spec("a", "", "b.C")], "registers 'a' with the target 'b.C', no 'module:Name'"),
    ],
)
def test_a_hook_that_returns_no_specs_is_skipped_and_told_once(answer, said):
    class Odd:
        @hookimpl
        def gsfw_metrics(self):
            return answer

    registry = registry_of(Odd())
    assert registry.slot("metric") == registry.slot("metric") == {}
    assert [item.reason for item in registry.broken] == [f"it {said}"]
