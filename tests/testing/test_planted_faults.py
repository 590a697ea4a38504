"""The conformance kit notices a part that breaks one of its promises."""

from dataclasses import replace

import pytest
from support import broken_parts
from support.broken_parts import BROKEN

from gsfw.plugins.registry import SLOTS
from gsfw.testing import Verdict, find_subject, promises
from gsfw.testing.subject import registry_with

pytestmark = pytest.mark.unchecked

HERE = broken_parts.Plugin()

SLOW = ("method", "strategy", "callback", "rasterizer", "datamanager")
"""Kinds whose faults take a run or a scene to be seen."""

SHARED = {"registration-is-light", "states-its-api-range", "settings-survive-config-yaml"}
"""Promises with faults of their own, below, or (the last one) that another promise implies."""


def outcome_of(slot, promise_name):
    subject = find_subject(slot, f"breaks-{promise_name}", plugin=HERE)
    (promise,) = (item for item in promises(slot) if item.name == promise_name)
    if (slot, promise_name) == ("datamanager", "damaged-files-are-named"):
        subject.data = subject.workspace / "data"
        subject.data.mkdir()
        (subject.data / "poses.txt").write_text("1 2 3 4")
    return promise.check(subject)


def faults():
    return [
        pytest.param(*key, marks=[pytest.mark.slow] if key[0] in SLOW else [], id=": ".join(key))
        for key in BROKEN
    ]


@pytest.mark.parametrize(("slot", "promise"), faults())
def test_a_part_that_breaks_a_promise_is_found_out(slot, promise):
    outcome = outcome_of(slot, promise)
    assert outcome.verdict is Verdict.BROKEN, outcome
    assert outcome.happened
    assert outcome.change.endswith(".")


def test_an_error_after_a_step_that_is_not_finite_names_what_to_look_at():
    def raises(subject):
        raise RuntimeError("probability tensor contains either inf, nan or element < 0")

    (promise,) = (item for item in promises("strategy") if item.name == "not-finite-steps")
    outcome = replace(promise, function=raises).check(find_subject("strategy", "adc"))
    assert outcome.verdict is Verdict.BROKEN
    assert outcome.change.startswith("Look at what the refiner gathers in before_backward: images")


def test_every_promise_has_a_fault_that_breaks_it():
    shared = {"runs-with-", "extremes-of-"}
    everywhere = {promise for _, promise in BROKEN}
    missing = [
        f"{slot}: {promise.name}"
        for slot in SLOTS
        for promise in promises(slot)
        if (slot, promise.name) not in BROKEN
        and promise.name not in SHARED | everywhere
        and not promise.name.startswith(tuple(shared))
    ]
    assert not missing


@pytest.mark.slow
def test_a_registration_that_imports_torch_is_found_out():
    subject = find_subject("metric", "heavy", plugin="support.heavy_registration")
    (promise,) = (item for item in promises("metric") if item.name == "registration-is-light")
    outcome = promise.check(subject)
    assert outcome.verdict is Verdict.BROKEN
    assert "support.heavy_registration also imports torch" in outcome.happened


def test_a_plugin_that_is_not_installed_is_registered_besides_the_others():
    registry = registry_with(HERE)
    assert "breaks-honours-valid" in registry.slot("metric")
    assert "psnr" in registry.slot("metric")
