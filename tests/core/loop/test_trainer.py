"""The loop: losses fall, resumed runs repeat bit for bit, broken steps are skipped and counted."""

from dataclasses import replace

import pytest
import torch
from support.memory_training import STRATEGIES, MemoryData, Recorder, trainer, with_parts
from support.sampling import sampled
from support.states import assert_same_bits, without_clock

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, TrainingError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.render_settings import Depth
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

# Whole trainings and scenes; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked


@pytest.mark.parametrize("strategy", sampled([(name,) for name in STRATEGIES], [0, 3, 4]))
def test_losses_fall_and_held_out_pictures_are_met(tmp_path, strategy):
    recorder = Recorder()
    run = trainer(tmp_path, strategy, recorder)
    if strategy == "none":
        run = with_parts(run, rasterizer=ReferenceRasterizer())
    summary = run.fit()
    losses = [report.losses["l1"] for report in recorder.reports]
    assert len(losses) == 60
    assert sum(losses[-6:]) < 0.5 * sum(losses[:6])
    assert summary["psnr"] > 18
    assert (summary["num_gaussians"] != 100) == (strategy != "none")
    assert summary["skipped_steps"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 7])
def test_reports_say_what_became_of_rows_since_the_last_one(tmp_path, every):
    recorder = Recorder()
    trainer(tmp_path, "adc", recorder, log_every=every).fit()
    rows = 100
    for report in recorder.reports:
        # A clone adds a row; a split puts two in the place of one.
        verbs = {verb: report.refined.get(verb, 0) for verb in ("cloned", "split", "pruned")}
        rows += verbs["cloned"] + verbs["split"] - verbs["pruned"]
        assert report.num_gaussians == rows
    assert rows != 100


@pytest.mark.slow
def test_no_evaluation_follows_a_reset_and_none_and_no_checkpoint_comes_just_before_the_end(
    tmp_path,
):
    recorder = Recorder()
    run = trainer(tmp_path, "adc", recorder, steps=58, eval_every=28, checkpoint_every=28)
    run.fit()
    # Opacities are reset after step 25; 56 is 2 steps before the end.
    assert recorder.evaluated == [24, 58]
    assert recorder.saved == [0, 28, 58]


def test_a_sample_is_evaluated_on_the_way_and_all_held_out_views_at_the_end(tmp_path):
    seen = []

    class Watcher(Recorder):
        def on_evaluation(self, step, evaluation, control) -> None:
            seen.append(evaluation.views)

    run = trainer(tmp_path, "none", Watcher(), steps=4, eval_every=2)
    run.plan = replace(run.plan, eval_views=1)
    run.fit()
    assert seen == [("e0",), ("e0", "e1")]


@pytest.mark.parametrize("strategy", ["adc", "error", "mcmc"])
def test_a_resumed_run_repeats_across_refinements_bit_for_bit(tmp_path, strategy):
    whole = trainer(tmp_path / "whole", strategy, Recorder(), steps=36)
    whole.fit()
    interrupted = trainer(tmp_path / "cut", strategy, Recorder(stop_at=23), steps=36)
    interrupted.fit()
    checkpoint = interrupted.folder.latest_checkpoint()
    assert checkpoint == interrupted.folder.checkpoint(23)
    recorder = Recorder()
    resumed = trainer(tmp_path / "cut", strategy, recorder, steps=36)
    resumed.load_state_dict(read_checkpoint(checkpoint))
    resumed.fit()
    assert recorder.reports[0].step == 24
    counts = {report.num_gaussians for report in recorder.reports}
    assert len(counts) > 1, "a refinement must lie behind the checkpoint"
    assert_same_bits(without_clock(resumed.state_dict()), without_clock(whole.state_dict()))


def test_the_same_seed_gives_the_same_bits_and_another_does_not(tmp_path):
    runs = [trainer(tmp_path / str(i), "mcmc", Recorder(), seed=seed, steps=12)
            for i, seed in enumerate([3, 3, 4])]  # fmt: skip
    for run in runs:
        run.fit()
    assert_same_bits(without_clock(runs[0].state_dict()), without_clock(runs[1].state_dict()))
    means = [run.parts.model.state_dict()["means.values"] for run in runs]
    assert means[0].shape != means[2].shape or not torch.equal(means[0], means[2])


