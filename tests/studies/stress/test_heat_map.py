"""The heat map: colours, and what is empty or broken."""

import torch
from PIL import Image

from gsfw.plugins.registry import installed
from gsfw.studies.entrants import entrant_of
from gsfw.studies.stress.heat_map import NOT_FINITE, NOTHING, RAMP, color_of, write_heat_map
from gsfw.studies.stress.plane import EMPTY, PLANES, Plane, PlaneOracle, plane_errors


def small(number: int) -> Plane:
    whole = PLANES[number]
    return Plane(
        whole.name, whole.across, whole.upward, whole.across_values[::8],
        whole.upward_values[::5], whole.make,
    )  # fmt: skip


def test_colours_go_by_powers_of_ten():
    assert color_of(1.0) == color_of(5.0) == RAMP[-1][1]
    assert color_of(0.0) == RAMP[0][1]
    assert color_of(1e-5) == RAMP[3][1]
    assert color_of(EMPTY) == NOTHING
    assert color_of(float("nan")) == color_of(float("inf")) == NOT_FINITE


def test_planes_are_measured_and_drawn(tmp_path):
    backend = entrant_of("reference", installed())
    oracle = PlaneOracle(backend.rasterizer)
    found = [
        plane_errors(backend, dtype, small(number), oracle)
        for dtype in ("float32", "float64")
        for number in (0, 1)
    ]
    depths, opacities, exact, _ = found
    assert max(max(row) for row in depths.picture) < 1e-5
    assert opacities.picture[0] == (EMPTY, EMPTY, EMPTY), "an opacity of 0.002 is cut off"
    assert max(max(row) for row in exact.picture) == 0.0
    assert opacities.document()["picture"][0] == [None, None, None]
    write_heat_map(tmp_path / "deep" / "map.png", found)
    with Image.open(tmp_path / "deep" / "map.png") as picture:
        assert picture.width > 400
        assert color_of(0.0) in {color for _, color in picture.getcolors(1_000_000)}


def test_what_is_refused_or_not_finite_is_black():
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
    assert color_of(errors.picture[0][0]) == NOT_FINITE
    assert errors.document()["picture"] == [["not finite"]]
