"""The house style: lazy import, no global state, deterministic files, and round ticks."""

import sys

import numpy as np
import pytest
from PIL import Image

from gsfw.charts.lines import Line, LinePanel, line_figure
from gsfw.charts.style import (
    DPI,
    UNITS,
    new_figure,
    pixels,
    png_bytes,
    ratio_marks,
    round_marks,
    styled,
    text_width,
    write_figure,
)
from gsfw.core.errors import OutputError


def figure(name="a"):
    return line_figure([LinePanel(name, name, (Line(name, ((0.0, 1.0), (1.0, 3.0))),))])


def test_pyplot_is_never_imported():
    figure()
    assert "matplotlib.pyplot" not in sys.modules


def test_the_same_chart_gives_the_same_bytes_without_metadata(tmp_path):
    assert png_bytes(figure()) == png_bytes(figure())
    write_figure(tmp_path / "a.png", figure())
    with Image.open(tmp_path / "a.png") as image:
        assert set(image.info) <= {"dpi"}


def test_the_parameters_of_matplotlib_are_left_as_they_were_and_have_no_effect():
    import matplotlib as mpl

    expected = png_bytes(figure())
    with mpl.rc_context({"font.size": 30.0, "axes.facecolor": "red", "lines.linewidth": 9.0}):
        before = dict(mpl.rcParams)
        assert png_bytes(figure()) == expected
        assert dict(mpl.rcParams) == before


@pytest.mark.parametrize("name", ["$x^2$", "a $ b", "\\alpha_{1}", "写真", "größe", "100 %", ""])
def test_names_are_shown_as_they_are_without_warnings(name):
    assert png_bytes(figure(name)).startswith(b"\x89PNG")


def test_a_layout_unit_has_the_same_size_in_every_chart():
    shown = pixels(new_figure(200.0, 100.0))
    assert shown.shape == (100 * DPI // UNITS, 200 * DPI // UNITS, 3)
    assert shown.dtype == np.uint8


def test_the_width_of_text_grows_with_it():
    width = styled(text_width)
    assert width("") == width(" ") == 0 < width("ab") < width("abab") < width("abab", bold=True)


def test_a_folder_is_made_and_a_place_that_cannot_be_written_is_an_output_error(tmp_path):
    write_figure(tmp_path / "deep" / "a.png", figure())
    assert (tmp_path / "deep" / "a.png").is_file()
    with pytest.raises(OutputError, match="cannot be written"):
        write_figure(tmp_path / "deep" / "a.png" / "b.png", figure())


def test_marks_are_round_and_around_the_values():
    assert round_marks(21.3, 29.4) == [20, 22, 24, 26, 28, 30]
    assert round_marks(0.013, 0.98) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert round_marks(0.1, 0.3)[0] == 0.1, "no digits of binary fractions"
    equal = round_marks(100.0, 100.0)
    assert equal[0] < 100 < equal[-1]


def test_marks_of_ratios_are_at_1_2_and_5_around_the_values():
    assert ratio_marks(0.14, 12.0) == [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0]
    assert ratio_marks(1.0, 10.0) == [1.0, 2.0, 5.0, 10.0]
    assert ratio_marks(70.0, 800.0) == [50.0, 100.0, 200.0, 500.0, 1000.0]