@pytest.mark.parametrize("step", [0, 4])
def test_a_step_that_is_not_finite_is_skipped_and_counted(tmp_path, step):
    recorder = Recorder()
    run = trainer(tmp_path, "adc", recorder, poisoned=[step], steps=step + 1)
    before = trainer(tmp_path / "before", "adc", Recorder(), steps=step)
    before.fit()
    summary = run.fit()
    assert summary["skipped_steps"] == 1
    assert recorder.reports[-1].skipped_steps == 1
    assert_same_bits(dict(run.parts.model.state_dict()), dict(before.parts.model.state_dict()))
    moments = [one.parts.optimizer.state_dict()["moments"] for one in (run, before)]
    if step:  # The SH bands count steps in which they were not drawn.
        assert_same_bits(moments[0], moments[1])


def test_too_many_broken_steps_in_a_row_stop_the_run_with_advice(tmp_path):
    run = trainer(tmp_path, "adc", Recorder(), poisoned=range(7, 60), max_skipped=5)
    with pytest.raises(TrainingError) as caught:
        run.fit()
    assert str(caught.value) == (
        "5 steps in a row had a loss or gradient that is not finite; stopped at step 12. "
        "Loss terms that are not finite: poison.\n"
        f"The last good state is in {tmp_path / 'checkpoints'}. Try lower learning rates "
        "(optim.means_lr=...), or look for broken images or poses with gsfw info DATA."
    )
    checkpoint = RunFolder(tmp_path).latest_checkpoint()
    assert checkpoint is not None
    state = read_checkpoint(checkpoint)
    assert state["step"] == 12
    assert int(state["skipped"]) == 5


def test_broken_steps_that_are_not_in_a_row_do_not_stop_it(tmp_path):
    run = trainer(tmp_path, "none", Recorder(), poisoned=[2, 4, 6, 8], max_skipped=2, steps=10)
    assert run.fit()["skipped_steps"] == 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda terms: None, "Wrong: losses returned NoneType, expected scalar tensors by name."),
        (lambda terms: {}, "Wrong: losses returned no term."),
        (
            lambda terms: {"l1": terms["l1"].detach()},
            "Wrong: losses returned l1 without gradients.",
        ),
    ],
)
def test_losses_of_a_wrong_form_are_named_in_the_first_step(tmp_path, change, message):
    class Wrong(StaticGaussiansMethod):
        def losses(self, context):
            return change(super().losses(context))

    run = trainer(tmp_path, "none", Recorder(), steps=2)
    run = with_parts(run, method=Wrong(StaticGaussiansConfig(sh_degree=1)))
    with pytest.raises(ConfigError) as caught:
        run.fit()
    assert caught.value.message == message
    assert run.step == 0


def test_view_metrics_that_are_no_mapping_are_named(tmp_path):
    class Wrong(StaticGaussiansMethod):
        def view_metrics(self, context):
            return 3

    run = trainer(tmp_path, "none", Recorder(), steps=1)
    run = with_parts(run, method=Wrong(StaticGaussiansConfig(sh_degree=1)))
    with pytest.raises(ConfigError, match="Wrong: view_metrics returned int, expected numbers"):
        run.fit()


def test_own_figures_of_a_method_are_reported_on_logged_steps(tmp_path):
    class Measured(StaticGaussiansMethod):
        def step_metrics(self, context):
            assert not torch.is_grad_enabled()
            return {"at": context.step, "scale": float(context.splats.scales.mean())}

    recorder = Recorder()
    run = trainer(tmp_path, "none", recorder, steps=3)
    with_parts(run, method=Measured(StaticGaussiansConfig(sh_degree=1))).fit()
    assert [report.metrics["at"] for report in recorder.reports] == [
        report.step - 1 for report in recorder.reports
    ]
    assert all(report.metrics["scale"] > 0 for report in recorder.reports)


def test_step_metrics_that_are_no_numbers_are_named(tmp_path):
    class Wrong(StaticGaussiansMethod):
        def step_metrics(self, context):
            return {"scale": context.splats.scales}

    run = trainer(tmp_path, "none", Recorder(), steps=1)
    run = with_parts(run, method=Wrong(StaticGaussiansConfig(sh_degree=1)))
    with pytest.raises(ConfigError, match="Wrong: step_metrics returned Tensor for 'scale', exp"):
        run.fit()


