"""Ragged spherical harmonics: drawn as they lie, and as the dense ones that they stand for."""

from dataclasses import replace
from functools import cache
from itertools import product

import pytest
import torch
from support.agreement import Drawn, as_float64, check_float32, check_float64, draw_everything
from support.sampling import sampled
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.splats import Sh, Splats
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

COUNT = 75
"""Rows: whole groups of sixteen and a part of one, whole warps and a part of one."""

CAMERAS = Cameras.cat([front_camera(), front_camera(distance=2.0)])

DEGREES = {
    "mixed": torch.arange(COUNT) % 4,
    "in blocks": torch.arange(COUNT) // 32,
    "one row alone": (torch.arange(COUNT) == 40) * 3,
    "the last row": (torch.arange(COUNT) == COUNT - 1) * 2,
    "all of degree 0": torch.zeros(COUNT).long(),
    "all of degree 4": torch.full((COUNT,), 4),
}


def ragged(degrees: torch.Tensor, active: int = 4) -> Splats:
    """Splats of these degrees, every third of them behind all cameras."""
    splats = random_splats(COUNT, 4)
    assert isinstance(splats.colors, Sh)
    means = splats.means.clone()
    means[::3, 2] = -100
    colors = replace(splats.colors.of_degrees(degrees), degree=active)
    return replace(splats, means=means, colors=colors)


@cache
def drawn_by_the_reference(name: str, active: int) -> Drawn:
    """What is expected of every backend."""
    wide = as_float64(ragged(DEGREES[name], active), CAMERAS, RenderSettings())
    return draw_everything(ReferenceRasterizer(), *wide)


# Drawn with checks of shapes by the tests below.
@pytest.mark.unchecked
@pytest.mark.parametrize(
    ("name", "active"),
    sampled(list(product(DEGREES, (0, 1, 2, 4))), daily=range(0, 4 * len(DEGREES), 3)),
)
def test_any_mixture_of_degrees_agrees(backend, name, active):
    narrow = (ragged(DEGREES[name], active), CAMERAS, RenderSettings())
    wide = as_float64(*narrow)
    expected = drawn_by_the_reference(name, active)
    check_float64(draw_everything(backend, *wide), expected)
    check_float32(draw_everything(backend, *narrow), expected, narrow[2].profile)


def test_what_is_hidden_or_above_the_active_degree_has_gradient_zero(backend):
    splats = ragged(DEGREES["mixed"], active=2)
    assert isinstance(splats.colors, Sh)
    assert splats.colors.offsets is not None
    lengths = splats.colors.offsets.diff()
    gradient = draw_everything(backend, splats, CAMERAS, RenderSettings())["gradient of rest"]
    assert gradient.shape == splats.colors.rest.shape
    rows = torch.arange(COUNT).repeat_interleave(lengths)
    places = torch.arange(len(rows)) - splats.colors.offsets[:-1].repeat_interleave(lengths)
    unused = (rows % 3 == 0) | (places >= 8)
    assert (gradient[unused] == 0).all()
    assert (gradient[~unused] != 0).any(1).all()


def test_splats_that_are_all_hidden_have_gradient_zero(backend):
    splats = replace(ragged(DEGREES["mixed"]), means=torch.full((COUNT, 3), -100.0))
    drawn = draw_everything(backend, splats, CAMERAS, RenderSettings())
    assert not drawn["visible"].any()
    assert (drawn["gradient of rest"] == 0).all()


def test_no_splats_at_all_are_drawn(backend):
    none = torch.arange(0)
    splats = ragged(DEGREES["mixed"]).take(none)
    drawn = draw_everything(backend, splats, CAMERAS, RenderSettings())
    assert (drawn["color"] == 0).all()
    assert drawn["gradient of rest"].shape == (0, 3)


def test_nothing_is_made_dense(backend, monkeypatch):
    splats = ragged(DEGREES["mixed"])

    def dense(_: Sh) -> None:
        pytest.fail("the colours were made dense")

    monkeypatch.setattr(Sh, "dense", dense)
    draw_everything(backend, splats, CAMERAS, RenderSettings())


def test_rows_of_one_degree_are_drawn_with_the_bits_of_dense_ones(instruction_set):
    splats = ragged(DEGREES["all of degree 4"])
    assert isinstance(splats.colors, Sh)
    assert splats.colors.rest is not None
    dense = Sh(splats.colors.coefficients, 4, splats.colors.rest.view(COUNT, 24, 3))
    expected = draw_everything(
        CpuRasterizer(), replace(splats, colors=dense), CAMERAS, RenderSettings()
    )
    found = draw_everything(CpuRasterizer(), splats, CAMERAS, RenderSettings())
    for name, tensor in expected.items():
        assert torch.equal(found[name].flatten(), tensor.flatten()), name


def test_offsets_that_are_changed_before_the_way_back_are_an_error(backend):
    splats = ragged(DEGREES["mixed"]).map(lambda tensor: tensor.requires_grad_())
    output = backend.render(splats, CAMERAS)
    assert isinstance(splats.colors, Sh)
    assert splats.colors.offsets is not None
    splats.colors.offsets.zero_()
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        output.color.sum().backward()


@pytest.mark.parametrize("place", [0, 7, COUNT])
def test_the_cpu_never_follows_offsets_out_of_memory(instruction_set, place):
    splats = ragged(DEGREES["mixed"])
    assert isinstance(splats.colors, Sh)
    assert splats.colors.offsets is not None
    splats.colors.offsets[place] = 10**12
    unchecked = RenderSettings(validation=Validation.CHEAP)
    with pytest.raises(ValueError, match="offsets") as caught:
        CpuRasterizer().render(splats, CAMERAS, unchecked)
    assert str(caught.value) == "offsets: expected numbers that rise from 0 to the rows of rest"
