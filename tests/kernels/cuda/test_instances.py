"""Instances: every one that can be chosen fits a block's shared memory."""

import re

import pytest
import torch
from support.native_programs import ROOT

from gsfw.kernels.cuda.instances import WIDTHS, Instances
from gsfw.rasterizers.cuda import picture

SHARED_BYTES = 48 * 1024
"""What a block may have on any GPU without asking."""

SOURCES = ROOT / "kernels" / "cuda" / "sources"


def instances(dtype: torch.dtype, channels: int) -> Instances:
    return Instances(dtype, False, 3, channels, torch.int16)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("width", WIDTHS)
def test_the_memory_of_a_chunk_fits(width, dtype):
    size, chunk = dtype.itemsize, instances(dtype, width).chunk
    stride = -(-(6 + width) // 4) * 4
    entries = chunk * stride * size + chunk
    sums = chunk * ((6 + width + 2) | 1) * size
    group = 2 * 16 * 33 * size
    pixels = (width + chunk // 16) * 32 * size
    assert entries + sums + group + pixels + chunk <= SHARED_BYTES
    assert entries + 8 * chunk * size <= SHARED_BYTES  # Forward, with contributions.


def test_channels_are_drawn_by_the_narrowest_instance_that_holds_them():
    chosen = {channels: instances(torch.float32, channels).width for channels in range(1, 41)}
    assert all(width >= channels for channels, width in chosen.items())
    assert [chosen[channels] for channels in (1, 3, 7, 8, 9, 33)] == [1, 3, 8, 8, 12, 40]


def test_kernels_are_named_as_c_spells_them():
    chosen = Instances(torch.float64, True, -1, 4, torch.int32)
    assert chosen.project.expression == "project<double, Symmetric3<double>, -1, false>"
    backward = chosen.project_backward(pose=True).expression
    assert backward == "project_backward<double, Symmetric3<double>, -1, false, true>"
    ragged = Instances(torch.float32, False, 3, 3, torch.int16, ragged=True)
    assert ragged.project.expression == "project<float, Axes<float>, 3, true>"
    assert chosen.emit.expression == "emit<double, uint32>"
    assert chosen.find_tiles.expression == "find_tiles<uint32>"
    assert chosen.blend(measure=False).expression == "blend<double, 4, 64, false>"
    assert chosen.blend_backward(absolute=True).expression == "blend_backward<double, 4, 64, true>"


@pytest.mark.parametrize(
    ("name", "file", "value"),
    [
        ("TILE", "stages.h", picture.TILE),
        ("PROJECT_THREADS", "splat.h", picture.PROJECT_THREADS),
        ("BIN_THREADS", "bin.cu", picture.BIN_THREADS),
        ("WARP", "platform.h", picture.WARP),
    ],
)
def test_numbers_that_the_host_shares_with_kernels_are_the_same(name, file, value):
    text = (SOURCES / file).read_text(encoding="utf-8")
    found = re.search(rf"constexpr int {name} = (\d+);", text)
    assert found is not None
    assert int(found.group(1)) == value


@pytest.mark.parametrize(
    ("name", "last", "value"),
    [
        ("BrushField", "BRUSH_CHANNELS", picture.BRUSH_CHANNELS),
        ("SumField", "SUM_CHANNELS", picture.SUM_CHANNELS),
    ],
)
def test_fields_that_the_host_counts_are_as_many(name, last, value):
    text = (SOURCES / "stages.h").read_text(encoding="utf-8")
    found = re.search(rf"enum {name} {{(.*?)}}", text, re.DOTALL)
    assert found is not None
    fields = [field.strip() for field in found.group(1).split(",")]
    assert fields.index(last) == len(fields) - 1 == value