def test_views_of_several_sizes_share_a_step(tmp_path):
    contexts = []

    class Watched(StaticGaussiansMethod):
        def losses(self, context):
            contexts.append(context)
            return super().losses(context)

    sizes = ((32, 24), (20, 28))
    run = trainer(tmp_path, "adc", Recorder(), views_per_step=4, sizes=sizes, steps=12)
    method = Watched(StaticGaussiansConfig(sh_degree=1))
    run = with_parts(run, method=method)
    run.fit()
    for step in range(12):
        batches = [context for context in contexts if context.step == step]
        assert sum(len(item.batch.views) for item in batches) == 4
        assert sum(item.share for item in batches) == 1.0
        assert {item.share for item in batches} <= {0.25, 0.5, 0.75, 1.0}


def test_a_method_may_change_render_settings_and_render_pseudo_views(tmp_path):
    seen = set()

    class Pseudo(StaticGaussiansMethod):
        def render_settings(self, settings, step):
            return replace(settings, depth=Depth.EXPECTED)

        def losses(self, context):
            cameras = context.batch.cameras.resized(8, 6)
            pseudo = context.render(cameras, None)
            assert pseudo.depth is not None, "the settings of the method hold for pseudo views too"
            seen.add((context.rendered.depth is not None, *pseudo.color.shape[1:3]))
            assert pseudo.statistics.screen_gradient is None
            return {**super().losses(context), "pseudo": 0.1 * pseudo.color.mean()}

    run = trainer(tmp_path, "adc", Recorder(), steps=6)
    run = with_parts(run, method=Pseudo(StaticGaussiansConfig(sh_degree=1)))
    run.fit()
    assert seen == {(True, 6, 8)}


def test_a_method_adds_its_own_metrics_and_images_to_the_evaluation(tmp_path):
    class Measured(StaticGaussiansMethod):
        def view_metrics(self, context):
            return {"mean_alpha": float(context.rendered.alpha.mean())}

        def view_images(self, context):
            return {"alpha": context.rendered.alpha[0].expand(-1, -1, 3)}

    class Watcher(Recorder):
        def on_view(self, step, view):
            shapes.append(view.images["alpha"].shape)

    shapes = []
    run = trainer(tmp_path, "none", Watcher(), steps=2)
    run = with_parts(run, method=Measured(StaticGaussiansConfig(sh_degree=1)))
    assert 0 < run.fit()["mean_alpha"] < 1
    assert shapes == [(24, 32, 3)] * 2


def test_the_model_is_in_training_mode_in_steps_alone(tmp_path):
    class Noted(StaticGaussiansMethod):
        def losses(self, context):
            training.append(self.model.training)
            return super().losses(context)

        def view_metrics(self, context):
            evaluated.append(self.model.training)
            return {}

    training, evaluated = [], []
    run = trainer(tmp_path, "none", Recorder(), steps=3)
    method = Noted(StaticGaussiansConfig(sh_degree=1))
    method.model = run.parts.model
    with_parts(run, method=method).fit()
    assert training == [True] * 3
    assert evaluated == [False] * 2


class Looking(Recorder):
    """Looks at the first image of each step, and renders the model from its camera."""

    def on_step(self, report, control) -> None:
        super().on_step(report, control)
        assert report.view.target.shape == report.view.rendered.shape == (24, 32, 3)
        assert not report.view.rendered.requires_grad
        output = report.model.render(MemoryData().views(Split.EVAL).cameras[0])
        assert not output.color.requires_grad
        assert len(report.model.splats().means) == report.num_gaussians


def test_a_callback_may_look_at_image_and_model_without_changing_a_bit(tmp_path):
    seen, plain = Looking(), Recorder()
    runs = [trainer(tmp_path / str(number), "adc", callback, steps=12, log_every=3)
            for number, callback in enumerate([seen, plain])]  # fmt: skip
    for run in runs:
        run.fit()
    assert [report.step for report in seen.reports] == [1, 3, 6, 9, 12], "it was not detached"
    assert seen.reports[0].view.name in MemoryData().views(Split.TRAIN).names
    assert_same_bits(without_clock(runs[0].state_dict()), without_clock(runs[1].state_dict()))
