"""Tests of gsfw.plugins.config_file."""

import pytest
import yaml
from support.fake_parts import FakePlugin, fake_registry, registry_of

from gsfw.core.errors import ConfigError
from gsfw.planning.asked import without
from gsfw.plugins.config_file import read_config, write_config
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve


def refusal(path) -> str:
    with pytest.raises(ConfigError) as caught:
        read_config(path)
    return str(caught.value)


def test_a_written_file_reproduces_the_settings_and_only_the_folder_is_new(tmp_path):
    typed = {
        "method": "demo", "strategy": "mcmc", "steps": "7000", "limit": "inf", "out": "there",
        "holdout": "007,null,yes", "shape": "1,2e-9,3",
    }  # fmt: skip
    settings = resolve(fake_registry(), [Layer(COMMAND_LINE, typed)])
    path = tmp_path / "config.yaml"
    path.write_text(write_config(settings, ["train", "method=demo", "data=a b"]))
    again = resolve(fake_registry(), [read_config(path)])
    expected = {**settings.flat(), "out": ""}
    assert again.flat() == expected
    assert again.sources["out"] == "method default"
    assert again.sources["strategy.until"] == settings.sources["strategy.until"]
    exactly = resolve(fake_registry(), [read_config(path, everything=True)])
    assert exactly.flat() == expected
    assert set(exactly.sources.values()) == {f"config file {path}", "method default"}
    assert exactly.given == again.given == tuple(key for key in settings.given if key != "out")


def rerun(tmp_path, first: dict[str, str], **change: str) -> tuple[Settings, Settings]:
    """Settings of a run, and of one with its config.yaml and a change."""
    settings = resolve(fake_registry(), [Layer(COMMAND_LINE, {"method": "demo", **first})])
    path = tmp_path / "config.yaml"
    path.write_text(write_config(settings, []))
    return settings, resolve(fake_registry(), [read_config(path), Layer(COMMAND_LINE, change)])


@pytest.mark.parametrize(
    "first",
    [
        {},
        {"preset": "fast"},
        {"preset": "fast", "strategy": "mcmc", "strategy.cap": "5"},
        {"steps": "7000", "strategy.until": "100", "rasterizer": "slow", "rasterizer.tile": "8"},
        {"strategy": "auto", "device": "auto", "seed": "3"},
    ],
)
def test_a_runs_file_alone_reproduces_its_settings(tmp_path, first):
    settings, again = rerun(tmp_path, first)
    assert again.flat() == settings.flat()
    assert (again.given, again.preset) == (settings.given, settings.preset)


def test_only_what_someone_chose_is_given(tmp_path):
    settings, _ = rerun(tmp_path, {"seed": "3", "device": "auto", "antialias": "true"})
    assert set(settings.given) == {"method", "seed", "antialias"}
    settings, _ = rerun(tmp_path, {"strategy.until": "100"})
    assert settings.given == ("method", "strategy", "strategy.until"), "named with its settings"


def test_a_runs_file_with_other_steps_rescales_its_schedules(tmp_path):
    first, again = rerun(tmp_path, {"strategy.every": "77"}, steps="3000")
    assert again.sources["strategy.until"] == "method default x 0.1 (steps=3000)"
    assert again.flat()["strategy.until"] == first.flat()["strategy.until"] / 10
    assert again.flat()["strategy.every"] == 77


def test_a_runs_file_with_another_strategy_takes_what_that_recommends(tmp_path):
    first, again = rerun(tmp_path, {"strategy.every": "77"}, strategy="mcmc")
    assert (first.config.antialias, again.config.antialias) == (False, True)
    assert again.sources["antialias"] == "recommended by strategy mcmc"


def test_a_runs_preset_is_still_below_what_was_given(tmp_path):
    _, again = rerun(tmp_path, {"preset": "fast"}, strategy="mcmc", seed="4")
    assert again.config.steps == 6000
    assert again.sources["steps"] == "preset fast"
    assert again.sources["strategy.every"] == "method default x 0.2 (steps=6000)"


