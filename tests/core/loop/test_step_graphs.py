"""Steps that are recorded once and repeated; on the emulation, with a tape for a CUDA graph."""

import logging
from contextlib import contextmanager, nullcontext

import pytest
import torch
from support.recorded_run import Run
from support.tape import TapeLauncher, TapeRecorder

from gsfw.core.datamanager import Split
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.recordable import graph_key
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod

REFINING = {"strategy.refine_start": "5", "strategy.refine_every": "6"}

# Whole runs; shapes are checked by the tests of the parts.
pytestmark = [pytest.mark.unchecked, pytest.mark.usefixtures("unknown_to_the_host")]


def test_recorded_steps_train_as_others_do(tmp_path):
    usual = Run(tmp_path / "usual", False, **REFINING)
    recorded = Run(tmp_path / "recorded", True, **REFINING)
    expected, found = usual.steps(24), recorded.steps(24)
    assert found == expected
    for name, values in usual.columns().items():
        assert torch.equal(recorded.columns()[name], values), name
    assert len(recorded.parts.table) > 60
    # Rows are edited after steps 12, 18 and 24, and the degree rises after step 3: each time a step
    # is run as usual, and the next one is recorded.
    assert 3 <= recorded.recorder.recorded <= 6
    assert recorded.trainer.updates.skipped == 0


def test_views_pass_through_a_recording(tmp_path):
    run = Run(tmp_path, True, strategy="none", sh_degree_interval="1")
    seen = []
    for _ in range(12):
        views = run.trainer.walk.next_views(run.parts.sampler, run.trainer.step)
        (item,) = run.trainer.updates.run(run.trainer.plan, views, (), run.trainer.step)
        run.trainer.step += 1
        assert item.context.batch.views == views
        assert item.context.step == run.trainer.step - 1
        view = run.parts.data.load(Split.TRAIN, views, torch.device("cpu"))[0]
        expected = view.target(run.trainer.plan.settings.background)
        assert torch.equal(item.context.target, expected)
        seen.append(views[0])
    assert set(seen) == set(range(5))
    assert run.recorder.recorded == 1


def test_a_replay_is_no_state_between_steps_until_its_step_has_ended(tmp_path, monkeypatch):
    run = Run(tmp_path, True, strategy="none", sh_degree_interval="1")
    run.steps(3)
    assert run.recorder.recorded == 1
    assert not run.trainer.updates.is_underway
    seen = []
    observe = type(run.parts.refiners).observe

    def watched(self, *arguments):
        seen.append(run.trainer.updates.is_underway)
        observe(self, *arguments)

    monkeypatch.setattr(type(run.parts.refiners), "observe", watched)
    run.steps(1)
    assert seen == [True]


