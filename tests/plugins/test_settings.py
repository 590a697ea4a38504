"""Tests of gsfw.plugins.settings."""

from dataclasses import dataclass

import pytest
from support.fake_parts import Demo, FakePlugin, fake_registry, registry_of

from gsfw.core.config import MethodConfig
from gsfw.core.errors import ConfigError
from gsfw.core.step_settings import Rescaled, step_settings, steps_field
from gsfw.plugins.registry import Registry, installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve
from gsfw.plugins.specs import Spec, hookimpl
from gsfw.strategies.adc import AdcConfig


def settings(*layers: Layer, **typed: object) -> Settings:
    """Settings of method demo, with keys typed (``__`` for a dot)."""
    values = {key.replace("__", "."): value for key, value in typed.items()}
    return resolve(fake_registry(), [*layers, Layer(COMMAND_LINE, {"method": "demo", **values})])


def refusal(*layers: Layer, registry: Registry | None = None, **typed: object) -> str:
    values = {key.replace("__", "."): value for key, value in typed.items()}
    line = Layer(COMMAND_LINE, {"method": "demo", **values})
    with pytest.raises(ConfigError) as caught:
        resolve(registry or fake_registry(), [*layers, line])
    return str(caught.value)


def test_without_anything_given_everything_is_the_methods_default():
    found = settings()
    assert found.flat()["steps"] == 30_000
    assert found.sources["steps"] == "method default"
    assert found.sources["method"] == "command line"


def test_flat_starts_with_the_choices_and_has_a_source_for_every_key():
    found = settings()
    flat = found.flat()
    first = ["method", "strategy", "rasterizer", "datamanager", "sampler", "data", "out", "steps"]
    assert list(flat)[:8] == first
    assert list(flat.values())[:5] == ["demo", "adc", "fast", "synthetic", "uniform"]
    assert flat["strategy.every"] == 100
    assert flat["shape"] == [1.0, 1.0, 1.0]
    assert flat.keys() == found.sources.keys()


def test_flat_resolves_to_the_same_settings_again():
    found = settings(strategy="mcmc", steps="7000", limit="0.5", shape="[1, 2, 3]", mode="hard")
    again = resolve(fake_registry(), [Layer("a file", found.flat())])
    assert again.config == found.config
    assert again.choices == found.choices


def test_later_layers_win_and_sources_say_who_did():
    low = Layer("config file low.yaml", {"seed": 1, "downscale": 2, "cache_mb": 5})
    high = Layer("config file high.yaml", {"seed": 2, "downscale": 4})
    found = settings(low, high, seed="3")
    assert (found.config.seed, found.config.downscale, found.config.cache_mb) == (3, 4.0, 5)
    assert found.sources["seed"] == "command line"
    assert found.sources["downscale"] == "config file high.yaml"
    assert found.sources["cache_mb"] == "config file low.yaml"


def test_a_preset_is_above_defaults_and_below_what_is_given():
    found = settings(preset="fast", optim__sparse="no")
    assert found.config.steps == 6000
    assert found.sources["steps"] == "preset fast"
    assert found.config.optim.sparse is False
    assert found.flat()["strategy.every"] == 10


def test_a_preset_in_a_file_is_still_below_the_files_values():
    found = settings(Layer("config file a.yaml", {"preset": "fast", "steps": 9000}))
    assert found.config.steps == 9000
    assert found.config.optim.sparse is True


def test_method_and_slots_may_come_from_a_file():
    layer = Layer("config file a.yaml", {"method": "demo", "strategy": "mcmc"})
    found = resolve(fake_registry(), [layer])
    assert found.choices["strategy"].name == "mcmc"
    assert found.sources["strategy"] == found.sources["method"] == "config file a.yaml"


def test_a_choice_brings_what_it_recommends_and_the_user_wins():
    assert settings(strategy="mcmc").config.antialias is True
    assert settings(strategy="mcmc").sources["antialias"] == "recommended by strategy mcmc"
    assert settings(strategy="mcmc", antialias="false").config.antialias is False
    assert settings().config.antialias is False


def test_what_a_strategy_recommends_of_other_methods_is_left_out_with_a_note(monkeypatch):
    kind = type(settings(strategy="mcmc").config.strategy)
    recommended = {**kind.recommended, "init_of_another_method": 0.5}
    monkeypatch.setattr(kind, "recommended", recommended)
    found = settings(strategy="mcmc")
    assert found.config.antialias is True
    assert "init_of_another_method" not in found.flat()
    said = "recommended by strategy mcmc: init_of_another_method=0.5, which method "
    assert any(note.startswith(said) for note in found.notes)


