"""Recorded steps of strategies and methods whose steps are not all alike."""

import pytest
import torch
from support.masked_scene import HELD_OUT, write_masked_scene
from support.recorded_run import Run
from support.sampling import sampled
from support.states import assert_same_bits

from gsfw.core.loop.recordable import can_be_recorded
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.methods.gaussians3d.opacity_penalty import OpacityPenalty

MOVING = {
    **{"datamanager.moving": "true", "datamanager.times": "3", "datamanager.views": "6"},
    **{"hexplane.resolution": "8", "hexplane.channels": "8", "hexplane.width": "16"},
    **{"coarse_steps": "6", "squared_steps": "12", "method": "4dgs"},
}
SPACETIME = {
    **{name: value for name, value in MOVING.items() if name.startswith("datamanager")},
    **{"method": "spacetime", "squared_steps": "12"},
}
ROTOR = {**SPACETIME, "method": "4d-rotor", "neighbors_every": "7", "sampler.views_per_step": "2"}
TRACKED = {
    **{name: value for name, value in MOVING.items() if name.startswith("datamanager")},
    **{"method": "dynamic3dgs", "steps": "24", "sampler.first_steps": "10"},
    **{"strategy.refine_start": "2", "strategy.refine_every": "4", "strategy.refine_stop": "6"},
}
AUTO = {"static": "auto", "static_start": "4", "static_every": "5", "static_signal": "1.2"}
ADAPTIVE = {"motion": "adaptive", "motion_start": "8", "motion_every": "8"}
ERROR = {
    **{"strategy": "error", "strategy.views": "3", "strategy.agreeing_views": "1"},
    **{"strategy.refine_start": "5", "strategy.refine_every": "8"},
}
BANDS = {"sh": "adaptive", "bands.every": "8", "bands.grow_stop": "8", "bands.stop": "16"}

MASKS = "datamanager.maps=segmentation:masks:nearest"

CASES = {
    "error": ERROR,
    "bands": BANDS,
    "4dgs": MOVING,
    "spacetime": {**SPACETIME, "sampler.views_per_step": "2"},
    "4d-rotor": ROTOR,
    "dynamic3dgs": TRACKED,
    "spacetime-both": {**SPACETIME, **AUTO, **ADAPTIVE, "lifetime_reg": "0.01"},
    "4d-rotor-static": {**ROTOR, **AUTO, "rotation": "two-quaternions"},
    "dynamic3dgs-fixed": {
        **{**TRACKED, "colors": "fixed", "sampler.views_per_step": "1"},
        **{"neighbors": "5", "neighbors_per_step": "3"},
    },
    "4dgs-colors": {**MOVING, "deform_opacity": "false", "deform_sh": "true"},
    "4dgs-static": {**MOVING, **AUTO},
    "4dgs-hash": {**MOVING, "encoder": "hash"},
    "4dgs-mlp": {**MOVING, "encoder": "mlp", "scale_change": "sum"},
    "spacetime-static": {**SPACETIME, **AUTO},
    "spacetime-features": {**SPACETIME, **AUTO, "colors": "features"},
    "spacetime-adaptive": {**SPACETIME, **ADAPTIVE},
}
"""A strategy, bands, each method that is recorded, and then their variants."""

# Whole runs; shapes are checked by the tests of the parts.
pytestmark = [pytest.mark.unchecked, pytest.mark.usefixtures("unknown_to_the_host")]


def start_some(run):
    """Let a third of the static rows move, as a round of settling does."""
    model = run.parts.model
    rows = model.still.rows()[::3]
    model.start_(run.parts.table, rows, torch.full((len(rows),), 0.5))


def same_columns(one, other):
    """True if two runs have the same rows, bit for bit."""
    columns = other.columns()
    return all(torch.equal(values, columns[name]) for name, values in one.columns().items())


@pytest.mark.slow
@pytest.mark.parametrize("case", sampled([(name,) for name in CASES], [2]))
def test_recorded_steps_train_as_others_do(tmp_path, case):
    settings = CASES[case]
    usual = Run(tmp_path / "usual", False, **settings)
    recorded = Run(tmp_path / "recorded", True, **settings)
    expected, found = (run.steps(12) for run in (usual, recorded))
    if "static" in settings:
        start_some(usual)
        start_some(recorded)
    expected, found = expected + usual.steps(10), found + recorded.steps(10)
    assert found == expected
    assert same_columns(recorded, usual)
    assert recorded.recorder.recorded >= 2
    assert recorded.trainer.updates._graphs._replays > 5
    assert recorded.trainer.updates.skipped == 0


@pytest.mark.slow
def test_what_a_refiner_keeps_of_a_view_stays_that_of_its_view(tmp_path):
    settings = {**SPACETIME, "steps": "400", "squared_steps": "2", "strategy.guided.rounds": "2"}
    settings |= {"strategy.guided.start": "60", "strategy.guided.every": "50"}
    usual, recorded = (Run(tmp_path / str(part), part, **settings) for part in (False, True))
    usual.steps(14)
    recorded.steps(14)
    found, expected = (
        next(refiner for refiner in run.parts.refiners if refiner.name == "guided").state_dict()
        for run in (recorded, usual)
    )
    assert len({float(view["time"]) for view in expected["seen"].values()}) > 1
    assert_same_bits(found, expected)


@pytest.mark.slow
def test_recorded_steps_with_maps_train_as_others_do(tmp_path):
    data = write_masked_scene(tmp_path / "data")
    settings = {name: value for name, value in TRACKED.items() if not name.startswith("data")}
    held_out, maps = (text.split("=") for text in (HELD_OUT, MASKS))
    settings |= {**dict([held_out, maps]), "data": str(data), "datamanager.masks": "none"}
    usual = Run(tmp_path / "usual", False, **settings)
    recorded = Run(tmp_path / "recorded", True, **settings)
    assert usual.steps(22) == recorded.steps(22)
    assert same_columns(recorded, usual)
    assert "segmentation" in usual.columns()
    assert recorded.trainer.updates._graphs._replays > 5


@pytest.mark.parametrize("settings", [SPACETIME, {**SPACETIME, "method": "4d-rotor"}])
def test_a_model_that_selects_visible_rows_is_not_recorded(tmp_path, settings, monkeypatch):
    monkeypatch.setattr(CudaOperators, "fixed_shapes", False)
    known = {name: value for name, value in settings.items() if name != "squared_steps"}
    run = Run(tmp_path, True, **known)
    before = run.columns()["means"].clone()
    run.steps(5)
    assert run.recorder.recorded == 0
    assert not torch.equal(run.columns()["means"], before)


def test_steps_in_which_the_host_counts_views_are_not_recorded(tmp_path):
    run = Run(tmp_path, True, **ERROR)
    (growth,) = (refiner for refiner in run.parts.refiners if refiner.name == "error")
    counting = [step for step in range(16) if not can_be_recorded(growth, step)]
    assert counting == [5, 6, 7, 13, 14, 15]


def test_a_derived_refiner_has_to_promise_for_itself():
    class Other(OpacityPenalty):
        def regularizers(self, context):
            return {}

    class Promising(Other):
        def can_be_recorded(self, step):
            return step > 3

    assert can_be_recorded(OpacityPenalty(0.1), 0)
    assert not can_be_recorded(Other(0.1), 9)
    assert [can_be_recorded(Promising(0.1), step) for step in (3, 4)] == [False, True]
