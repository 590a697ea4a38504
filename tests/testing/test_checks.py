"""Tests of gsfw.testing: outcomes, checks by name, and tests of pytest made of promises."""

import subprocess
import sys
from pathlib import Path

import pytest
from support.broken_parts import Plugin

from gsfw.core.errors import ConfigError
from gsfw.formats.ply import PlyExporter
from gsfw.plugins.registry import SLOTS
from gsfw.testing import (
    ConformanceError,
    Verdict,
    check_metric,
    check_sampler,
    conformance,
    find_subject,
    outcomes,
    parts_of,
    promises,
    subjects_named,
)
from gsfw.testing.callbacks import advice_after_a_stop

pytestmark = pytest.mark.unchecked

PAGE = Path(__file__).resolve().parents[2] / "docs" / "plugins" / "conformance.md"

test_conforms = conformance("metric", "psnr")
"""As a plugin's test file has it."""


def test_one_test_of_pytest_for_each_promise():
    (mark,) = test_conforms.pytestmark
    ids = [case.id for case in mark.args[1]]
    assert ids == [f"metric-psnr-{promise.name}" for promise in promises("metric")]


def test_a_broken_promise_tells_what_was_promised_what_happened_and_what_to_change():
    made = conformance("metric", "breaks-honours-valid", plugin=Plugin())
    subject = find_subject("metric", "breaks-honours-valid", plugin=Plugin())
    (promise,) = (item for item in promises("metric") if item.name == "honours-valid")
    with pytest.raises(AssertionError) as caught:
        made(subject, promise)
    lines = str(caught.value).splitlines()
    assert lines[0] == (
        "metric 'breaks-honours-valid' (Plugin) breaks the promise 'honours-valid'."
    )
    heads = [line.split(":")[0].strip() for line in lines[1:]]
    assert heads == ["promised", "happened", "change"]


def test_a_promise_that_does_not_concern_a_part_is_skipped():
    subject = find_subject("metric", "psnr")
    (promise,) = (item for item in promises("metric") if item.name == "settings-round-trip")
    with pytest.raises(pytest.skip.Exception, match="this metric has no settings"):
        test_conforms(subject, promise)


def test_an_error_of_a_part_is_told_with_its_line():
    subject = find_subject("importer", "breaks-recognises-never-raises", plugin=Plugin())
    found = {outcome.promise.name: outcome for outcome in outcomes(subject)}
    assert "FileNotFoundError" in found["recognises-never-raises"].happened or (
        "IsADirectoryError" in found["recognises-never-raises"].happened
    )


def test_nothing_else_is_checked_of_a_part_that_breaks_its_contract():
    subject = find_subject("metric", "breaks-fits-its-contract", plugin=Plugin())
    found = list(outcomes(subject))
    assert found[-1].promise.name == "fits-its-contract"
    assert found[-1].verdict is Verdict.BROKEN


def test_a_method_whose_calls_do_not_fit_is_told_once():
    subject = find_subject("method", "breaks-fits-its-contract", plugin=Plugin())
    last = list(outcomes(subject, ("fits-its-contract", "settings-survive-config-yaml")))[-1]
    assert last.promise.name == "fits-its-contract"
    assert "losses(self, context, extra) has to take the arguments" in last.happened
    (promise,) = (it for it in promises("method") if it.name == "settings-survive-config-yaml")
    outcome = promise.check(subject)  # As pytest does, which checks each promise by itself.
    assert "losses(self, context, extra) has to take the arguments" in outcome.happened
    assert "scene" not in outcome.happened + outcome.change


def test_a_refused_scene_is_told_once_with_the_cause_of_each():
    subject = find_subject("method", "needs-features", plugin=Plugin())
    names = ("settings-survive-config-yaml", "presets-resolve", "edits-keep-columns")
    found = {outcome.verdict: outcome for outcome in outcomes(subject, names)}
    told = (
        "it refuses the built-in scene. The static one: the data has no map. The moving one: meth"
    )
    assert found[Verdict.BROKEN].happened.startswith(told)
    assert "gsfw plugins check NAME data=PATH" in found[Verdict.BROKEN].change
    assert found[Verdict.NOT_APPLICABLE].happened.startswith("not checked: ")


