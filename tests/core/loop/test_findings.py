"""Findings: what is not sound is said with cause and remedy, and what is sound is not."""

from dataclasses import replace

import pytest
import torch

from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.findings import Evidence, judge
from gsfw.core.scene import Scene

POINTS = torch.zeros(0, 3)
SETTINGS = {
    "data": "horse", "steps": 800, "squared_steps": 0, "random_background": False,
    "random_points": 100_000, "opacity_penalty": 0.0, "init": "auto", "strategy.reset_every": 300,
}  # fmt: skip


def scene(**changes) -> Scene:
    facts = {"has_alpha": True, "num_times": 20, "time_range": (0.0, 1.0)} | changes
    return Scene("horse", POINTS, POINTS, torch.zeros(40, 3), 1.0, **facts)


def evidence(one_color=0, training_psnr=None, baselines=None, completed=True, **figures):
    """Of ten held-out views; figures and baselines of a sound run unless given."""
    evaluation = Evaluation(
        tuple("abcdefghij"), ({},) * 10, 1.0, {"psnr": 27.0, "moving_psnr": 18.0} | figures,
        one_color=one_color, training_psnr=training_psnr,
        baselines={"constant_psnr": 21.0, "constant_moving_psnr": 12.0} | (baselines or {}),
    )  # fmt: skip
    return Evidence(evaluation, scene(), SETTINGS, 800, completed, rows=4000, visible=3900,
                    most_visible=10_000)  # fmt: skip


def keys(found: Evidence) -> list[str]:
    return [finding.key for finding in judge(found)]


def test_a_sound_result_has_no_findings():
    assert keys(evidence(training_psnr=28.0)) == []


def test_a_command_in_the_advice_quotes_an_odd_path():
    found = evidence(one_color=10, psnr=20.83, moving_psnr=11.7)
    found = replace(found, settings=dict(SETTINGS, data="my horse"))
    assert "gsfw check 'my horse', for cameras" in judge(found)[0].message


def test_a_white_result_says_so_whatever_its_psnr_is():
    (finding,) = judge(evidence(one_color=10, psnr=20.83, moving_psnr=11.7))
    assert finding.key == "one-color"
    assert finding.message == (
        "10 of 10 held-out views are rendered as (nearly) one colour, and their images are not. "
        "PSNR is 20.83 dB, and that of the best single colour 21.00 dB. The Gaussians have "
        "vanished into the background, or no camera sees them. Try, one by one: more steps (this "
        "run: 800); squared_steps=400; random_background=true; fewer random points "
        "(random_points=20000); gsfw check horse, for cameras that do not fit."
    )


def test_remedies_that_are_taken_already_or_do_not_apply_are_not_proposed():
    taken = {**SETTINGS, "random_background": True, "squared_steps": 400, "random_points": 10_000}
    (finding,) = judge(replace(evidence(one_color=10), settings=taken))
    assert finding.message.endswith("more steps (this run: 800); gsfw check horse, for cameras "
                                    "that do not fit.")  # fmt: skip
    opaque = replace(evidence(one_color=10), scene=scene(has_alpha=False, num_times=0), settings={})
    (finding,) = judge(opaque)
    assert finding.message.endswith("Try, one by one: more steps (this run: few); other settings.")


def test_a_few_views_that_show_the_background_alone_are_no_collapse():
    assert keys(evidence(one_color=4)) == []


@pytest.mark.parametrize(("psnr", "found"), [(21.4, ["no-better-than-baseline"]), (21.6, [])])
def test_a_result_no_better_than_one_colour_says_so(psnr, found):
    assert keys(evidence(psnr=psnr)) == found


def test_a_static_result_has_to_beat_the_mean_image_once_the_run_is_completed():
    # Chair with shuffled images: 17.31 dB, one colour 15.09, the mean image 17.74.
    found = evidence(psnr=17.31, baselines={"constant_psnr": 15.09, "mean_image_psnr": 17.74})
    static = replace(found, scene=scene(num_times=0))
    (finding,) = judge(static)
    assert finding.key == "no-better-than-baseline"
    assert "17.31 dB, and the mean of the training images would have 17.74 dB" in finding.message
    assert "the cameras do not fit the images" in finding.message
    assert keys(replace(static, completed=False)) == []
    assert keys(replace(static, step=200)) == [], "a run this short is a trial"
    assert keys(found) == [], "a moving scene may have a single fixed camera"


