"""Instances: every one that can be chosen fits a block's shared memory."""

import pytest
import torch

from gsfw.core.cameras import CameraModel
from gsfw.kernels.cuda.instances import WIDTHS, Instances
from gsfw.kernels.cuda.instances import instances as instances_of
from gsfw.kernels.cuda.source_files import constant, enumerators
from gsfw.kernels.render_arguments import CAMERA_MODELS

SHARED_BYTES = 48 * 1024
"""What a block may have on any GPU without asking."""


def instances(dtype: torch.dtype, channels: int) -> Instances:
    return Instances(dtype, False, 3, channels, torch.int16)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("width", WIDTHS)
def test_the_memory_of_a_chunk_fits(width, dtype):
    chosen = instances(dtype, width)
    size, chunk = dtype.itemsize, chosen.chunk
    row = -(-(6 + width) // 4) * 4 * size + 1
    assert chunk * row + 8 * chunk * size <= SHARED_BYTES  # Forward, with contributions.
    sums = chunk * ((6 + width + 2) | 1) * size
    shares = 16 * 33 * 2 * size
    pixels = (-(-width // 4) * 4 + chunk // 16) * 32 * size
    entries, place = (chunk + 1) * row, 48
    warps = chosen.chunk_threads // 32
    assert entries + place + warps * (sums + shares + pixels + chunk) + 64 <= SHARED_BYTES


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
    assert (
        chosen.blend_backward(absolute=True).expression == "blend_backward<double, 4, 64, 32, true>"
    )


def test_images_of_one_kind_share_their_kernels():
    first, second = (
        instances_of(torch.float32, False, 3, 3, torch.int16, ragged=False) for _ in range(2)
    )
    assert first.blend(measure=True) is second.blend(measure=True)
    assert first.find_tiles is second.find_tiles


@pytest.mark.parametrize(
    ("header", "name", "value"),
    [
        ("stages.h", "TILE", 16),
        ("stages.h", "POSE_FIELDS", 3 * 3 + 3 + 3),
        ("platform.h", "WARP", 32),
        ("step_stages.h", "FINITE_TENSORS", 16),
    ],
)
def test_constants_are_read_from_the_headers_that_define_them(header, name, value):
    assert constant(header, name) == value


def test_enumerators_are_numbered_as_the_compiler_numbers_them():
    assert enumerators("camera.h", "CameraModel") == {
        "pinhole": 0,
        "orthographic": 1,
        "fisheye": 2,
    }
    fields = enumerators("stages.h", "SumField")
    assert list(fields.values()) == list(range(7))
    assert list(fields)[-1] == "SUM_CHANNELS"
    assert set(CAMERA_MODELS) == {model.name.lower() for model in CameraModel}


def test_constants_that_no_header_defines_are_refused():
    with pytest.raises(ValueError, match="constexpr") as caught:
        constant("stages.h", "SIDE")
    assert str(caught.value) == "stages.h: expected a line 'constexpr int SIDE = NUMBER;'"
    with pytest.raises(ValueError, match="enumeration") as caught:
        enumerators("stages.h", "Field")
    assert str(caught.value) == "stages.h: expected an enumeration Field"
