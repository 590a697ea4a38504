"""The table at the end of a run."""

from support.watched_run import SUMMARY

from gsfw.commands.interface.summary import (
    Row,
    compared_views,
    next_rows,
    quality_rows,
    run_rows,
    summary_text,
)

RUN = {**SUMMARY, "render_ms": 12.34, "baselines": {"constant_psnr": 11.0, "protocol": "so"}}


def test_a_run_has_quality_gaussians_time_memory_and_size():
    rows = run_rows(RUN, ("psnr", "ssim"), "colour takes most", invisible=7)
    assert rows == [
        Row("PSNR", "30.50 dB", "mean of 5 held-out views; one colour has 11.00 dB"),
        Row("SSIM", "0.9000"),
        Row("Gaussians", "100", "7 are too faint to be seen, and not in splats.ply"),
        Row("training", "1 s", "20 steps, without loading and measuring"),
        Row("rendering", "12.3 ms", "an image, median"),
        Row("memory", "100 MB", "at most"),
        Row("model", "24 kB", "colour takes most"),
    ]


def test_the_size_of_compared_images_is_beside_the_psnr():
    protocol = {"image_sizes": [[239, 427]], "downscale": 3.0}
    (row, *_) = run_rows({**RUN, "protocol": protocol}, ())
    assert row.remark.startswith(
        "mean of 5 held-out views of 239 x 427 pixels (1/3 of their size); one colour "
    )
    full = {"image_sizes": [[718, 1280]], "downscale": 1.0}
    assert compared_views("1", "training", full) == "1 training view of 718 x 1280 pixels"


def test_colors_are_corrected_where_exposures_were_learnt():
    run, names = {**RUN, "color_corrected_psnr": 31.5}, ("psnr", "ssim", "color_corrected_psnr")
    assert not [row for row in run_rows(run, names) if row.value == "31.50 dB"]
    learnt = {"exposure": "learnt for training images"}
    rows = run_rows({**run, "protocol": learnt}, names)
    remark = "each render's colours fitted to its photo first"
    assert Row("colour-corrected PSNR", "31.50 dB", remark) in rows


def test_updates_that_count_as_several_steps_are_explained():
    (row,) = (r for r in run_rows({**RUN, "updates": 12}, ()) if r.name == "training")
    assert row.remark == (
        "12 updates, which count as 20 steps of the schedule, without loading and measuring"
    )


def test_a_run_without_held_out_views_says_so_and_has_no_render_time():
    alone = {key: value for key, value in RUN.items() if key not in ("psnr", "ssim")}
    rows = run_rows({**alone, "views": 0}, ("psnr", "ssim"))
    assert rows[0] == Row("PSNR", "-", "there are no held-out views to measure it on")
    assert "rendering" not in [row.name for row in rows]


def test_a_moving_scene_has_what_moves_and_the_size_of_a_time():
    moving = {**RUN, "moving_psnr": 25.0, "bytes_per_time": 1.5e6, "peak_gpu_memory_mb": 3000.0}
    moving["baselines"] = {"constant_moving_psnr": 9.0}
    rows = {(row.name, row.value): row.remark for row in run_rows(moving, ("psnr",))}
    assert rows["PSNR", "25.00 dB"] == "of the moving region; one colour has 9.00 dB there"
    assert rows["model", "24 kB"] == "1.5 MB for each captured time"
    assert ("memory", "100 MB, 3.0 GB of GPU") in rows


def test_metrics_of_plugins_follow_those_that_everybody_knows():
    names = [row.name for row in quality_rows({"lpips": 0.1, "psnr": 30.0}, {}, "3 views")]
    assert names == ["PSNR", "LPIPS"]


def test_skipped_steps_are_not_hidden():
    rows = run_rows({**RUN, "skipped_steps": 3}, ())
    assert (
        "; 3 steps were not finite, and skipped"
        in next(r for r in rows if r.name == "training").remark
    )


def test_remarks_wrap_and_paths_and_commands_do_not(monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "60")
    path = "runs/" + "long/" * 20
    text = summary_text("done", [Row("PSNR", "30.50 dB", "a " * 40)], [Row("folder", path)])
    lines = text.splitlines()
    assert lines[0] == "done"
    assert f"  folder   {path}" in lines
    assert max(len(line) for line in lines if "long" not in line) <= 60
    assert lines[3].startswith(" " * len("  folder   30.50 dB   ") + "a a")


def test_the_remark_of_a_long_value_wraps_below_it(monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "60")
    path = "captures/" + "long/" * 6
    rows = [Row("data", path, "format colmap"), Row("PSNR", "30.50 dB", "a " * 40)]
    lines = summary_text("done", rows).splitlines()
    assert lines[2:4] == [f"  data   {path}", "         format colmap"]
    assert lines[4].startswith("  PSNR   30.50 dB   a a")
    assert max(map(len, lines)) <= 60


def test_only_installed_verbs_are_offered_and_odd_paths_are_quoted():
    rows = next_rows("my run", ("eval", "no-such-verb"), ["tensorboard --logdir x"])
    assert rows == [Row("next", "gsfw eval 'my run'"), Row("", "tensorboard --logdir x")]
