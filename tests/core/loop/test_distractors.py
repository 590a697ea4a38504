"""Distractors: what other photos contradict carries no loss; detail and changes of light do."""

from dataclasses import replace

import pytest
import torch
from support.memory_training import MemoryData, Recorder, trainer, with_parts
from support.scenes import front_camera
from support.states import assert_same_bits
from torch import Tensor

from gsfw.core.batch import Batch, MaskMode, Resampling, ViewMap
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop import training_parts
from gsfw.core.loop.corrections import CaptureCorrections
from gsfw.core.loop.distractors import Distractors, comparable, is_contradicted
from gsfw.core.loop.evaluation import Evaluation, evaluate
from gsfw.core.loop.exposures import Exposures
from gsfw.core.loop.findings import Evidence, Finding, judge
from gsfw.core.loop.goal import mean_psnr
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve

HEIGHT, WIDTH = 96, 128
FINDER = Distractors(start=0)


def scene(seed: int = 0):
    """A render and its image, which differ by fine detail that is not learnt yet."""
    random = torch.Generator().manual_seed(seed)
    rendered = torch.full((1, HEIGHT, WIDTH, 3), 0.5)
    return rendered, rendered + 0.3 * (torch.rand(rendered.shape, generator=random) - 0.5)


def rendering(color: Tensor, alpha: Tensor) -> RenderOutput:
    """A render without splats."""
    return RenderOutput(color, alpha, RenderStatistics.zeros(torch.zeros(0, 3), 1, frozenset()))


def test_a_thing_in_front_of_the_scene_is_found_and_nothing_else():
    rendered, target = scene()
    target[:, 30:60, 40:70] = torch.tensor([0.9, 0.2, 0.1])
    found = FINDER.found(rendered, target, None)
    assert found[:, 30:60, 40:70].all()
    assert found.sum() == 30 * 30


def test_fine_detail_that_is_not_learnt_yet_is_no_distractor():
    rendered, _ = scene()
    rows, columns = torch.arange(HEIGHT)[:, None], torch.arange(WIDTH)
    board = ((rows + columns) % 2).to(rendered.dtype)[None, :, :, None].expand_as(rendered)
    assert not FINDER.found(rendered, board, None).any()


def test_an_image_that_is_darker_or_altogether_different_is_used():
    rendered, target = scene()
    assert not FINDER.found(rendered, 0.5 * target, None).any()
    assert not FINDER.found(rendered, 1.0 - 0.2 * target, None).any()


def test_no_more_than_a_part_of_an_image_is_left_out():
    rendered, target = scene()
    target[:, :, :60] = torch.linspace(0.7, 1.0, HEIGHT)[:, None, None]
    share = FINDER.found(rendered, target, None).float().mean()
    assert 0.2 < share <= 0.47  # All cells above the threshold have it; the rest is the edge.


def test_pixels_outside_masks_and_uncovered_ones_are_not_left_out():
    rendered, target = scene()
    target[:, 30:60, 40:70] = 1.0
    valid = torch.ones(1, HEIGHT, WIDTH, 1, dtype=torch.bool)
    valid[:, :, 55:] = False
    alpha = torch.ones(1, HEIGHT, WIDTH, 1)
    alpha[:, 45:] = 0.5
    counted = comparable(alpha, None, valid)
    found = FINDER.found(rendered, target, counted)
    assert found.any()
    assert not found[:, :, 55:].any()
    assert not found[:, 45:].any()
    assert comparable(alpha, alpha, None) is None, "transparent images show empty space"


def test_a_render_that_is_not_finite_leaves_nothing_out():
    rendered, target = scene()
    assert not FINDER.found(rendered * torch.nan, target, None).any()
    target[:, 30:60, 40:70] = 1.0
    counted = torch.ones(1, HEIGHT, WIDTH, 1, dtype=torch.bool)
    counted[0, 40, 50] = False
    expected = FINDER.found(rendered, target, counted)
    rendered[0, 40, 50] = torch.nan
    assert torch.equal(FINDER.found(rendered, target, counted), expected), "it does not count"