def test_figures_of_the_first_steps_are_not_judged_and_those_of_a_short_run_are():
    early = replace(evidence(psnr=15.0, completed=False), step=100)
    assert keys(early) == []
    assert keys(replace(early, completed=True)) == ["no-better-than-baseline"]
    assert keys(replace(early, step=300)) == ["no-better-than-baseline"]
    white = replace(evidence(one_color=10, completed=False), step=100)
    assert keys(white) == ["one-color"]


@pytest.mark.parametrize(
    ("visible", "psnr", "found"),
    [
        (400, 27.0, []),  # Thinned, and sound.
        (400, 15.0, ["no-better-than-baseline", "dying-gaussians"]),
        (600, 15.0, ["no-better-than-baseline"]),
        (3, 27.0, ["dying-gaussians"]),
    ],
)
def test_gaussians_die_if_few_can_be_seen_and_the_result_is_poor(visible, psnr, found):
    assert keys(replace(evidence(psnr=psnr), visible=visible)) == found


def test_dying_gaussians_are_blamed_on_resets_only_where_there_are_some():
    dying = replace(evidence(), visible=3)
    assert "no opacity resets (strategy.reset_every=0)" in judge(dying)[0].message
    without = replace(dying, settings={**SETTINGS, "strategy.reset_every": 0})
    assert "resets" not in judge(without)[0].message


def test_a_budget_that_leaves_few_gaussians_is_named_first():
    dying = replace(evidence(), visible=3, settings={**SETTINGS, "strategy.budget": "3"})
    assert "Try, one by one: a larger budget (this run: strategy.budget=3); " in (
        judge(dying)[0].message
    )
    without = replace(dying, settings={**SETTINGS, "strategy.budget": "none"})
    assert "budget" not in judge(without)[0].message


@pytest.mark.parametrize(("moving", "found"), [(12.4, ["motion-not-found"]), (12.6, [])])
def test_what_moves_has_to_beat_one_colour(moving, found):
    assert keys(evidence(moving_psnr=moving)) == found


def test_what_moves_has_to_beat_a_still_image_once_the_run_is_completed():
    still = {"still_moving_psnr": 17.8}
    assert keys(evidence(baselines=still)) == ["motion-not-found"]
    assert keys(evidence(baselines=still, completed=False)) == []


def test_a_static_model_that_was_asked_for_is_not_blamed_for_what_moves():
    asked = replace(evidence(moving_psnr=12.0), settings={**SETTINGS, "ignore_time": True})
    assert keys(asked) == []


def test_training_views_far_better_than_held_out_ones_are_overfitting_and_no_collapse():
    (finding,) = judge(evidence(training_psnr=37.1))
    assert (finding.key, finding.is_collapse) == ("overfitting", False)
    assert finding.message == (
        "training views have 37.1 dB and held-out views 27.0 dB: the model overfits the "
        "training images. Likely cause: cameras that are misplaced or have a wrong focal "
        "length, or too few views. Try, one by one: gsfw check horse, for cameras that do not "
        "fit; more views; opacity_penalty=0.03."
    )


def test_a_sound_sparse_capture_is_not_called_overfit():
    assert keys(evidence(training_psnr=34.5)) == []


def test_few_views_are_named_as_the_cause_of_overfitting():
    few = replace(scene(num_times=0), camera_centers=torch.zeros(5, 3))
    (finding,) = judge(replace(evidence(training_psnr=42.0), scene=few))
    assert "Likely cause: there are only 5 training views." in finding.message
    assert finding.message.endswith("opacity_penalty=0.03; init=dense.")


def test_figures_that_were_not_measured_are_not_judged():
    bare = Evaluation(("a",), ({},), 1.0, {"psnr": 3.0})
    assert judge(Evidence(bare, scene(), {}, step=800, completed=True)) == ()