def test_a_method_keeps_its_own_sampler_where_a_strategy_recommends_another(monkeypatch):
    monkeypatch.setattr(AdcConfig, "recommended", {"sampler": "same-time"})

    def sampler(method: str, **typed: str) -> tuple[str, str]:
        values = {"method": method, "strategy": "adc", **typed}
        found = resolve(installed(), [Layer(COMMAND_LINE, values)])
        said = "; ".join(note for note in found.notes if "sampler" in note)
        return found.choices["sampler"].name, said

    own = (
        "recommended by strategy adc: sampler=same-time, but method dynamic3dgs has its own choice"
    )
    assert sampler("dynamic3dgs") == ("sequential", f"{own}, sampler=sequential.")
    assert sampler("4dgs") == ("same-time", "")
    assert sampler("dynamic3dgs", sampler="progressive") == ("progressive", "")


def test_a_method_may_bring_a_configured_strategy_of_its_own():
    found = settings(method="moving")
    assert found.choices["strategy"].name == "mcmc"
    assert found.flat()["strategy.cap"] == 77
    assert settings(method="moving", strategy="adc").choices["strategy"].name == "adc"


def test_a_presets_strategy_settings_are_for_the_strategy_it_was_made_for():
    found = settings(preset="fast", strategy="mcmc")
    assert found.sources["strategy.every"] == "method default x 0.2 (steps=6000)"
    assert settings(preset="fast", strategy="adc").flat()["strategy.every"] == 10


def test_a_preset_builds_on_the_default_one_whose_strategy_settings_stay_with_their_strategy():
    class Layered(FakePlugin):
        @hookimpl
        def gsfw_methods(self):
            return [self.spec("demo", Demo)]

    def flat(**typed: str) -> dict[str, object]:
        line = Layer(COMMAND_LINE, {"method": "demo", **typed})
        return resolve(registry_of(Layered()), [line]).flat()

    presets = {
        "default": {"strategy.every": 7, "limit": 0.5},
        "moved": {"strategy": "mcmc", "mode": "hard"},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Demo, "presets", presets)
        assert (flat()["strategy.every"], flat()["limit"]) == (7, 0.5)
        moved = flat(preset="moved")
        assert (moved["strategy"], moved["limit"], moved["mode"]) == ("mcmc", 0.5, "hard")
        assert moved["strategy.every"] != 7
        for preset in presets:
            assert flat(preset=preset, strategy="adc")["strategy.every"] == 7


def test_a_files_settings_of_a_strategy_go_when_the_command_line_chooses_another():
    file = Layer("config file a.yaml", {"strategy": "mcmc", "strategy.cap": 5})
    assert settings(file).flat()["strategy.cap"] == 5
    assert "strategy.cap" not in settings(file, strategy="adc").flat()


def test_settings_of_an_unnamed_strategy_hold_for_the_one_that_is_chosen():
    file = Layer("config file a.yaml", {"strategy.cap": 5})
    assert settings(file, strategy="mcmc").flat()["strategy.cap"] == 5


def test_steps_stretch_every_schedule_that_was_not_given():
    found = settings(steps="3000", strategy__until="2000")
    flat, sources = found.flat(), found.sources
    assert (flat["strategy.every"], flat["checkpoint_every"]) == (50, 500), "50 is the floor"
    assert sources["checkpoint_every"] == "method default x 0.1 (steps=3000)"
    assert flat["strategy.until"] == 2000, "given, so absolute"
    assert sources["strategy.until"] == "command line"
    assert flat["log_every"] == 10, "not counted in schedule steps"


def test_steps_stretch_schedules_upwards_too():
    assert settings(steps="60000").flat()["strategy.until"] == 30_000


def test_rescale_false_keeps_the_papers_absolute_steps():
    assert settings(steps="3000", rescale="false").flat()["strategy.until"] == 15_000


def test_a_setting_is_not_rescaled_below_what_may_be_given():
    @dataclass
    class Patient:
        wait: int = steps_field(500, at_least=20)
        every: int = steps_field(100, at_least=1, floor=50)

    assert step_settings(Patient()) == {"wait": (500, 20), "every": (100, 50)}


