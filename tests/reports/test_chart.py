"""Curves as SVG: every value is within the plot, and long runs have few points."""

import json
import math
import re

import pytest

from gsfw.reports.chart import HEIGHT, WIDTH, Chart, Curve, smoothed, thinned
from gsfw.reports.markup import element, join


def test_long_curves_are_thinned_to_means_and_keep_their_end():
    points = [(float(step), float(step % 2)) for step in range(10_001)]
    few = thinned(points)
    assert len(few) <= 300
    assert all(0.4 < value < 0.6 for _, value in few[1:-2])
    assert thinned(points[:7]) == points[:7]


@pytest.mark.parametrize("count", [299, 300, 301, 302, 599, 10_001])
def test_the_ends_of_a_long_curve_are_its_true_values(count):
    points = [(float(step), 1.0 / (1 + step)) for step in range(count - 1)]
    points.append((float(count), 7.0))
    few = thinned(points)
    assert len(few) <= 300
    assert few[0] == points[0]
    assert few[-1] == (float(count), 7.0)
    assert [x for x, _ in few] == sorted(x for x, _ in few)


def test_a_thinned_line_stays_a_line():
    few = thinned([(float(step), 2.0 * step) for step in range(5_000)])
    assert [y for _, y in few] == pytest.approx([2 * x for x, _ in few])


def test_smoothing_keeps_places_and_straight_lines():
    line = [(float(step), 2.0 * step) for step in range(50)]
    found = smoothed(line)
    assert [x for x, _ in found] == [x for x, _ in line]
    assert [y for _, y in found] == pytest.approx([y for _, y in line])
    assert smoothed([]) == []


@pytest.mark.parametrize("is_ratio", [False, True])
@pytest.mark.parametrize("values", [[1.0], [3.0, 3.0], [0.01, 5.0, 2.0], [1e-9, 1e9]])
def test_every_value_is_drawn_within_the_plot(values, is_ratio):
    curve = Curve("loss", [(float(step), value) for step, value in enumerate(values)])
    text = Chart("Loss", "step", (curve,), is_ratio=is_ratio).markup()
    places = re.search(r'points="([^"]+)"', text)[1].split()
    assert len(places) == len(values)
    for place in places:
        x, y = map(float, place.split(","))
        assert math.isfinite(x)
        assert 0 <= x <= WIDTH
        assert 0 <= y <= HEIGHT


def labels(markup):
    return re.findall(r'text-anchor="end">([^<]+)<', markup)


@pytest.mark.parametrize("points", [[(1e18, 1.0)], [(1e18, 2.0), (1e18, 3.0)]])
def test_one_place_at_a_huge_step_is_drawn(points):
    drawn = Chart("a", "step", (Curve("b", points),)).markup()
    assert "nan" not in str(drawn)


def test_means_beside_a_huge_value_stay_among_the_values():
    points = [(float(x), 1e18 if x == 12 else 1.0 / (x + 1)) for x in range(40)]
    values = [value for _, value in smoothed(points, 0.1)]
    assert min(values) >= 1 / 40
    assert "nan" not in str(
        Chart("a", "step", (Curve("b", smoothed(points)),), is_ratio=True).markup()
    )


def test_a_flat_curve_has_marks_that_differ():
    for value in (12_033.0, 22.1, 0.0, -3.0):
        curve = Curve("count", [(0.0, value), (9.0, value)])
        found = labels(Chart("Count", "step", (curve,)).markup())
        assert len(set(found)) == len(found) >= 2, (value, found)


def test_counts_begin_at_zero():
    curve = Curve("Gaussians", [(0.0, 12_033.0), (9.0, 12_033.0)])
    markup = Chart("Gaussians", "step", (curve,), is_from_zero=True).markup()
    assert labels(markup)[0] == "0"
    assert 'class="key' not in markup, "the title names the only curve"


def test_a_chart_without_points_is_nothing():
    assert Chart("Loss", "step", (Curve("loss", []),)).markup() == ""


def test_the_values_on_hover_are_those_of_the_curves():
    chart = Chart("PSNR", "step", (Curve("<a>", [(1.0, 20.123456), (2.0, 21.0)]),), unit="dB")
    data = json.loads(
        re.search(r'data-chart="([^"]+)"', chart.markup())[1].replace("&quot;", '"')
        .replace("&lt;", "<").replace("&gt;", ">")
    )  # fmt: skip
    assert data["curves"][0]["name"] == "<a>"
    assert data["curves"][0]["points"] == [[1.0, 20.123], [2.0, 21.0]]


def test_only_markup_is_trusted():
    assert element("p", ["<b>", element("i", "&")], {"title": '"'}) == (
        '<p title="&quot;">&lt;b&gt;<i>&amp;</i></p>'
    )
    assert join(element("input", (), {"checked": True, "hidden": False})) == "<input checked>"
