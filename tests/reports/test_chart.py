"""Curves as SVG: every value is within the plot, and long runs have few points."""

import json
import math
import re

import pytest

from gsfw.reports.chart import HEIGHT, WIDTH, Chart, Curve, brief, smoothed, thinned
from gsfw.reports.markup import element, join


def test_long_curves_are_thinned_to_means_and_keep_their_end():
    points = [(float(step), float(step % 2)) for step in range(10_001)]
    few = thinned(points)
    assert len(few) <= 300
    assert few[-1][0] == 10_000
    assert all(0 <= value <= 1 for _, value in few)
    assert thinned(points[:7]) == points[:7]


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


def test_marks_are_brief():
    assert [brief(value) for value in (0.05, 200.0, 20_000.0, 2.5e6)] == [
        "0.05",
        "200",
        "20k",
        "2.5M",
    ]


def test_only_markup_is_trusted():
    assert element("p", ["<b>", element("i", "&")], {"title": '"'}) == (
        '<p title="&quot;">&lt;b&gt;<i>&amp;</i></p>'
    )
    assert join(element("input", (), {"checked": True, "hidden": False})) == "<input checked>"
