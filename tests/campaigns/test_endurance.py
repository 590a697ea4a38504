"""The campaign of long runs finds leaks, other bits after a resume, and other figures."""

import json
import shutil
from dataclasses import replace

import endurance
import numpy as np
import pytest
import torch
from endurance import GAUSSIANS, LEAK_TEST, Found
from large_step import LargeStep
from long_runs import (
    MOST_DRIFT,
    Endured,
    Fault,
    Kind,
    endure,
    faults_of_evaluation,
    faults_of_other_processor,
    faults_of_resume,
    first_difference,
    other_instruction_set,
)
from memory_trace import Drift, drift
from training_runs import Judged, Verdict

SOUND = Endured(LEAK_TEST, Judged(Verdict.SURVIVED, ""), Drift(1.0, 1e8, 1e8), [])
LEAKING = replace(SOUND, drift=Drift(256.0, 1e8, 2e8))
FITS = LargeStep(GAUSSIANS, 6e9, 6.1e9)


def trace(slope: float) -> np.ndarray:
    """Memory of 300 lines with noise, and a checkpoint's peak in some."""
    steps = np.arange(100, 30_001, 100.0)
    noise = np.random.default_rng(0).normal(0, 1e4, len(steps))
    peaks = 5e7 * (steps % 5000 == 0)
    return np.stack([steps, 2e8 + slope * steps + noise + peaks + 1e7 * (steps < 9000)], 1)


def test_drift_is_found_beside_noise_peaks_and_growth_at_the_start():
    assert abs(drift(trace(0.0)).per_step) < 5
    jump = trace(0.0)
    jump[240:, 1] += 2e6
    assert abs(drift(jump).per_step) < 5
    assert drift(trace(256.0)).per_step == pytest.approx(256, abs=15)
    assert drift(trace(MOST_DRIFT)).high - drift(trace(MOST_DRIFT)).low == pytest.approx(
        MOST_DRIFT * 13_500, rel=0.1
    )


def test_the_first_difference_of_two_states_is_named():
    state = {"model": {"a": torch.zeros(3)}, "list": [1, (2, 3)], "train_seconds": 1.0}
    other = {"model": {"a": torch.zeros(3)}, "list": [1, (2, 3)], "train_seconds": 2.0}
    assert first_difference(state, other) == ""
    assert first_difference(state, {**other, "list": [1, (2, 4)]}) == "state.list[1][1]"
    assert first_difference(state, {**other, "model": {"a": torch.ones(3)}}) == "state.model.a"
    assert first_difference(state, {**other, "more": 1}) == "keys of state"


@pytest.mark.parametrize(
    ("kind", "broken"),
    [(Kind.MEMORY, 0), (Kind.RESULT, 1), (Kind.RESUME, 2), (Kind.PROCESSOR, 3),
     (Kind.EVALUATION, 4)],
)  # fmt: skip
def test_each_promise_is_broken_by_faults_of_its_kind(kind, broken):
    faulty = replace(SOUND, faults=[Fault(kind, "gsfw ended with exit code 1, and differs")])
    for found in (Found(SOUND, LEAKING, [SOUND, faulty], FITS), Found(faulty, LEAKING, [], FITS)):
        promises = endurance.outcome(found, 30_000).promises
        assert [index for index, each in enumerate(promises) if not each.holds] == [broken]


@pytest.mark.parametrize(
    ("found", "broken"),
    [
        (Found(SOUND, LEAKING, [SOUND], FITS), []),
        (Found(SOUND, SOUND, [SOUND], FITS), [0]),
        (Found(SOUND, LEAKING, [SOUND], replace(FITS, measured=9e9)), [5]),
        (Found(SOUND, LEAKING, [SOUND], replace(FITS, measured=0.0)), [5]),
    ],
)
def test_leaks_that_are_not_found_and_wrong_estimates_break_promises(found, broken):
    promises = endurance.outcome(found, 30_000).promises
    assert [index for index, each in enumerate(promises) if not each.holds] == broken


@pytest.mark.slow
def test_a_planted_leak_other_figures_and_other_bits_are_found(tmp_path):
    found = endure(LEAK_TEST, 150, 0, tmp_path, ("callbacks.memory_trace.leak=100000",))
    assert found.judged.verdict is Verdict.SURVIVED, found.judged.reason
    assert found.drift.per_step > 90_000
    (fault,) = found.faults
    assert fault.kind is Kind.MEMORY
    assert fault.text.startswith("memory grows by ")
    # A figure that is not the logged one, and a checkpoint from which another run goes on.
    run = tmp_path / "run"
    figures = json.loads((run / "metrics.json").read_text())
    (run / "metrics.json").write_text(json.dumps({**figures, "psnr": figures["psnr"] + 1e-9}))
    (fault,) = faults_of_evaluation(run, tmp_path)
    assert fault.startswith("gsfw eval has psnr=")
    shutil.rmtree(tmp_path / "again")
    if other_instruction_set():
        figures["psnr"] += 1.5
        (run / "metrics.json").write_text(json.dumps(figures))
        shutil.rmtree(tmp_path / f"again_{other_instruction_set()}")
        (fault,) = faults_of_other_processor(run, 150, tmp_path)
        assert "has PSNR" in fault
    middle = run / "checkpoints" / "step_000000120.pt"
    state = torch.load(middle, weights_only=True)
    name = next(iter(state["model"]))
    state["model"][name].view(-1)[0] += 1e-3
    torch.save(state, middle)
    (fault,) = faults_of_resume(run, 150, tmp_path)
    assert fault.startswith("gsfw resume from step_000000120.pt: state.")