def test_a_step_without_room_changes_nothing_and_later_ones_have_it(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.core.loop.step_graphs.LOOK_EVERY", 1)
    run = Run(tmp_path, True, strategy="none", sh_degree_interval="1")
    run.steps(1)
    rooms = run.rasterizer._backend.rooms
    rooms._most = dict.fromkeys(rooms._most, 1)
    before = run.columns()["means"].clone()
    run.steps(1)
    assert torch.equal(run.columns()["means"], before)
    assert run.trainer.updates.skipped == 0
    run.steps(3)  # One to be told, one as usual, and one that is recorded with more room.
    assert rooms._most[40, 32] > 1
    before = run.columns()["means"].clone()
    run.steps(1)
    assert not torch.equal(run.columns()["means"], before)
    assert run.recorder.recorded == 2


def test_what_cannot_be_recorded_is_run_as_usual_and_told_once(tmp_path, caplog):
    run = Run(tmp_path, True, strategy="none")

    def refuse(work):
        run.rasterizer._backend.rooms._fitting.append(torch.tensor(False))
        raise RuntimeError("operation not permitted when stream is capturing\nmore")

    run.recorder.record = refuse
    with caplog.at_level(logging.WARNING):
        losses = run.steps(5)
    assert len(losses) == 5
    assert int(run.trainer.updates._graphs._misfits) == 0
    (record,) = caplog.records
    assert record.getMessage().endswith("operation not permitted when stream is capturing")


@pytest.mark.slow
@pytest.mark.parametrize("views", ["1", "2"])
def test_recorded_steps_learn_exposures_and_poses_as_others_do(tmp_path, views):
    settings = {"exposure": "true", "refine_poses": "true", "sampler.views_per_step": views}
    usual, recorded = (
        Run(tmp_path / str(part), part, strategy="none", **settings) for part in (False, True)
    )
    assert recorded.steps(12) == usual.steps(12)
    assert recorded.recorder.recorded == 2, "one for each degree"
    expected = usual.corrections()
    assert len(expected) == 2
    for name, values in recorded.corrections().items():
        assert torch.equal(values, expected[name]), name
        assert bool(values.any(dim=tuple(range(1, values.dim()))).all()), "every view has learnt"
    for name, values in recorded.columns().items():
        assert torch.equal(values, usual.columns()[name]), name


@pytest.mark.slow
def test_recorded_steps_leave_out_distractors_as_others_do(tmp_path):
    settings = {"ignore_distractors": "true", "distractors_start": "2", "sh_degree_interval": "1"}
    usual, recorded = (
        Run(tmp_path / str(part), part, strategy="none", **settings) for part in (False, True)
    )
    assert recorded.steps(14) == usual.steps(14)
    assert recorded.recorder.recorded == 2, "with and without distractors"
    for name, values in recorded.columns().items():
        assert torch.equal(values, usual.columns()[name]), name


def test_steps_of_sparse_updates_are_not_recorded(tmp_path, monkeypatch):
    monkeypatch.setattr(Optimizer, "sparse", True)
    run = Run(tmp_path, True)
    assert isinstance(run.trainer.updates.working(), nullcontext)
    run.steps(4)
    assert run.recorder.recorded == 0


@pytest.mark.parametrize("settings", [{"strategy": "mcmc"}, {"opacity_penalty": "0.01"}])
def test_terms_of_the_parameters_are_recorded(tmp_path, settings):
    run = Run(tmp_path, True, **settings)
    run.steps(3)
    assert run.recorder.recorded == 1


WAITING = {
    "a number": lambda values: int(values.sum()),
    "a truth": lambda values: bool(values.any()),
    "rows by a mask": lambda values: values[values > 0],
    "rows to write": lambda values: values.index_put_((values > 0,), torch.ones_like(values)[0]),
    "their number": lambda values: (values > 0).nonzero(),
    "a tensor of the CPU": lambda values: values + torch.ones(3),
    "numbers of the host": lambda values: values + torch.tensor([1.0, 2.0, 3.0], device="cpu"),
    "random numbers": lambda values: values.uniform_(generator=torch.Generator()),
}


@pytest.mark.parametrize("what", WAITING)
def test_the_tape_refuses_what_a_graph_cannot_have(what):
    values = torch.tensor([1.0, -1.0, 2.0])
    recorder = TapeRecorder(TapeLauncher(), lambda: [values])
    with pytest.raises(RuntimeError, match=r"host|device|generator"):
        recorder.record(lambda: WAITING[what](values))
    assert values.tolist() == [1.0, -1.0, 2.0]
    assert recorder.recorded == 0


class Unpromising(StaticGaussiansMethod):
    """Its losses may start kernels on the default stream."""

    def losses(self, context):
        return super().losses(context)


@pytest.mark.parametrize("promises", [True, False])
def test_runs_leave_the_default_stream_only_to_be_recorded(tmp_path, monkeypatch, promises):
    run = Run(tmp_path, True, strategy="none")
    stream = contextmanager(lambda: iter([None]))()
    monkeypatch.setattr(run.recorder, "working", lambda: stream)
    if not promises:
        run.parts.method.__class__ = Unpromising
    assert (run.trainer.updates.working() is stream) is promises


def test_a_derived_method_has_to_promise_for_itself():
    class Same(StaticGaussiansMethod):
        pass

    class Other(StaticGaussiansMethod):
        def losses(self, context):
            return {}

    class Promising(Other):
        def graph_key(self, step):
            return "mine"

    config = StaticGaussiansConfig()
    for kind, known in (
        (StaticGaussiansMethod, True),
        (Same, True),
        (Other, False),
        (Promising, True),
    ):
        method = kind(config)
        method._shared_degree = 0
        assert (graph_key(method, 0) is not None) is known
