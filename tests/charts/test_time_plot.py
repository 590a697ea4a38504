"""The plot of PSNR over time."""

import pytest
from PIL import Image, ImageColor

from gsfw.charts.style import SERIES
from gsfw.charts.time_plot import write_time_plot
from gsfw.core.loop.evaluation import Evaluation


def evaluation(*points) -> Evaluation:
    return Evaluation((), (), 1.0, over_time=points)


def point(time, psnr, moving=None):
    figures = {"data_time": time, "psnr": psnr}
    return figures if moving is None else {**figures, "moving_psnr": moving}


def colors(path) -> dict:
    with Image.open(path) as image:
        return {color: count for count, color in image.convert("RGB").getcolors(1 << 22)}


def test_a_line_for_each_figure_that_there_is(tmp_path):
    both = write_time_plot(
        tmp_path / "a.json", evaluation(point(0.0, 30.0, 20.0), point(1.0, 31.0, 22.0))
    )
    assert both == tmp_path / "a_over_time.png"
    one = write_time_plot(tmp_path / "b.json", evaluation(point(0.0, 30.0), point(1.0, 31.0)))
    full, moving = (ImageColor.getrgb(color) for color in SERIES[:2])
    assert colors(both).get(full, 0) > 200
    assert colors(both).get(moving, 0) > 200
    assert moving not in colors(one)


def test_the_legend_has_the_mean_over_times_and_the_axes_their_quantities(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr("gsfw.charts.time_plot.write_figure", lambda _, one: figures.append(one))
    write_time_plot(tmp_path / "a.json", evaluation(point(0.5, 30.0), point(2.0, 31.0)))
    (figure,) = figures
    (axes,) = figure.axes
    assert "time" in axes.get_xlabel()
    assert axes.get_ylabel() == "PSNR (dB)"
    assert [tuple(row) for row in axes.lines[0].get_xydata()] == [(0.5, 30.0), (2.0, 31.0)]
    (text,) = figure.legends[0].get_texts()
    assert text.get_text() == "PSNR of all pixels, mean over times 30.50 dB"


@pytest.mark.parametrize("points", [(), (point(0.5, 30.0),)])
def test_less_than_two_times_make_no_plot(tmp_path, points):
    assert write_time_plot(tmp_path / "a.json", evaluation(*points)) is None
    assert list(tmp_path.iterdir()) == []


def test_equal_values_still_have_an_axis(tmp_path):
    path = write_time_plot(tmp_path / "a.json", evaluation(point(0.0, 100.0), point(2.0, 100.0)))
    assert path.is_file()