def test_most_of_what_is_inside_a_mask_is_used_whatever_its_size():
    """Cells outside once made the usual difference 0: a wrong object was left out whole."""
    rendered, target = scene()
    inside = torch.zeros(1, HEIGHT, WIDTH, 1)
    inside[:, 20:60, 20:70] = 1.0
    output = rendering(rendered, torch.ones_like(inside))
    batch = Batch(target + 0.35, front_camera(WIDTH, HEIGHT), (0,), mask=inside > 0)
    assert not FINDER.without(batch, output, batch.images).left_out.any()
    target[:, 30:40, 30:46] = torch.tensor([0.9, 0.2, 0.1])
    found = FINDER.without(replace(batch, images=target), output, target).left_out
    assert found[:, 30:40, 30:46].all()
    assert found.sum() == 10 * 16


def test_figures_of_a_wrong_cut_out_count_it_whole():
    """Its empty space agrees: the figures once counted that alone, and were perfect."""
    rendered, target = scene()
    inside = torch.zeros(1, HEIGHT, WIDTH, 1)
    inside[:, 20:60, 20:70] = 1.0
    batch = Batch(target + 0.35, front_camera(WIDTH, HEIGHT), (0,), alpha=inside)
    image, output = batch.target(torch.zeros(3)), rendering(rendered * inside, inside)
    assert FINDER.without_some(batch, output, image) is batch
    image[:, 20:60, 20:70] = rendered[:, 20:60, 20:70]
    image[:, 30:40, 30:46] = torch.tensor([0.9, 0.2, 0.1])
    assert FINDER.without_some(batch, output, image).left_out.sum() == 10 * 16


def test_figures_count_a_whole_image_if_most_of_it_would_be_left_out(monkeypatch):
    inside = torch.zeros(1, HEIGHT, WIDTH, 1)
    inside[:, :60] = 1.0
    image = scene()[1]
    batch = Batch(image, front_camera(WIDTH, HEIGHT), (0,), mask=inside > 0)
    for rows, is_whole in ((23, False), (25, True)):  # Of the 60 rows that are valid.
        left_out = torch.zeros_like(inside, dtype=torch.bool)
        left_out[:, :rows] = True
        monkeypatch.setattr(Distractors, "found", lambda *_, left_out=left_out: left_out)
        found = FINDER.without_some(batch, rendering(image, inside), image)
        assert (found is batch) is is_whole


def test_each_view_is_used_whole_in_some_steps_after_the_start():
    finder = Distractors(start=40)
    assert not any(finder.are_left_out(step) for step in range(40))
    for view in range(12):
        uses = [finder.are_left_out(step) for step in range(48 + view, 2448, 12)]
        assert 0.6 < sum(uses) / len(uses) < 0.8


@pytest.mark.parametrize("mode", MaskMode)
def test_valid_pixels_are_those_of_masks_without_distractors(mode):
    batch = trainer_batch()
    left_out = torch.zeros_like(batch.images[..., :1], dtype=torch.bool)
    left_out[:, :4] = True
    mask = torch.ones_like(left_out)
    mask[:, :, :5] = False
    assert torch.equal(replace(batch, left_out=left_out).valid, ~left_out)
    both = replace(batch, mask=mask, mask_mode=mode, left_out=left_out)
    expected = mask & ~left_out if mode is MaskMode.IGNORE else ~left_out
    assert torch.equal(both.valid, expected)


def trainer_batch():
    (batch,) = MemoryData().load(Split.TRAIN, [0], torch.device("cpu"))
    return batch


def test_per_view_maps_are_unknown_where_distractors_are_left_out():
    batch = trainer_batch()
    depths = ViewMap.of(torch.full_like(batch.images[..., :1], 2.0), Resampling.DEPTH)
    rendered = rendering(batch.images, torch.ones_like(batch.images[..., :1]))
    found = UpperThird(start=0).without(
        replace(batch, maps={"depth": depths}), rendered, batch.images
    )
    seen = found.maps["depth"]
    assert not seen.known[:, :8].any()
    assert not seen.values[:, :8].any()
    assert torch.equal(seen.values[:, 8:], depths.values[:, 8:])
    assert seen.known[:, 8:].all()
    assert seen.rule is Resampling.DEPTH


