"""Pareto fronts: dots, fronts, scales, and labels that cover nothing."""

import random
from itertools import combinations

import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from gsfw.charts.fronts import CostDot, FrontPanel, front_figure
from gsfw.charts.style import png_bytes

DOTS = [
    CostDot("all", "as it is", "#111111", 10.0, 30.0),
    CostDot("half", "half of it", "#222222", 5.0, 29.0, spread=1.0),
    CostDot("bad", "bad", "#333333", 9.0, 25.0),
]


def axes_of(dots, front, cost="MB"):
    return front_figure([FrontPanel(cost, dots, front)], {"kind": "#222222"}).axes[0]


def shown(axes):
    return {line.get_gid(): line for line in axes.lines if line.get_marker() == "o"}


def test_every_dot_is_drawn_in_its_colour_and_the_front_is_a_line():
    axes = axes_of(DOTS, ["half", "all"])
    assert axes.get_xlabel() == "MB"
    for dot in DOTS:
        line = shown(axes)[dot.name]
        assert tuple(line.get_xydata()[0]) == (dot.cost, dot.quality)
        assert to_hex(line.get_color()) == dot.color
    (front,) = [line for line in axes.lines if len(set(line.get_ydata())) > 1]
    assert [tuple(point) for point in front.get_xydata()] == [(5.0, 29.0), (10.0, 30.0)]


def test_only_the_front_is_labelled():
    axes = axes_of(DOTS, ["half", "all"])
    assert [text.get_text() for text in axes.texts] == ["half of it", "as it is"]


def test_the_spread_is_a_bar_of_that_length_within_the_axes():
    bars = [line for line in axes_of(DOTS, []).lines if to_hex(line.get_color()) == "#222222"]
    assert list(bars[0].get_xdata()) == [4.5, 5.5]


def test_costs_that_differ_much_have_a_logarithmic_axis():
    assert axes_of(DOTS, []).get_xscale() == "linear"
    assert axes_of(DOTS, []).get_xlim()[0] == 0.0
    small = CostDot("small", "small", "#444444", 0.14, 29.0)
    axes = axes_of([*DOTS, small], [])
    assert axes.get_xscale() == "log"
    assert [text.get_text() for text in axes.get_xticklabels()] == [
        *("0.1", "0.2", "0.5", "1", "2", "5", "10"),
    ]


def test_far_dots_are_counted_instead_of_drawn():
    far = [CostDot("dear", "", "#555555", 26.0, 30.0), CostDot("ugly", "", "#666666", 5.0, 19.0)]
    axes = axes_of([*DOTS, *far], ["all", "dear"])
    assert set(shown(axes)) == {"all", "half", "bad"}
    assert [text.get_text() for text in axes.texts] == ["2 outside the axes", "as it is"]


def test_panels_share_a_legend():
    panels = [FrontPanel("MB", DOTS, []), FrontPanel("ms", DOTS[:1], ["all"])]
    figure = front_figure(panels, {"kind": "#222222", "other": "#111111"})
    assert [axes.get_xlabel() for axes in figure.axes] == ["MB", "ms"]
    assert [text.get_text() for text in figure.texts] == ["PSNR (dB)", "PSNR (dB)"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["kind", "other"]


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
def test_labels_lie_within_the_axes_and_cover_no_dot_and_no_other_label(seed):
    draw = random.Random(seed)
    dots = [CostDot("0", "the first", "#111111", 20.0, 36.0)]
    dots += [
        CostDot(f"{n}", f"variant {n}, 6700 steps", "#222222", draw.uniform(1, 20), 27 + n / 3)
        for n in range(1, 20)
    ]
    front = [dot.name for dot in sorted(dots, key=lambda dot: dot.cost)][::3]
    axes = axes_of(dots, front)
    axes.figure.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in axes.texts]
    assert len(boxes) == len(front)
    assert not any(first.overlaps(second) for first, second in combinations(boxes, 2))
    places = axes.transData.transform([(dot.cost, dot.quality) for dot in dots])
    assert not any(box.contains(*place) for box in boxes for place in places)
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)


@pytest.mark.slow
def test_labels_without_room_are_drawn_all_the_same():
    dots = [CostDot(f"{n}", "a rather long label " * 3, "#111111", 5.0, 30.0) for n in range(12)]
    figure = front_figure([FrontPanel("MB", dots, [dot.name for dot in dots])], {})
    assert len(figure.axes[0].texts) == 12
    assert png_bytes(figure)
