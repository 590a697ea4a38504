"""Tests of gsfw.kernels.cuda.nvrtc, and the proof that every kernel compiles for every GPU."""

import os
import re
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import pytest
import torch

from gsfw.kernels.cuda.architecture import Target
from gsfw.kernels.cuda.catalogue import catalogue
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.launcher import Entry
from gsfw.kernels.cuda.nvrtc import OPTIONS, Compiled, Nvrtc
from gsfw.kernels.cuda.program import NAMESPACE, program_text
from gsfw.kernels.cuda.source_files import SHARED, SOURCES, headers, source_text

ARCHITECTURES = (75, 89, 90, 100, 120)
"""Without 80 and 86: none of 53 instances needs more registers there than on all of these (NVRTC
13.5), and no source has code of their own."""
MAIN = 90
"""The architecture for which even rare instances are compiled."""

REGISTERS = {
    "project": 80,
    "project_backward": 96,
    "project_backward<float, Axes<float>, 3, true, false>": 128,
    "blend": 128,
    "blend<float, 3, 128, false>": 64,
    "blend_backward": 232,
    "blend_backward<float, 3, 128, 32, false>": 128,
    "blend_backward<float, 3, 128, 32, true>": 128,
    "emit": 48,
    "find_tiles": 40,
    "sum_counts": 48,
    "count_digits": 32,
    "scatter": 64,
    "ssim": 64,
    "ssim_backward": 64,
    "add_losses": 64,
    "begin_adam": 40,
    "adam": 48,
    "check_finite": 48,
    "neighbors": 64,
    "neighbors<float, 3, 24>": 128,
    "plane_product": 64,
    "plane_product_backward": 64,
    "hash_features": 64,
    "hash_features_backward": 64,
    "slice": 64,
    "slice_backward": 128,
    "grid_variation": 48,
    "grid_variation_backward": 48,
    "grid_distance": 48,
    "grid_distance_backward": 48,
    "add_penalty": 48,
    **{
        f"project<float, {shape}, {degree}, true>": 96
        for shape in ("Axes<float>", "Symmetric3<float>")
        for degree in (1, 2, 3, 4)
    },
}
"""Most registers of a thread, for numbers of 32 bits, on any architecture: of a kernel, or of one
instance of it."""

HELLO = """
namespace hello {
template <class T> __global__ void fill(T* out, T value) { out[threadIdx.x] = value; }
}
"""


@dataclass(frozen=True)
class Usage:
    """What ptxas says that a kernel uses."""

    registers: int
    stack: int
    spilled: int


def usage_of(compiled: Compiled) -> dict[str, Usage]:
    """Of each expression."""
    used = {}
    for expression, name in compiled.names.items():
        said = compiled.log.partition(f"Compiling entry function '{name}'")[2]
        said = said.partition("Compiling entry function")[0]
        spilling = r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads"
        memory = re.search(rf"Function properties for {name}\s.*?{spilling}", said, re.DOTALL)
        registers = re.search(r"Used (\d+) registers", said)
        assert memory is not None
        assert registers is not None
        stack, stores, loads = map(int, memory.groups())
        usage = Usage(int(registers[1]), stack, stores + loads)
        used[expression.removeprefix(f"{NAMESPACE}::")] = usage
    return used


def entries_of(number: str, architecture: int) -> list[Entry]:
    """Rare instances only once: their code is the same but for a constant."""
    if (number, architecture) == ("float", MAIN):
        return catalogue()
    dtype = {"float": torch.float32, "double": torch.float64}[number]
    return catalogue(dtype, degrees=(-1, 3))


FILES = sorted({kernel.source for kernel, _ in catalogue()})


@pytest.fixture(scope="module")
def compilations(nvrtc: Nvrtc) -> dict[tuple[str, int, str], Future[Compiled]]:
    """Every source for every architecture, its instances at once so that headers are read once."""

    def compile_source(number: str, architecture: int, source: str) -> Compiled:
        entries = [entry for entry in entries_of(number, architecture) if entry[0].source == source]
        return nvrtc.compile(
            program_text(source, dict.fromkeys(job for _, job in entries)),
            {**headers(), source: source_text(source)},
            Target("cubin", architecture),
            [f"{NAMESPACE}::{kernel.expression}" for kernel, _ in entries],
            [*OPTIONS, "--ptxas-options=-v"],
        )

    wanted = [("double", MAIN, source) for source in FILES]
    wanted += [
        ("float", architecture, source)
        for architecture in ARCHITECTURES
        if architecture in nvrtc.architectures
        for source in FILES
    ]
    wanted.sort(key=lambda item: "backward" not in item[2])  # The slowest ones first.
    threads = ThreadPoolExecutor(os.cpu_count())
    return {item: threads.submit(compile_source, *item) for item in wanted}