class UpperThird(Distractors):
    """Finds the upper third of each image."""

    def found(self, rendered, target, counted, valid=None):
        third = torch.zeros_like(target[..., :1], dtype=torch.bool)
        third[:, : target.shape[1] // 3] = True
        return third


@pytest.mark.unchecked
def test_losses_and_reports_see_images_without_distractors(tmp_path):
    callback = Recorder()
    finder = UpperThird(start=2)
    run = with_parts(trainer(tmp_path, "adc", callback, steps=6), distractors=finder)
    seen = []
    losses = run.parts.method.losses

    def watched(context):
        seen.append(context.batch.valid)
        return losses(context)

    run.parts.method.losses = watched
    run.fit()
    used = [finder.are_left_out(step) for step in range(6)]
    assert 0 < sum(used) < 4, "some steps after the start use whole images"
    assert [valid is not None for valid in seen] == used
    reported = [report.view.left_out for report in callback.reports]
    assert [left_out is not None for left_out in reported] == [False, False, *[True] * 4]
    assert all(not bool(valid[:, :8].any()) for valid in seen if valid is not None)


@pytest.mark.unchecked
def test_a_run_goes_on_to_the_same_bits(tmp_path):
    def run(name, steps):
        made = trainer(tmp_path / name, "adc", Recorder(), steps=steps)
        return with_parts(made, distractors=UpperThird(start=2))

    whole, first, second = run("whole", 12), run("first", 6), run("second", 12)
    whole.fit()
    first.fit()
    second.load_state_dict(first.state_dict() | {"step": 6})
    second.fit()
    assert_same_bits(second.state_dict()["model"], whole.state_dict()["model"])


def test_moving_scenes_are_refused_with_the_remedy():
    given = {
        "method": "4dgs", "device": "cpu", "ignore_distractors": "true",
        "datamanager.moving": "true", "datamanager.views": "10", "datamanager.width": "32",
        "datamanager.height": "24", "datamanager.points": "20",
    }  # fmt: skip
    with pytest.raises(ConfigError, match="its motion is part of the scene"):
        compose(resolve(installed(), [Layer("the test", given)]), installed())


@pytest.mark.unchecked
def test_figures_of_a_run_count_the_pixels_that_are_kept(tmp_path):
    callback = Recorder()
    finder = UpperThird(start=2)
    run = with_parts(trainer(tmp_path, "none", callback, steps=6), distractors=finder)
    for pictures in run.parts.data.pictures.values():
        for picture in pictures:
            picture[:, :8] = 1.0 - picture[:, :8].round()
    summary = run.fit()
    whole = mean_psnr(run.parts, run.plan, 2, range(6))
    assert mean_psnr(run.parts, run.plan, 3, range(6)) == summary["training_psnr"]
    assert summary["training_psnr"] > whole + 3
    assert summary["kept_psnr"] > summary["psnr"] + 3
    assert "kept_psnr" not in evaluate(run.parts, run.plan.settings, step=2).means
    assert min(report.psnr for report in callback.reports[2:]) > whole + 3


@pytest.mark.unchecked
def test_an_image_of_which_no_pixel_is_kept_has_no_figure_of_kept_pixels(tmp_path, monkeypatch):
    run = with_parts(
        trainer(tmp_path, "none", Recorder(), steps=3), distractors=UpperThird(start=2)
    )
    usual = UpperThird.without_some

    def none_kept(self, batch, *seen):
        kept = usual(self, batch, *seen)
        return replace(kept, left_out=torch.ones_like(kept.left_out))

    monkeypatch.setattr(UpperThird, "without_some", none_kept)
    assert "kept_psnr" not in evaluate(run.parts, run.plan.settings, step=3).means


@pytest.mark.unchecked
def test_kept_pixels_of_held_out_images_are_compared_with_fitted_colours(tmp_path):
    run = with_parts(
        trainer(tmp_path, "none", Recorder(), steps=6), distractors=UpperThird(start=2)
    )
    for pictures in run.parts.data.pictures.values():
        for picture in pictures:
            picture[:, :8] = 1.0 - picture[:, :8].round()
    run.fit()
    exposures = Exposures(run.parts.data.views(Split.TRAIN).names, LearningRate(1e-3))
    exposed = replace(run.parts, corrections=CaptureCorrections(exposures))
    settings = run.plan.settings
    before = evaluate(exposed, settings, step=6).means
    assert before["kept_psnr"] >= evaluate(run.parts, settings, step=6).means["kept_psnr"]
    for picture in run.parts.data.pictures[Split.EVAL]:
        picture.mul_(0.5)  # Another exposure, which is no distractor.
    bare, fitted = (evaluate(parts, settings, step=6).means for parts in (run.parts, exposed))
    assert fitted["kept_psnr"] > before["kept_psnr"] - 1
    assert fitted["kept_psnr"] > bare["kept_psnr"] + 3


def test_distractors_of_held_out_images_are_no_overfitting():
    scene = MemoryData().scene
    views = Evaluation(("a",), ({},), 0.0, {"psnr": 17.0, "kept_psnr": 27.0}, training_psnr=30.0)
    assert not judge(Evidence(views, scene, {}, 500, completed=True))
    whole = replace(views, means={"psnr": 17.0})
    (overfitting,) = judge(Evidence(whole, scene, {}, 500, completed=True))
    assert overfitting.key == "overfitting"
    assert "held-out views 17.0 dB: " in overfitting.message
    kept = replace(views, training_psnr=40.0)
    (overfitting,) = judge(Evidence(kept, scene, {}, 500, completed=True))
    assert "held-out views 27.0 dB in the pixels that are kept: " in overfitting.message


def shown(rendered: Tensor, target: Tensor, alpha: float = 1.0) -> bool:
    """True if the image is contradicted by an opaque render."""
    output = rendering(rendered, torch.full_like(rendered[..., :1], alpha))
    return is_contradicted(Batch(target, front_camera(WIDTH, HEIGHT), (0,)), output, target)


@pytest.mark.parametrize(
    ("height", "color", "alpha", "expected"),
    [
        (30, (0.9, 0.2, 0.1), 1.0, True),
        (6, (0.9, 0.2, 0.1), 1.0, False),  # Small.
        (30, (0.65, 0.35, 0.65), 1.0, False),  # Faint.
        (30, (0.9, 0.2, 0.1), 0.5, False),  # Not learnt yet.
    ],
)
def test_an_image_with_one_large_thing_of_other_colours_is_contradicted(
    height, color, alpha, expected
):
    rendered, target = scene()
    assert not shown(rendered, target)
    target[:, 30 : 30 + height, 40:70] = torch.tensor(color)
    assert shown(rendered, target, alpha) is expected


def test_a_hole_in_the_render_of_a_cut_out_is_no_contradiction():
    rendered, target = scene()
    covered, learnt = torch.ones(1, HEIGHT, WIDTH, 1), torch.ones(1, HEIGHT, WIDTH, 1)
    covered[:, :, :30] = learnt[:, :, :30] = learnt[:, 40:60, 60:85] = 0.0
    rendered = rendered * learnt + 1.0 - learnt
    camera = front_camera(WIDTH, HEIGHT)
    batch = Batch(target, camera, (0,), alpha=covered)
    image = batch.target(torch.ones(3))
    assert not is_contradicted(batch, rendering(rendered, learnt), image)
    assert is_contradicted(batch, rendering(rendered, covered), image), "a white thing"


class Looker(Recorder):
    """Remembers the last evaluation."""

    def on_evaluation(self, step, evaluation, control) -> None:
        self.evaluation = evaluation


@pytest.mark.unchecked
@pytest.mark.parametrize("distractors", [None, Distractors(start=0)])
def test_a_run_that_leaves_nothing_out_names_contradicted_images(
    tmp_path, monkeypatch, distractors
):
    monkeypatch.setattr(training_parts, "is_contradicted", lambda *seen: bool(seen[2].min() == 1))
    look = Looker()
    run = with_parts(trainer(tmp_path, "none", look, steps=1), distractors=distractors)
    pictures = run.parts.data.pictures
    for picture in (pictures[Split.TRAIN][0], pictures[Split.TRAIN][3], pictures[Split.EVAL][1]):
        picture.fill_(1.0)
    run.fit()
    assert look.evaluation.contradicted == (() if distractors else ("e1", "t0", "t3"))
    views = sum(len(run.parts.data.views(split)) for split in Split)
    assert look.evaluation.searched == (0 if distractors else views)


@pytest.mark.unchecked
def test_exposures_that_are_learnt_are_no_contradiction(tmp_path):
    run = trainer(tmp_path, "none", Recorder(), steps=1)
    exposures = Exposures(run.parts.data.views(Split.TRAIN).names, LearningRate(1e-3))
    room, window = torch.full((1, HEIGHT, WIDTH, 3), 0.1), torch.full((1, 30, 40, 3), 0.95)
    room[:, 20:50, 50:90] = window
    darker = Batch(0.6 * room, front_camera(WIDTH, HEIGHT), (2,))
    exposures.changes.data[2, :, :3] = -0.4 * torch.eye(3)
    seen = darker, rendering(room, torch.ones_like(room[..., :1])), torch.zeros(3), Split.TRAIN
    assert run.parts.seeks_contradictions(Split.EVAL)
    assert run.parts.contradicts(*seen)
    parts = with_parts(run, corrections=CaptureCorrections(exposures)).parts
    assert not parts.contradicts(*seen)
    assert parts.seeks_contradictions(Split.TRAIN)
    assert not parts.seeks_contradictions(Split.EVAL), "their exposures are unknown"
    for corrections, is_left_out in ((CaptureCorrections(), True), (parts.corrections, False)):
        seeking = with_parts(run, corrections=corrections, distractors=FINDER).parts
        kept = seeking.compared(*seen[:3], 1, Split.EVAL)
        assert bool(kept.left_out.any()) == is_left_out


def test_contradicted_images_are_a_finding_unless_it_is_one_or_nothing_is_learnt():
    def found(
        names: tuple[str, ...],
        psnr: float = 27.0,
        completed: bool = True,
        step: int = 500,
        searched: int = 40,
        **others: float,
    ) -> tuple[Finding, ...]:
        views = Evaluation(("a",), ({},), 0.0, {"psnr": psnr}, contradicted=names)
        views = replace(views, baselines={"constant_psnr": 12.0}, searched=searched, **others)
        return judge(
            Evidence(views, MemoryData().scene, {"data": "shop"}, step, completed=completed)
        )

    (finding,) = found(("a.jpg", "b.jpg"))
    assert (finding.key, finding.is_collapse) == ("distractors", False)
    assert finding.message == (
        "2 of 40 compared images show something large that the other images contradict (a.jpg, "
        "b.jpg). Likely cause: people, cars or other things that moved between the photos; else "
        "their exposure or light differs, or those cameras are misplaced. Try, one by one: "
        "ignore_distractors=true; masks (datamanager.masks=DIR); exposure=true; gsfw check shop, "
        "for cameras that do not fit."
    )
    assert "(1, 2, 3, 4, 5 and 2 more)" in found(tuple("1234567"))[0].message
    assert found(("a.jpg",)) == ()
    assert found(("a.jpg", "b.jpg"), searched=41) == ()
    assert [item.key for item in found(("a", "b"), training_psnr=38.0)] == ["overfitting"]
    assert found(("a.jpg", "b.jpg"), completed=False) == ()
    assert found(("a.jpg", "b.jpg"), step=299) == ()
    assert [item.key for item in found(("a.jpg", "b.jpg"), 12.1)] == ["no-better-than-baseline"]
