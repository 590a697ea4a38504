"""Tests of gsfw.kernels.cuda.architecture."""

import pytest

from gsfw.kernels.cuda.architecture import Target, choose_target
from gsfw.kernels.cuda.errors import CudaError

NVRTC_13 = [75, 80, 86, 87, 88, 89, 90, 100, 103, 110, 120, 121]
NVRTC_12 = [50, 52, 53, 60, 61, 62, 70, 72, 75, 80, 86, 87, 89, 90, 100, 101, 120]


@pytest.mark.parametrize(
    ("device", "supported", "expected"),
    [
        (90, NVRTC_13, "sm_90"),
        (75, NVRTC_13, "sm_75"),
        (121, NVRTC_13, "sm_121"),
        # Newer than the compiler knows, of a major version that it knows.
        (89, [75, 80, 86], "sm_86"),
        (103, NVRTC_12, "sm_101"),
        # Of a major version that the compiler does not know.
        (130, NVRTC_13, "compute_121"),
        (110, NVRTC_12, "compute_101"),
        # Old devices with an old compiler.
        (70, NVRTC_12, "sm_70"),
        (72, NVRTC_12, "sm_72"),
    ],
)
def test_devices_get_the_best_the_compiler_can_make(device, supported, expected):
    assert choose_target(device, supported).name == expected


def test_machine_code_and_ptx_are_told_apart():
    assert choose_target(90, NVRTC_13) == Target("cubin", 90)
    assert choose_target(200, NVRTC_13) == Target("ptx", 121)


@pytest.mark.parametrize(
    ("device", "supported", "found", "needed"),
    [(70, NVRTC_13, "7.0", "7.5"), (61, NVRTC_12, "6.1", "7.0"), (61, [50, 52], "6.1", "7.0")],
)
def test_devices_too_old_are_refused_with_what_is_needed(device, supported, found, needed):
    with pytest.raises(CudaError) as error:
        choose_target(device, supported)
    assert str(error.value) == (
        f"the GPU has compute capability {found}; this CUDA compiler and these kernels need "
        f"{needed} or newer.\n"
        "Volta (7.0) needs a torch built for CUDA 12, older GPUs are not supported: "
        "use rasterizer=cpu."
    )
