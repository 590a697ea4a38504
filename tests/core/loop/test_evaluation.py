"""Evaluation: figures of all pixels, and of data with times also of what moves."""

import math
from dataclasses import replace

import pytest
import torch
from support.memory_training import parts_of
from support.moving_scene import WHITE, MovingImages, two_balls

from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import evaluate
from gsfw.core.loop.goal import Goal, mean_psnr
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.loop.verdict import Verdict
from gsfw.core.metrics import Psnr, Ssim, psnr
from gsfw.core.temporal_metrics.moving_region import UNKNOWN
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod

CPU = torch.device("cpu")
FIXED = [(0.0, 3.0), (0.5, 3.0), (1.0, 3.0)]


def parts_with(data, model, metrics) -> TrainingParts:
    """The parts of a run, of which an evaluation reads some."""
    return replace(parts_of(data, StaticGaussiansConfig().build(), model), metrics=metrics)


def run(data, model=None, split=Split.EVAL, on_view=None):
    metrics = {"psnr": Psnr(), "ssim": Ssim()}
    return evaluate(parts_with(data, model or two_balls(), metrics), WHITE, split, on_view)


def sampled(data, most):
    return evaluate(parts_with(data, two_balls(), {"psnr": Psnr()}), WHITE, most=most)


def test_the_truth_is_perfect_everywhere_and_does_not_flicker():
    found = run(MovingImages(FIXED))
    assert found.means == {
        "psnr": 100.0, "ssim": 1.0, "moving_psnr": 100.0, "moving_ssim": 1.0,
        "flicker_static": 0.0, "flicker_moving": 0.0,
    }  # fmt: skip


def test_a_method_gets_the_image_over_the_background_of_its_render():
    class Translucent(MovingImages):
        def load(self, split, indices, device):
            for batch in super().load(split, indices, device):
                yield replace(batch, alpha=torch.full_like(batch.images[..., :1], 0.25))

    class Measured(StaticGaussiansMethod):
        def view_metrics(self, context):
            own = psnr(context.rendered.color[0], context.target[0])
            return {"own": own, "extent": context.extent}

        def view_images(self, context):
            return {"target": context.target[0]}

    method, shown = Measured(StaticGaussiansConfig()), []
    parts = parts_with(Translucent([(0.0, 3.0)]), two_balls(), {"psnr": Psnr()})
    (figures,) = evaluate(parts, WHITE, on_view=shown.append, method=method).per_view
    assert figures["own"] == figures["psnr"]
    assert figures["extent"] == parts.data.scene.extent
    (view,) = shown
    assert torch.equal(view.images["target"], view.target)
    assert view.target.min() >= 0.75


def test_a_model_that_stands_still_fails_where_something_moves():
    data = MovingImages(FIXED)
    found = run(data, two_balls(velocity=0.0))
    first, _, last = found.per_view
    assert first["moving_psnr"] == 100.0
    assert last["moving_psnr"] < last["psnr"] - 3
    assert found.means["flicker_static"] < 0.01 < found.means["flicker_moving"]
    assert found.notes["moving_region"].startswith("temporal variance of all images of the same")
    assert found.notes["flicker"] == "2 pairs of neighbouring times, 0.5 apart on average"


def test_moving_figures_are_means_over_moving_pixels():
    mask = torch.zeros(24, 32, 1, dtype=torch.bool)
    mask[:12, 16:] = True
    data = MovingImages(FIXED, mask=mask)
    pictures = []
    found = run(data, two_balls(velocity=0.3), on_view=pictures.append)
    for view, shown in zip(found.per_view, pictures, strict=True):
        error = (shown.rendered.clamp(0, 1) - shown.target)[:12, 16:].double() ** 2
        expected = min(float(-10 * error.mean().log10()), 100.0)
        assert view["moving_psnr"] == pytest.approx(expected)
        assert view["psnr"] == psnr(shown.rendered, shown.target)


def test_pixels_that_are_not_valid_are_in_no_figure():
    valid = torch.ones(24, 32, 1, dtype=torch.bool)
    valid[:14] = False
    found = run(MovingImages(FIXED, valid=valid), two_balls(velocity=0.0))
    # All that moves is in the upper rows: nothing is left to measure it by.
    assert found.means["psnr"] == pytest.approx(100.0, abs=30.0)
    assert "moving_psnr" not in found.means
    assert "flicker_moving" not in found.means
    assert "flicker_static" in found.means


class HalfHidden(MovingImages):
    """Masks hide the first view of each split wholly, and no pixel of the others."""

    def load(self, split, indices, device):
        shown = torch.ones(1, 24, 32, 1, dtype=torch.bool)
        return [
            replace(batch, mask=torch.cat([shown * (view > 0) for view in batch.views]))
            for batch in super().load(split, indices, device)
        ]


