"""The event files of a run, as TensorBoard reads them."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from support.moving_runs import MOVING
from support.small_scene import SMALL_SCENE
from support.states import assert_same_bits
from support.watched_run import (
    evaluation,
    play,
    report_of,
    run_info,
    told_requirements,
    view,
)
from tensorboard.backend.event_processing import plugin_event_accumulator
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.custom_scalar.layout_pb2 import Layout
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from gsfw.callbacks.board_curves import LAYOUT
from gsfw.callbacks.board_images import comparison, error_image
from gsfw.callbacks.board_pages import findings_page, run_page
from gsfw.callbacks.tensorboard import TensorBoard, _distributions
from gsfw.commands.main import main
from gsfw.core.callback import Control, EvaluatedView, TrainingView
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.findings import Finding
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.splats import Sh, Splats

EVERYTHING = {"images": 0, "scalars": 0, "tensors": 0, "histograms": 0}


def events_in(folder) -> EventAccumulator:
    events = EventAccumulator(str(folder / "tb"), size_guidance=EVERYTHING)
    events.Reload()
    return events


def text(events: EventAccumulator, tag: str) -> list[str]:
    found = events.Tensors(f"{tag}/text_summary")
    return [event.tensor_proto.string_val[0].decode() for event in found]


def test_distractors_of_training_images_are_shown_about_ten_times(tmp_path):
    board, control = TensorBoard(4), Control()
    board.on_start(run_info(tmp_path, steps=200), control)
    left_out = torch.zeros(8, 10, 1, dtype=torch.bool)
    left_out[:4] = True
    for step in range(5, 205, 5):
        shown = None if step % 15 == 0 else left_out
        image = torch.full((8, 10, 3), 0.5)
        seen = TrainingView("photo", image, image, shown)
        board.on_step(replace(report_of(step), view=seen), control)
    board.close()
    events = events_in(tmp_path).Images("3_distractors/photo")
    assert 7 <= len(events) <= 10
    sheet = np.asarray(Image.open(io.BytesIO(events[0].encoded_image_string)))
    red = (sheet[..., 0] > 180) & (sheet[..., 1] < 80)
    assert red.mean() > 0.1


def test_the_first_group_says_whether_it_works(tmp_path):
    baselines = {"constant_psnr": 11.0, "mean_image_psnr": 14.0, "protocol": "so"}
    board, control = TensorBoard(4), Control()
    board.on_start(run_info(tmp_path, steps=400), control)
    for step in range(100, 210, 10):
        board.on_tick(step, control)
        board.on_step(report_of(step, step_ms=100.0), control)
    board.on_evaluation(200, evaluation(baselines=baselines, training_psnr=33.0), control)
    board.close()
    tags = sorted(events_in(tmp_path).Tags()["scalars"])
    assert [tag for tag in tags if tag.startswith("1_")] == [
        "1_overview/loss", "1_overview/psnr_held_out", "1_overview/psnr_of_one_color",
        "1_overview/psnr_training", "1_overview/step_ms", "1_overview/time_left_minutes",
        "1_overview/total_gaussians",
    ]  # fmt: skip
    assert [tag for tag in tags if not tag.startswith("1_")] == [
        "2_quality/image_size", "2_quality/no_model_mean_image_psnr",
        "2_quality/psnr_of_training_views", "2_quality/skipped_steps", "3_gaussians/cloned",
        "4_loss_terms/l1", "4_method/share", "5_time/render_ms", "6_memory/rss_gb",
        "7_learning_rates/means",
    ]  # fmt: skip


def test_every_figure_has_one_tag(finished_run):
    events = events_in(finished_run)
    curves = [
        tuple((event.step, event.value) for event in events.Scalars(tag))
        for tag in events.Tags()["scalars"]
        if tag[0] in "1245"  # Counts and rates may be equal.
    ]
    assert len(curves) == len(set(curves))
    for tag in events.Tags()["scalars"]:
        steps = [event.step for event in events.Scalars(tag)]
        assert steps == sorted(set(steps)), tag


def test_the_charts_of_several_curves_find_their_tags(finished_run):
    events = events_in(finished_run)
    (stored,) = events.Tensors("custom_scalars__config__")
    layout = Layout.FromString(stored.tensor_proto.string_val[0])
    assert [category.title for category in layout.category] == list(LAYOUT)
    tags = events.Tags()["scalars"]
    for category in layout.category:
        for chart in category.chart:
            if "removed" in chart.title or "left" in chart.title:
                continue  # Such a short run refines nothing, and its time is not predicted.
            for pattern in chart.multiline.tag:
                assert [tag for tag in tags if re.match(pattern, tag)], f"{chart.title}: {pattern}"
    (first, *_) = layout.category[0].chart
    found = [tag for tag in tags if re.match(first.multiline.tag[0], tag)]
    assert len(found) == 3, "training, held out and one colour in one chart"


def test_settings_and_final_figures_are_on_the_hparams_page(finished_run):
    events = events_in(finished_run)
    stored = {
        tag: HParamsPluginData.FromString(content)
        for tag, content in events.summary_metadata.items()
        for content in [events.summary_metadata[tag].plugin_data.content]
        if tag.startswith("_hparams_")
    }
    experiment = stored["_hparams_/experiment"].experiment
    first = {info.name for info in experiment.hparam_infos if info.differs}
    assert first == {"method", "scene", "seed", "steps", "strategy"}, "TensorBoard shows five"
    metrics = experiment.metric_infos
    names = {metric.name.tag for metric in metrics}
    assert {"1_overview/psnr_held_out", "2_quality/ssim", "8_result/train_seconds"} <= names
    assert names <= set(events.Tags()["scalars"]), "each metric is the end of a curve"
    start = stored["_hparams_/session_start_info"].session_start_info.hparams
    assert start["method"].string_value == "3dgs"
    assert start["antialias"].string_value == "False"
    assert start["seed"].number_value == 42


def test_images_come_about_ten_times_in_a_run_and_at_its_end(tmp_path):
    board, control = TensorBoard(1), Control()
    board.on_start(run_info(tmp_path, steps=1000), control)
    for step in range(20, 1020, 20):
        board.on_view(step, view(1))
        board.on_evaluation(step, evaluation(), control)
    board.close()
    steps = [event.step for event in events_in(tmp_path).Images("2_views/v1")]
    assert steps == [100, 200, 300, 400, 500, 600, 700, 800, 900, 1000]


def test_a_few_evaluations_all_have_images_of_the_same_few_views(tmp_path):
    play(TensorBoard(4), tmp_path)
    tags = set(events_in(tmp_path).Tags()["images"])
    assert tags == {*(f"2_views/v{index}" for index in range(4)), "2_views/v0/depth"}


def test_an_image_shows_truth_render_and_error_below_a_caption():
    target, rendered = torch.zeros(40, 300, 3), torch.full((40, 300, 3), 0.125)
    shown = EvaluatedView("photo_7", {"psnr": 18.06}, target, rendered)
    sheet = comparison(shown, 3000, 30_000)
    height, width, _ = sheet.shape
    assert width == 3 * 300 + 2 * 10 + 2 * 6
    panels = sheet[height - 10 - 40 : height - 10]
    middles = [panels[20, x].tolist() for x in (160, 466, 772)]
    assert middles == [[0, 0, 0], [32, 32, 32], [128, 128, 128]]
    head = sheet[: height - 50]
    assert (head < 128).any(), "there is ink in the caption"
    assert not np.array_equal(head, comparison(shown, 3010, 30_000)[: height - 50])


def test_small_images_are_enlarged_and_large_ones_shrunk():
    for width, expected in ((32, 288), (480, 480), (1280, 480)):
        image = torch.rand(24, width, 3)
        sheet = comparison(EvaluatedView("v", {}, image, image), 1, 2)
        assert sheet.shape[1] == 3 * expected + 32


def test_errors_from_a_quarter_on_are_white():
    target = torch.zeros(1, 3, 3)
    rendered = torch.tensor([[[0.0] * 3, [0.125] * 3, [0.25] * 3]])
    assert error_image(target, rendered)[0, :, 0].tolist() == [0.0, 0.5, 1.0]


class Model:
    """Stands in for the handle of a model."""

    def splats(self) -> Splats:
        degrees = torch.tensor([0, 1, 1, 3])
        colors = Sh(torch.zeros(4, 16, 3), 3).of_degrees(degrees)
        return Splats(
            torch.zeros(4, 3), torch.tensor([0.1, 0.5, 0.5, torch.nan]), colors,
            quats=torch.zeros(4, 4), scales=torch.tensor([[0.01, 0.1, 0.001]] * 4),
        )  # fmt: skip


def test_histograms_are_of_opacity_scale_and_degree():
    found = _distributions(Model().splats())
    assert found["opacity"].tolist() == pytest.approx([0.1, 0.5, 0.5])
    assert found["log10_scale"].tolist() == pytest.approx([-1.0] * 4)
    assert found["sh_degree"].tolist() == [0, 1, 1, 3]


def test_dense_colours_have_the_active_degree():
    splats = Model().splats()
    dense = Splats(
        splats.means, splats.opacities, Sh(torch.zeros(4, 16, 3), 2), quats=splats.quats,
        scales=splats.scales,
    )  # fmt: skip
    assert _distributions(dense)["sh_degree"].tolist() == [2, 2, 2, 2]


def test_histograms_are_written_at_evaluations(tmp_path):
    board, control = TensorBoard(1), Control()
    board.on_start(run_info(tmp_path), control)
    board.on_step(report_of(10, model=Model()), control)
    board.on_evaluation(10, evaluation(), control)
    board.close()
    events = events_in(tmp_path)
    assert set(events.Tags()["histograms"]) == {
        "gaussians/opacity", "gaussians/log10_scale", "gaussians/sh_degree",
    }  # fmt: skip
    (degrees,) = events.Histograms("gaussians/sh_degree")
    value = degrees.histogram_value
    assert (value.num, value.sum, value.min, value.max) == (4, 5.0, 0.0, 3.0)
    counts = dict(zip(value.bucket_limit, value.bucket, strict=True))
    assert counts == {0.5: 1, 1.5: 2, 2.5: 0, 3.5: 1, 4.5: 0}


def test_a_page_has_run_data_protocol_and_advice(tmp_path):
    page = run_page(run_info(tmp_path, data="fox_1", strategy="adc"))
    assert page.startswith("## 3dgs on toy\n")
    assert "| data | fox\\_1 |" in page
    assert "| background | 1.0, 1.0, 1.0 |" in page
    assert "\n\n### Advice\n\n* a note\n\n### How figures are measured\n\n" in page


def test_findings_are_said_when_they_change(tmp_path):
    finding = Finding("one-color", "It is *one* colour.")
    board, control = TensorBoard(1), Control()
    board.on_start(run_info(tmp_path, steps=100), control)
    for step, found in ((10, ()), (20, (finding,)), (30, (finding,)), (40, ())):
        board.on_evaluation(step, evaluation(findings=found), control)
    board.close()
    good, bad, again = text(events_in(tmp_path), "3_findings")
    assert good == "There are no findings after 10 steps."
    assert bad == "After 20 steps:\n\n* **one-color**: It is \\*one\\* colour."
    assert again == findings_page(40, ())


def test_what_a_run_required_has_its_own_group(tmp_path):
    told_requirements(TensorBoard(4), tmp_path)
    events = events_in(tmp_path)
    floats = {
        tag.removeprefix("9_requirements/"): events.Scalars(tag)[0].value
        for tag in events.Tags()["scalars"]
        if tag.startswith("9_")
    }
    assert floats == {
        "sh_floats": 18, "sh_floats_full": 24, "total_floats": 24, "floats/positions": 6,
        "floats/SH_band_1": 18, "bought_db/SH_band_1": 0.25,
    }  # fmt: skip
    assert events.Images("9_requirements/chart")[0].width == 5
    assert text(events, "4_requirements") == ["48 floats each for colour"]


def steps_shown(folder, tag: str) -> list[int]:
    """Steps of a tag as TensorBoard's own server has them, which purges what was repeated.

    Files of one second are in the order of their names, in which the tenth precedes the ninth.
    """
    events = plugin_event_accumulator.EventAccumulator(
        str(folder / "tb"),
        tensor_size_guidance={"scalars": 0, "images": 0, "text": 0, "custom_scalars": 0},
    )
    events.Reload()
    return sorted(event.step for event in events.Tensors(tag))


STOPPED = {"completed": False, "steps": 30}


def test_a_resumed_run_loses_and_repeats_no_point(tmp_path):
    play(TensorBoard(1), tmp_path, steps=(10, 20, 30), summary=STOPPED)
    for _ in range(2):
        play(TensorBoard(1), tmp_path, steps=(30, 40), first_step=20, summary=STOPPED)
    assert steps_shown(tmp_path, "1_overview/loss") == [10, 20, 30, 40]
    assert steps_shown(tmp_path, "1_overview/psnr_held_out") == [40]
    assert steps_shown(tmp_path, "2_views/v0") == [40]
    assert steps_shown(tmp_path, "1_run/text_summary") == [0, 20]
    assert len(steps_shown(tmp_path, "custom_scalars__config__")) == 1


def test_a_run_that_only_lost_its_summary_has_its_last_evaluation_once(tmp_path):
    play(TensorBoard(1), tmp_path, steps=(10, 20), summary=STOPPED)
    play(TensorBoard(1), tmp_path, steps=(), first_step=20)
    assert steps_shown(tmp_path, "1_overview/loss") == [10, 20]
    assert steps_shown(tmp_path, "1_overview/psnr_held_out") == [20]
    assert steps_shown(tmp_path, "2_views/v0") == [20]


def test_a_file_that_a_crash_has_cut_short_is_read_up_to_there(tmp_path):
    play(TensorBoard(1), tmp_path, steps=(10, 20), summary=STOPPED)
    (path,) = (tmp_path / "tb").iterdir()
    path.write_bytes(path.read_bytes()[:-5])
    play(TensorBoard(1), tmp_path, steps=(30,), first_step=20)
    assert steps_shown(tmp_path, "1_overview/loss") == [10, 20, 30]


def test_a_run_that_was_stopped_before_any_checkpoint_begins_anew(tmp_path):
    play(TensorBoard(1), tmp_path, steps=(10, 20), summary=STOPPED)
    play(TensorBoard(1), tmp_path, steps=(10, 20))
    assert steps_shown(tmp_path, "1_overview/loss") == [10, 20]
    assert steps_shown(tmp_path, "1_overview/psnr_held_out") == [20]
    assert steps_shown(tmp_path, "1_run/text_summary") == [0]


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize("scene", [SMALL_SCENE, MOVING], ids=["static", "moving"])
def test_watching_changes_no_bit_of_what_is_trained(tmp_path, scene):
    method = "3dgs" if scene is SMALL_SCENE else "spacetime"
    states = []
    for enabled in ("true", "false"):
        folder = RunFolder(tmp_path / enabled)
        settings = (*scene, "steps=12", "eval_every=4", "log_every=3", "device=cpu")
        watched = f"callbacks.tensorboard.enabled={enabled}"
        assert main(["train", f"method={method}", *settings, watched, f"out={folder.path}"]) == 0
        states.append({**read_checkpoint(folder.checkpoint(12)), "train_seconds": 0})
    assert events_in(tmp_path / "true").Tags()["histograms"]
    assert_same_bits(*states)


def test_the_images_are_readable(finished_run):
    events = events_in(finished_run)
    (shown, *_) = events.Images("2_views/eval_000")
    with Image.open(io.BytesIO(shown.encoded_image_string)) as image:
        assert image.size == (shown.width, shown.height)
