"""The plot of PSNR over time."""

import pytest
from PIL import Image

from gsfw.charts.time_plot import SERIES, SIZE, Axis, write_time_plot
from gsfw.core.loop.evaluation import Evaluation


def evaluation(*points) -> Evaluation:
    return Evaluation((), (), 1.0, over_time=points)


def point(time, psnr, moving=None):
    figures = {"data_time": time, "psnr": psnr}
    return figures if moving is None else {**figures, "moving_psnr": moving}


def colors(path) -> dict:
    with Image.open(path) as image:
        assert image.size == SIZE
        return {color: count for count, color in image.getcolors(1 << 20)}


def test_a_line_for_each_figure_that_there_is(tmp_path):
    both = write_time_plot(
        tmp_path / "a.json", evaluation(point(0.0, 30.0, 20.0), point(1.0, 31.0, 22.0))
    )
    assert both == tmp_path / "a_over_time.png"
    one = write_time_plot(tmp_path / "b.json", evaluation(point(0.0, 30.0), point(1.0, 31.0)))
    full, moving = (color for _, _, color in SERIES)
    assert colors(both).get(full, 0) > 200
    assert colors(both).get(moving, 0) > 200
    assert moving not in colors(one)


@pytest.mark.parametrize("points", [(), (point(0.5, 30.0),)])
def test_less_than_two_times_make_no_plot(tmp_path, points):
    assert write_time_plot(tmp_path / "a.json", evaluation(*points)) is None
    assert list(tmp_path.iterdir()) == []


def test_equal_values_still_have_an_axis(tmp_path):
    path = write_time_plot(tmp_path / "a.json", evaluation(point(0.0, 100.0), point(2.0, 100.0)))
    assert path.is_file()


def test_marks_are_round_and_around_the_values():
    axis = Axis.over([21.3, 29.4], 400.0, 40.0)
    assert axis.marks == (20, 22, 24, 26, 28, 30)
    assert (axis.at(20.0), axis.at(30.0)) == (400, 40)
    tight = Axis.over([0.013, 0.98], 0.0, 100.0, tight=True)
    assert tight.marks == pytest.approx((0.2, 0.4, 0.6, 0.8))
    assert (tight.at(0.013), tight.at(0.98)) == (0, 100)


def test_an_axis_of_ratios_gives_equal_ratios_equal_lengths():
    axis = Axis.of_ratios([0.14, 12.0], 100.0, 800.0)
    assert axis.marks == (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
    assert (axis.at(0.1), axis.at(20.0)) == (100.0, 800.0)
    assert axis.at(2.0) - axis.at(1.0) == pytest.approx(axis.at(0.4) - axis.at(0.2))