def test_views_without_a_valid_pixel_are_in_no_mean():
    data = HalfHidden(FIXED)
    found = run(data, two_balls(velocity=0.3))
    assert (found.views, found.count) == (("eval_1", "eval_2"), "2 of 3")
    assert found.means["psnr"] < 40.0
    parts = parts_with(data, two_balls(velocity=0.3), {"psnr": Psnr()})
    plan = TrainingPlan(1, 1, 1, 1, WHITE)
    one = mean_psnr(parts, plan, 1, [1])
    assert mean_psnr(parts, plan, 1, [0, 1]) == one < 40.0
    assert math.isnan(mean_psnr(parts, plan, 1, [0]))
    assert not Goal(30.0).judge(100, math.nan)
    judged = Verdict(parts, plan, {}, Split.EVAL).judge(1, found)
    assert judged.training_psnr == pytest.approx(one)
    unseen = run(HalfHidden([(0.5, 3.0)]))
    assert (unseen.views, unseen.count, unseen.means) == ((), "0 of 1", {})


def test_the_curve_has_a_point_for_each_time_in_order():
    data = MovingImages([(1.0, 3.0), (0.0, 3.0), (0.25, 3.0), (1.0, 4.0)])
    curve = run(data, two_balls(velocity=0.2)).over_time
    assert [(point["time"], point["data_time"], point["views"]) for point in curve] == [
        (0.0, 10.0, 1), (0.25, 11.0, 1), (1.0, 14.0, 2),
    ]  # fmt: skip
    found = run(data, two_balls(velocity=0.2))
    both = (found.per_view[0]["psnr"] + found.per_view[3]["psnr"]) / 2
    assert curve[2]["psnr"] == pytest.approx(both)
    # The camera at distance 4 shows one time: its moving region is unknown, and not made up.
    assert curve[2]["moving_psnr"] == found.per_view[0]["moving_psnr"]


def test_figures_stay_with_their_views_whatever_order_they_are_drawn_in():
    shuffled = MovingImages([(1.0, 3.0), (0.0, 4.0), (0.0, 3.0), (1.0, 4.0)])
    found = run(shuffled, two_balls(velocity=0.1))
    sorted_moments = MovingImages([(0.0, 3.0), (1.0, 3.0), (0.0, 4.0), (1.0, 4.0)])
    wanted = run(sorted_moments, two_balls(velocity=0.1))
    assert [found.per_view[i] for i in (2, 0, 1, 3)] == list(wanted.per_view)
    # Neighbours in time are paired, not neighbours in name.
    assert found.means["flicker_moving"] == pytest.approx(wanted.means["flicker_moving"])
    assert found.views == ("eval_0", "eval_1", "eval_2", "eval_3")


def test_a_monocular_capture_says_that_there_is_no_moving_region():
    found = run(MovingImages([(0.0, 3.0), (0.5, 3.1), (1.0, 3.2)]))
    assert set(found.means) == {"psnr", "ssim"}
    document = found.document()
    assert document["moving_region"] == UNKNOWN
    assert document["flicker"] == "not available: no held-out camera shows several times"
    assert [point["psnr"] for point in document["over_time"]] == [100.0] * 3


def test_a_static_capture_has_none_of_this():
    found = run(MovingImages([(None, 3.0), (None, 3.5)], train=[(None, 4.0)]))
    assert set(found.document()) == {"psnr", "ssim", "render_ms", "per_view"}
    assert found.time_document() == {}


def test_a_sample_is_spread_over_the_views_and_says_of_how_many():
    data = MovingImages([(None, 3.0 + 0.01 * i) for i in range(20)], train=[(None, 4.0)])
    found = sampled(data, 5)
    assert found.views == ("eval_0", "eval_4", "eval_9", "eval_14", "eval_19")
    assert len(found.per_view) == 5
    assert found.count == "5 of 20"
    assert run(data).count == "20"


def test_a_sample_of_a_moving_scene_has_its_own_times_only():
    data = MovingImages([(i / 8, 3.0) for i in range(9)])
    found = sampled(data, 3)
    assert [point["time"] for point in found.over_time] == [0.0, 4 / 8, 8 / 8]
    assert found.notes["flicker"].startswith("2 pairs of neighbouring times, 0.5 apart")


def test_no_views_give_no_figures():
    found = run(MovingImages([]))
    assert (found.means, found.per_view, found.over_time) == ({}, (), ())
    assert found.render_ms == 0.0


def test_the_training_views_can_be_evaluated_too():
    found = run(MovingImages(FIXED), split=Split.TRAIN)
    assert found.views == ("train_0", "train_1")
    assert found.means["moving_psnr"] == 100.0


def test_a_render_of_one_colour_is_counted():
    hidden = two_balls()
    hidden.opacity_logits.values.data.fill_(-20.0)
    assert run(MovingImages(FIXED), hidden).one_color == 3
    assert run(MovingImages(FIXED)).one_color == 0