def test_a_file_names_as_given_only_keys_that_it_has(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("given: [seed, steps]\nseed: 1\n")
    assert refusal(path) == (
        f"config file {path}: given has 'steps', which has no value in this file.\n"
        "Add the value, or take the name away."
    )
    path.write_text("given: seed\nseed: 1\n")
    assert refusal(path) == f"config file {path}: given: expected a list of keys, found 'seed'."
    path.write_text("given: [seed]\nseed: 1\nsteps: 2\nminutes: 0.0\n")
    assert read_config(path).values == {"seed": 1}
    everything = {"seed": 1, "steps": 2, "minutes": 0.0}
    assert read_config(path, everything=True).values == everything


def test_what_a_plan_decided_is_named_and_repeated(tmp_path):
    plan = {"seed": "7", "steps": "300"}
    layers = [
        Layer(COMMAND_LINE, {"method": "demo", "antialias": "true"}),
        Layer("the plan", plan, given=frozenset(plan), planned=frozenset(plan)),
    ]
    path = tmp_path / "config.yaml"
    path.write_text(write_config(resolve(fake_registry(), layers), ["train", "minutes=2"]))
    assert set(yaml.safe_load(path.read_text())["planned"]) == {"seed", "steps"}
    again = resolve(fake_registry(), [read_config(path)])
    assert (again.config.seed, again.config.steps) == (7, 300)
    assert set(again.planned) == {"seed", "steps"}
    assert {"antialias", "seed", "steps"} <= set(again.given)
    changed = Layer(COMMAND_LINE, {"seed": "8"})
    assert set(resolve(fake_registry(), [read_config(path), changed]).planned) == {"steps"}


@pytest.mark.parametrize("chosen", [{}, {"strategy.until": "90"}])
def test_a_strategy_is_planned_that_is_named_for_planned_values_alone(tmp_path, chosen):
    plan = {"strategy.every": "7"}
    layers = [
        Layer(COMMAND_LINE, {"method": "demo", **chosen}),
        Layer("the plan", plan, given=frozenset(plan), planned=frozenset(plan)),
    ]
    path = tmp_path / "config.yaml"
    path.write_text(write_config(resolve(fake_registry(), layers), ["train", "minutes=2"]))
    again = read_config(path)
    assert again.gives("strategy")
    assert again.planned == {"strategy.every", *([] if chosen else ["strategy"])}
    anew = resolve(fake_registry(), [without(again, again.planned)])
    assert ("strategy" in anew.given) == bool(chosen), "free for another plan"


def test_a_run_of_before_minutes_existed_repeats_with_its_steps(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("given: [seed]\nseed: 1\nsteps: 30000\nsh_degree: 2\n")
    assert read_config(path).values == {"seed": 1, "steps": 30000}


RATES = "optim.means_lr: 1.6e-4\noptim.sh_dc_lr: 2.5e-3\n"


@pytest.mark.parametrize("everything", [True, False])
def test_a_run_of_before_rates_followed_its_length_keeps_its_rates(tmp_path, everything):
    path = tmp_path / "config.yaml"
    path.write_text(f"given: [seed]\nseed: 1\nsteps: 100\n{RATES}")
    layer = read_config(path, everything)
    assert layer.values["optim.factor"] == 1.0
    assert layer.gives("optim.factor")
    path.write_text(f"given: [seed]\nseed: 1\n{RATES}optim.factor: auto\n")
    assert read_config(path, everything).values.get("optim.factor") in (None, "auto")
    path.write_text("given: [seed]\nseed: 1\n")
    assert "optim.factor" not in read_config(path, everything).values


@pytest.mark.parametrize("everything", [True, False])
def test_a_run_of_before_rates_cooled_down_keeps_its_rates(tmp_path, everything):
    path = tmp_path / "config.yaml"
    path.write_text("given: [seed]\nseed: 1\noptim.sparse: false\n")
    assert read_config(path, everything).values["optim.cooldown"] == 0.0
    assert read_config(path, everything).gives("optim.cooldown")
    path.write_text("given: []\noptim.sparse: false\noptim.cooldown: 0.3\n")
    assert read_config(path, everything).values.get("optim.cooldown") in (None, 0.3)


@pytest.mark.parametrize("everything", [True, False])
def test_a_run_of_before_paths_had_a_factor_keeps_all_of_its_rates(tmp_path, everything):
    path = tmp_path / "config.yaml"
    old = "optim.motion_lr: 3.0e-4\noptim.opacities_lr: 0.05\noptim.factor: 1.0\n"
    path.write_text(f"given: [seed]\nseed: 1\noptim.cooldown: 0.0\nsh_degree: 2\n{old}")
    layer = read_config(path, everything)
    rates = {key: layer.values[key] for key in layer.values if key.startswith("optim.")}
    assert rates == {
        "optim.motion_lr": 3e-4, "optim.motion_factor": 1.0, "optim.opacities_lr": 0.05,
        "optim.factor": 1.0, "optim.cooldown": 0.0,
    }  # fmt: skip
    assert all(layer.gives(key) for key in rates)
    assert not layer.gives("sh_degree")


def test_a_start_is_not_taken_for_a_folder_of_its_name(tmp_path, monkeypatch):
    (tmp_path / "dense").mkdir()
    monkeypatch.chdir(tmp_path)
    settings = resolve(
        registry_of(FakePlugin()), [Layer(COMMAND_LINE, {"method": "demo", "init": "dense"})]
    )
    assert yaml.safe_load(write_config(settings, []))["init"] == "dense"


def test_the_file_is_plain_data_and_says_where_it_comes_from(tmp_path):
    settings = resolve(registry_of(FakePlugin()), [Layer(COMMAND_LINE, {"method": "demo"})])
    text = write_config(settings, ["train", "method=demo", "data=a b"])
    document = yaml.safe_load(text)
    assert document["schema"] == 1
    assert document["command line"] == "gsfw train method=demo 'data=a b'"
    assert document["plugins"] == ["pkg0 1.0"]
    assert {"gsfw", "torch", "python"} <= document.keys()
    assert "!!" not in text


def test_the_data_is_saved_as_an_absolute_path(tmp_path, monkeypatch):
    (tmp_path / "fruit").mkdir()
    (tmp_path / "fruit" / "apples.txt").touch()
    monkeypatch.chdir(tmp_path)
    typed = {"method": "demo", "data": "fruit"}
    settings = resolve(fake_registry(), [Layer(COMMAND_LINE, typed)])
    document = yaml.safe_load(write_config(settings, []))
    assert document["data"] == str(tmp_path / "fruit")
    assert document["init"] == "auto"


def test_nested_mappings_are_dotted_keys(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("method: demo\nstrategy: mcmc\noptim:\n  sparse: true\n")
    assert read_config(path).values == {
        "method": "demo", "strategy": "mcmc", "optim.sparse": True,
    }  # fmt: skip


def test_an_empty_file_is_no_settings(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("# nothing\n")
    assert read_config(path).values == {}


def test_a_missing_file_and_one_that_is_no_mapping_are_refused(tmp_path):
    path = tmp_path / "a.yaml"
    assert refusal(path) == f"config={path}: there is no such file."
    path.write_text("- a\n- b\n")
    assert refusal(path) == f"config file {path}: expected 'key: value' on each line, found list."
    path.write_text("a: [1\n")
    assert refusal(path).startswith(f"config file {path}: this is not valid YAML: ")


def test_python_objects_are_never_made(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("seed: !!python/object/apply:os.getpid []\n")
    assert "this is not valid YAML" in refusal(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("given: [[method]]\nmethod: demo\n", "given has ['method'], which has no value"),
        ("given: [{a: 1}]\nmethod: demo\n", "given has {'a': 1}, which has no value"),
        ("a: &a {b: *a}\n", "it is nested more than 100 levels deep"),
        ("when: 2001-99-99\n", "month must be in"),
    ],
)
def test_content_that_is_none_of_settings_is_refused(tmp_path, text, words):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    assert words in refusal(path)


def test_a_newer_schema_is_refused_with_a_sentence(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("schema: 2\ngsfw: 9.0.0\nmethod: demo\n")
    assert refusal(path) == (
        f"config file {path}: expected schema 1, found 2.\n"
        "It was written by gsfw 9.0.0; this is 0.1.0. Use that version to read it."
    )