def test_a_column_with_other_rows_from_the_start_is_named():
    subject = find_subject("method", "one-row-too-many", plugin=Plugin())
    (outcome,) = outcomes(subject, ("edits-keep-columns",))
    assert "column 'more' of StaticGaussians has 81 rows, expected 80" in outcome.happened


def test_the_remedy_for_a_stop_follows_what_was_raised():
    assert "summary.get" in advice_after_a_stop([KeyError("psnr")])
    assert "summary.get" not in advice_after_a_stop([ValueError("a shape")])
    assert "request_stop" in advice_after_a_stop([])


def test_a_check_by_name_returns_outcomes_or_names_all_that_is_broken():
    assert {outcome.verdict for outcome in check_sampler("uniform")} <= {
        Verdict.KEPT,
        Verdict.NOT_APPLICABLE,
    }
    with pytest.raises(ConformanceError, match="breaks the promise 'changes-no-image'"):
        check_metric("breaks-changes-no-image", plugin=Plugin())


def test_an_unknown_part_kind_or_plugin_is_named():
    with pytest.raises(ConfigError, match="Did you mean 'psnr'"):
        find_subject("metric", "psnrr")
    with pytest.raises(ConfigError, match="no kind 'metrics' of parts"):
        find_subject("metrics", "psnr")
    with pytest.raises(ConfigError, match="no part of a plugin 'gsfw-nothing' is registered"):
        parts_of("gsfw-nothing")


def test_a_name_stands_for_all_parts_that_have_it():
    assert [subject.slot for subject in subjects_named("ply")] == ["exporter", "importer"]
    assert [subject.name for subject in subjects_named("support.heavy_registration")] == ["heavy"]


def test_data_and_a_start_in_the_working_folder_break_no_promise(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "capture").mkdir()
    for name in ("capture/transforms.json", "start.ply"):
        (tmp_path / name).touch()
    subject = find_subject("method", "3dgs", data="capture", settings=["init=start.ply"])
    (outcome,) = outcomes(subject, ["settings-survive-config-yaml"])
    assert outcome.verdict is Verdict.KEPT, outcome


def test_options_of_an_exporter_are_tried_with_bad_values():
    (outcome,) = outcomes(find_subject("exporter", "mesh"), ["bad-values-are-refused"])
    assert outcome.verdict is Verdict.KEPT, outcome


def test_names_of_promises_are_unique_and_sentences_end():
    for slot in SLOTS:
        names = [promise.name for promise in promises(slot)]
        assert len(set(names)) == len(names)
        assert all(promise.sentence.rstrip(")").endswith(".") for promise in promises(slot))


def test_the_page_names_every_promise():
    text = PAGE.read_text()
    missing = [
        f"{slot}: {promise.name}"
        for slot in SLOTS
        for promise in promises(slot)
        if f"| `{promise.name}` | {promise.sentence}" not in text
    ]
    assert not missing


@pytest.mark.slow
def test_the_kit_needs_no_pytest():
    program = "import sys; import gsfw.testing; print('pytest' in sys.modules)"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "False", done.stderr


@pytest.mark.slow
def test_a_model_that_cannot_be_densified_renders_from_its_model_file(monkeypatch):
    monkeypatch.syspath_prepend(PAGE.parents[1] / "examples")
    subject = find_subject("method", "blobs", plugin="prototype_method")
    names = ("model-file-renders-the-same", "learns")
    assert {outcome.verdict for outcome in outcomes(subject, names)} == {Verdict.KEPT}


def test_an_exporter_that_needs_more_than_the_kit_has_breaks_no_promise(monkeypatch):
    def refuse(self, path, source):
        raise ValueError("the splats have no features.")

    monkeypatch.setattr(PlyExporter, "write", refuse)
    found = {item.promise.name: item for item in outcomes(find_subject("exporter", "ply"))}
    for name in ("writes-what-it-holds", "round-trips", "writes-the-world"):
        assert found[name].verdict is Verdict.NOT_APPLICABLE
        assert found[name].happened.endswith("the splats have no features.")
