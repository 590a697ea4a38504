"""The live line fits any width, and leaves out what matters least."""

import io
from dataclasses import replace

import pytest
from rich.console import Console
from support.watched_run import report_of, run_info

from gsfw.callbacks.live_line import Figures, LiveLine, fitted
from gsfw.callbacks.progress import Progress
from gsfw.core.callback import Control
from gsfw.core.loop.countdown import Countdown
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.progress import stage


def long_run() -> Figures:
    return Figures(
        12_345, 30_000, 3725.0, loss=0.0217, psnr=28.5, held_out_psnr=27.9, gaussians=1_234_567,
        steps_per_second=27.3, resolution=0.5, skipped=3,
        memory_mb={"rss": 4100.0, "cuda": 12_400.0},
    )  # fmt: skip


def drawn(figures: Figures, width: int) -> str:
    console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None)
    with console.capture() as captured:
        console.print(LiveLine(figures), end="")
    return captured.get()


@pytest.mark.parametrize("width", [20, 40, 60, 80, 100, 120, 160, 300])
def test_the_line_is_one_line_at_any_width(width):
    for figures in (long_run(), Figures(0, 30_000), Figures(0, 1)):
        line = drawn(figures, width)
        assert "\n" not in line.rstrip("\n")
        assert len(line.rstrip("\n")) <= width


@pytest.mark.parametrize("width", [30, 80, 200])
def test_without_unicode_and_colours_the_line_is_plain_text(width, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    written = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
    console = Console(file=written, width=width, force_terminal=True)
    console.print(LiveLine(long_run()), end="")
    written.flush()
    line = written.buffer.getvalue().decode()
    assert "12345/30000" in line
    assert "\x1b[" not in line
    assert len(line.rstrip("\n")) <= width


@pytest.mark.parametrize("width", [80, 120])
def test_bar_time_left_and_memory_are_always_there(width):
    figures = long_run()
    line = drawn(figures, width)
    assert line.startswith("\u2501" * 3)
    for part in ("12345/30000", "1:02:05 left", "RAM 4.1 GB", "GPU 12.4 GB", "3 skipped"):
        assert part in line


def test_a_wide_line_has_everything_in_full():
    line = fitted(long_run(), 300)
    assert line == (
        " 41%  12345/30000  1:02:05 left  PSNR 28.5 dB  loss 0.0217  1,234,567 Gaussians  "
        "27.3 steps/s  at 1/2 size  3 skipped  RAM 4.1 GB  GPU 12.4 GB"
    )


def test_held_out_psnr_is_there_once_training_images_have_its_size():
    figures = long_run()
    assert "held out" not in fitted(figures, 300)
    figures.resolution = 1.0
    assert "PSNR 28.5 dB  held out 27.9 dB  loss" in fitted(figures, 300)


def test_a_line_of_80_columns_rounds_and_leaves_out():
    figures = long_run()
    figures.memory_mb, figures.skipped, figures.resolution = {"rss": 400.0}, 0, 1.0
    assert fitted(figures, 80) == (
        "12345/30000  1:02:05 left  PSNR 28.5 dB  1.23M Gaussians  RAM 0.4 GB"
    )


def test_nothing_is_said_of_the_time_before_it_is_known(tmp_path):
    countdown = Countdown(run_info(tmp_path))
    countdown.tick()
    countdown.report(report_of(1))
    assert countdown.seconds() is None
    assert "--:-- left" in fitted(Figures(1, 100, countdown.seconds()), 80)


def test_the_time_left_runs_down_between_two_reports(tmp_path, monkeypatch):
    now = 1000.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    countdown = Countdown(run_info(tmp_path, steps=1000))
    for step in range(10, 210, 10):
        countdown.tick()
        countdown.report(report_of(step, step_ms=100.0))
    before = countdown.seconds()
    now += 5.0
    assert countdown.seconds() == pytest.approx(before - 5.0)
    now += 1e6
    assert countdown.seconds() == 0.0


@pytest.fixture
def terminal(monkeypatch):
    """A terminal of 80 columns; gives what was written to it."""
    screen = io.StringIO()

    def opened(stderr: bool, highlight: bool) -> Console:
        return Console(file=screen, force_terminal=True, width=80, highlight=highlight,
                       color_system=None, legacy_windows=False)  # fmt: skip

    monkeypatch.setattr("gsfw.callbacks.progress.Console", opened)
    return screen


def test_on_a_terminal_the_line_is_removed_at_the_end_and_evaluations_stay(terminal, tmp_path):
    progress, control = Progress(8.0), Control()
    progress.on_start(run_info(tmp_path, steps=40), control)
    for step in (10, 20):
        progress.on_tick(step, control)
        progress.on_step(report_of(step), control)
    means = {"psnr": 30.0, "ssim": 0.91234, "color_corrected_psnr": 31.0}
    evaluation = Evaluation(("v0",), ({"psnr": 30.0},), 1.0, means)
    with stage("evaluating held-out views", 8) as advance:
        advance(3)
        progress._live.refresh()
    progress.on_evaluation(20, evaluation, control)
    progress.on_end(20, {})
    said = terminal.getvalue()
    assert "20/40" in said
    assert "evaluating held-out views" in said
    assert "3/8" in said
    assert "step 20: PSNR 30.00 dB, SSIM 0.9123 on 1 held-out views\n" in said
    assert said.endswith("\x1b[2K"), "the line is erased"


def test_evaluations_say_how_much_smaller_training_images_are(terminal, tmp_path):
    progress, control = Progress(8.0), Control()
    progress.on_start(run_info(tmp_path, steps=40), control)
    evaluation = Evaluation(("v0",), ({"psnr": 30.0},), 1.0, {"psnr": 30.0})
    for step, resolution in ((10, 0.36), (20, 1.0)):
        progress.on_step(replace(report_of(step), resolution=resolution), control)
        progress.on_evaluation(step, evaluation, control)
    progress.close()
    lines = terminal.getvalue().splitlines()
    (small,) = (line for line in lines if "step 10: " in line)
    (full,) = (line for line in lines if "step 20: " in line)
    assert "held-out views (training images have 1/2.8 of" in small
    assert "training images" not in full


def test_steps_between_reports_advance_the_bar(terminal, tmp_path):
    progress, control = Progress(8.0), Control()
    progress.on_start(run_info(tmp_path, steps=40), control)
    progress.on_tick(7, control)
    progress._live.refresh()
    assert " 7/40" in terminal.getvalue()
    progress.close()
