"""The heat map of a stress test, with empty and broken cells."""

import pytest
import torch
from PIL import Image, ImageColor

from gsfw.charts.heat_map import NOT_FINITE, NOTHING, SCALE
from gsfw.plugins.registry import installed
from gsfw.studies.entrants import entrant_of
from gsfw.studies.stress.heat_map import write_heat_map
from gsfw.studies.stress.plane import EMPTY, PLANES, Plane, PlaneOracle, plane_errors


def small(number: int) -> Plane:
    whole = PLANES[number]
    return Plane(
        whole.name, whole.across, whole.upward, whole.across_values[::8],
        whole.upward_values[::5], whole.make,
    )  # fmt: skip


def colors(path) -> dict:
    with Image.open(path) as image:
        return {color: count for count, color in image.convert("RGB").getcolors(1 << 22)}


@pytest.mark.slow
def test_planes_are_measured_and_drawn(tmp_path):
    backend = entrant_of("reference", installed())
    oracle = PlaneOracle(backend.rasterizer)
    found = [
        plane_errors(backend, dtype, small(number), oracle)
        for dtype in ("float32", "float64")
        for number in (0, 1)
    ]
    depths, opacities, exact, _ = found
    assert max(max(row) for row in depths.image) < 1e-5
    assert opacities.image[0] == (EMPTY, EMPTY, EMPTY), "an opacity of 0.002 is cut off"
    assert max(max(row) for row in exact.image) == 0.0
    assert opacities.document()["image"][0] == [None, None, None]
    write_heat_map(tmp_path / "deep" / "map.png", found)
    found_colors = colors(tmp_path / "deep" / "map.png")
    assert found_colors[ImageColor.getrgb(SCALE[0][1])] > 1000, "errors of 0"
    assert found_colors[ImageColor.getrgb(NOTHING)] > 1000, "empty cells"


def test_what_is_refused_or_not_finite_is_black(tmp_path):
    backend = entrant_of("reference", installed())

    def broken(across: float, upward: float):
        drawing = PLANES[0].make(across, upward)
        drawing.splats.means.fill_(torch.nan)
        return drawing

    plane = Plane("broken", "x", "y", (1.0,), (1.0,), broken)
    oracle = PlaneOracle(backend.rasterizer)
    sound = oracle.expected(small(0), 1.0, 1.0)
    oracle.expected = lambda *_: sound  # type: ignore[method-assign]
    errors = plane_errors(backend, "float32", plane, oracle)
    write_heat_map(tmp_path / "map.png", [errors])
    assert colors(tmp_path / "map.png")[ImageColor.getrgb(NOT_FINITE)] > 300
    assert errors.document()["image"] == [["not finite"]]