@pytest.mark.native("kernels/cuda", "kernels/shared")
@pytest.mark.slow
@pytest.mark.parametrize("source", FILES)
@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_kernels_fit_their_registers_on_every_architecture(compilations, architecture, source):
    if ("float", architecture, source) not in compilations:
        pytest.skip(f"this NVRTC does not compile for sm_{architecture}")
    used = usage_of(compilations["float", architecture, source].result())
    for expression, usage in used.items():
        budget = REGISTERS.get(expression) or REGISTERS[expression.partition("<")[0]]
        assert usage.registers <= budget, f"{expression}: {usage}"
        assert usage.stack == usage.spilled == 0, f"{expression}: {usage}"
    expected = {
        kernel.expression
        for kernel, _ in entries_of("float", architecture)
        if kernel.source == source
    }
    assert set(used) == expected


@pytest.mark.native("kernels/cuda", "kernels/shared")
@pytest.mark.slow
@pytest.mark.parametrize("source", FILES)
def test_kernels_compile_for_double_precision_too(compilations, source):
    for expression, usage in usage_of(compilations["double", MAIN, source].result()).items():
        assert usage.registers <= 255, f"{expression}: {usage}"


def test_every_file_of_kernels_is_in_the_catalogue():
    assert [path.name for path in sorted(SOURCES.glob("*.cu"))] == FILES


def test_headers_have_names_of_their_own():
    names = [path.name for folder in (SHARED, SOURCES) for path in folder.glob("*.h")]
    assert sorted(names) == sorted(headers())


def test_the_compiler_tells_its_version_and_what_it_compiles_for(nvrtc):
    assert nvrtc.version >= (12, 0)
    assert {75, 80, 86, 89, 90} <= set(nvrtc.architectures)


def test_machine_code_and_ptx_come_with_the_names_in_them(nvrtc):
    expression = "hello::fill<float>"
    for target, start in ((Target("cubin", 80), b"\x7fELF"), (Target("ptx", 80), b"//")):
        compiled = nvrtc.compile(HELLO, {}, target, [expression])
        assert compiled.code.startswith(start)
        assert compiled.names[expression].encode() in compiled.code
        assert compiled.log == ""
    assert compiled.code.endswith(b"\0")  # The driver reads PTX up to there.


def test_what_does_not_compile_is_an_error_with_the_log(nvrtc):
    text = '#include "wrong.h"\n'
    with pytest.raises(CudaError) as error:
        nvrtc.compile(text, {"wrong.h": "int x = no_such_name;"}, Target("cubin", 80), [])
    version = "{}.{}".format(*nvrtc.version)
    assert error.value.message.startswith(
        f"NVRTC {version} at {nvrtc.path} could not compile a kernel with "
        "--gpu-architecture=sm_80 --std=c++17: NVRTC_ERROR_COMPILATION\n"
    )
    assert 'wrong.h(1): error: identifier "no_such_name" is undefined' in error.value.message
    assert error.value.advice == (
        "This is a fault of gsfw or of its installation; please report it with this message. "
        "Until then, use rasterizer=cpu."
    )


def test_a_kernel_that_is_not_there_is_an_error(nvrtc):
    with pytest.raises(CudaError, match="could not compile"):
        nvrtc.compile(HELLO, {}, Target("cubin", 80), ["hello::missing<float>"])


def test_a_file_that_is_no_library_is_refused(tmp_path):
    path = tmp_path / "libnvrtc.so.13"
    path.write_text("nothing")
    with pytest.raises(CudaError, match=r"^NVRTC at .*libnvrtc.so.13 does not load: "):
        Nvrtc(path)


@pytest.mark.skipif(sys.platform != "linux", reason="reads what a process has loaded from /proc")
def test_the_second_library_of_the_compiler_is_loaded_with_the_first(nvrtc):
    code = (
        "from gsfw.kernels.cuda.nvrtc import Nvrtc\n"
        f"Nvrtc({str(nvrtc.path)!r})\n"
        "print('libnvrtc-builtins' in open('/proc/self/maps').read())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"