def test_a_floor_never_raises_a_setting():
    found = settings(steps="300", eval_every="0")
    assert found.flat()["eval_every"] == 0
    assert found.flat()["strategy.every"] == 50


def test_an_unknown_key_suggests_the_nearest():
    assert refusal(optim__spars="1") == (
        "unknown key 'optim.spars'. Did you mean 'optim.sparse'?\n"
        "All keys: gsfw train method=demo --help"
    )


def test_a_key_without_its_group_suggests_the_whole():
    assert "unknown key 'sparse'. Did you mean 'optim.sparse'?" in refusal(sparse="1")


def test_an_unknown_key_in_a_file_names_the_file():
    said = refusal(Layer("config file a.yaml", {"sead": 1}))
    assert said.startswith("config file a.yaml: unknown key 'sead'. Did you mean 'seed'?")


def test_a_key_of_another_strategy_says_whose_it_is():
    assert refusal(strategy__cap="5").startswith(
        "unknown key 'strategy.cap'. It belongs to strategy mcmc, but strategy=adc.\n"
    )


def test_a_value_of_the_wrong_type_says_what_was_expected_and_what_the_key_means():
    assert refusal(steps="abc") == (
        "steps=abc: expected a whole number, found 'abc'.\n"
        "steps: Training steps. Schedules follow in proportion, unless rescale=false."
    )
    assert refusal(Layer("config file a.yaml", {"limit": [1]})) == (
        "config file a.yaml: limit=1: expected a number or none, found '1'.\n"
        "limit: Largest scale; none for no limit."
    )


def test_an_unknown_strategy_and_preset_suggest_the_nearest():
    assert refusal(strategy="mcmcm") == (
        "no strategy 'mcmcm'. Did you mean 'mcmc'?\nInstalled: adc, mcmc."
    )
    assert refusal(preset="fats") == (
        "method 'demo' has no preset 'fats'. Did you mean 'fast'?\nPresets: default, fast, paper."
    )


def test_no_method_lists_what_is_installed():
    with pytest.raises(ConfigError) as caught:
        resolve(fake_registry(), [])
    assert str(caught.value) == ("no method is chosen.\nAdd method=NAME; installed: demo, moving.")


def test_a_plugin_whose_code_cannot_be_imported_is_named():
    class Broken:
        @hookimpl
        def gsfw_methods(self):
            return [Spec("lost", "", "no_such_module_of_gsfw:Config")]

    said = refusal(method="lost", registry=registry_of(FakePlugin(), Broken()))
    assert said == (
        "method 'lost' (pkg1 1.0) cannot be used: "
        "ModuleNotFoundError: No module named 'no_such_module_of_gsfw'.\n"
        "Install what it needs, or uninstall pkg1."
    )


def test_a_method_with_a_strategy_that_nobody_registered_is_told_to_its_author():
    class Lonely(FakePlugin):
        @hookimpl
        def gsfw_strategies(self):
            return [self.spec("adc", MethodConfig)]

    said = refusal(method="moving", registry=registry_of(Lonely()))
    assert said == (
        "method 'moving' has support.fake_parts:Move as its strategy, which is not registered.\n"
        "Its package (pkg0) has to register it through a hook."
    )


def test_rescaled_steps_of_a_preset_follow_the_length_and_plain_ones_do_not():
    class Stretched(FakePlugin):
        @hookimpl
        def gsfw_methods(self):
            return [self.spec("demo", Demo)]

    def found(**typed: str) -> Settings:
        line = Layer(COMMAND_LINE, {"method": "demo", **typed})
        return resolve(registry_of(Stretched()), [line])

    presets = {"default": {"strategy.until": Rescaled(5000), "strategy.every": 70}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Demo, "presets", presets)
        assert found().flat()["strategy.until"] == 5000
        short = found(steps="3000")
        assert (short.flat()["strategy.until"], short.flat()["strategy.every"]) == (500, 70)
        assert short.sources["strategy.until"] == "preset default x 0.1 (steps=3000)"
        assert found(steps="3000", rescale="false").flat()["strategy.until"] == 5000
        given = found(steps="3000", **{"strategy.until": "2000"})
        assert given.flat()["strategy.until"] == 2000, "what is given is absolute"


def test_a_key_of_another_method_names_the_methods_that_have_it():
    given = Layer(COMMAND_LINE, {"method": "4dgs", "ignore_time": "true"})
    with pytest.raises(ConfigError, match=r"It belongs to method 3dgs, but method=4dgs\."):
        resolve(installed(), [given])
