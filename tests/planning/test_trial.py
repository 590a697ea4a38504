"""A trial measures the steps of a run, with the work of a GPU that they start."""

import math

import pytest
from support.small_scene import SMALL_SCENE

from gsfw.planning import trial
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve

# A training of a few steps; the tests of its parts check shapes.
pytestmark = pytest.mark.unchecked


def composed() -> Composition:
    values = {**dict(item.split("=") for item in SMALL_SCENE), "method": "3dgs", "device": "cpu"}
    return compose(resolve(installed(), [Layer("the test", values)]), installed())


def test_steps_renders_and_images_are_measured_until_the_device_has_finished(monkeypatch):
    waits = []
    monkeypatch.setattr(trial, "wait_for", lambda device: waits.append(device.type))
    composition = composed()
    trial.seconds_to_load(composition)
    assert waits == ["cpu"]
    waits.clear()
    found = trial.try_steps(composition, seconds=0.0)
    # Each step, and the moments before and after the render that is measured.
    assert len(waits) == trial.STEPS + 2
    assert found.rows == composition.parts.model.num_rows


def test_a_step_is_measured_when_a_run_has_settled(monkeypatch):
    clock = trial._Clock(0.0, math.inf, composed().parts.device)
    durations = [9.0, 5.0, 1.0, 2.0, 1.0, 2.0, 1.0]
    moments = iter([0.0, *(sum(durations[: place + 1]) for place in range(len(durations)))])
    monkeypatch.setattr(trial.time, "perf_counter", lambda: next(moments))
    clock.on_start(None, None)
    for step in range(len(durations)):
        clock.on_tick(-1 - step, None)
    assert clock.durations == durations
    assert clock.settled() == 1.5


def test_a_trial_of_slow_steps_ends_beyond_its_bound_but_not_with_its_first_step(monkeypatch):
    waits = []
    monkeypatch.setattr(trial, "wait_for", lambda device: waits.append(device.type))
    trial.try_steps(composed(), seconds=1.0, most=0.0)
    assert len(waits) == 2 + 2  # Of steps, and around an evaluated view.
