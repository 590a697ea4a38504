"""Processors: the catalogue of extremes on every instruction set and number of threads.

A processor decides which variant of a function runs: of gsfw's kernels (``GSFW_CPU_ISA``), of
torch (``ATEN_CPU_CAPABILITY``) and of the C library (``GLIBC_TUNABLES``), whose sine has other
roundings with and without fused multiplication. Each child process sees one such processor.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import random
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from campaign import Campaign, Detail, Outcome, Promise

THREADS = (1, 2, 3, 4, 7, 16)
"""Numbers of threads that have to give the same bits."""
ALWAYS = ("depth/to-1e9/fisheye-no-cut-offs",)
"""A case that missed its bound on an Intel Xeon, before bounds followed from the case."""
LARGE = ("image/16384x64", "layers/100000-of-0.5", "layers/5000-seen-through")
"""Cases that take as long as all others."""
NO_FMA = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX,-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW"
NO_AVX512 = "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW"
NEON = ("aarch64-linux-gnu-g++", "qemu-aarch64")
SUITE = "tests/kernels/cpu/test_emulation.py"


@dataclass(frozen=True)
class Processor:
    """A processor, as variables of the environment."""

    name: str
    variables: dict[str, str] = field(default_factory=dict)
    needs: str = "scalar"
    """Instruction set of gsfw's kernels that this machine must run."""


PROCESSORS = (
    Processor("this machine, as it is"),
    Processor("kernels: AVX-512", {"GSFW_CPU_ISA": "avx512"}, "avx512"),
    Processor(
        "kernels, torch and C library: AVX2",
        {"GSFW_CPU_ISA": "avx2", "ATEN_CPU_CAPABILITY": "avx2", "GLIBC_TUNABLES": NO_AVX512},
        "avx2",
    ),
    Processor("kernels: NEON", {"GSFW_CPU_ISA": "neon"}, "neon"),
    Processor("kernels: scalar", {"GSFW_CPU_ISA": "scalar"}),
    Processor(
        "scalar throughout, no fused multiplication in the C library",
        {"GSFW_CPU_ISA": "scalar", "ATEN_CPU_CAPABILITY": "default", "GLIBC_TUNABLES": NO_FMA},
    ),
)


@dataclass(frozen=True)
class Tried:
    """Cases that were drawn on a processor."""

    drawn: int
    """Drawings: cases in float32 and in float64."""
    faults: list[str]
    other_bits: list[str]
    """Drawings whose bits depend on the number of threads."""
    library: str
    """Checksum of the C library's functions: another one means that their roundings differ."""


def names_of_cases(size: int, seed: int) -> list[str]:
    """Names of ``size`` cases, the known one first."""
    from gsfw.studies.stress.case import Section
    from gsfw.studies.stress.catalogue import CASES

    small = [
        name
        for name, case in CASES.items()
        if case.section not in (Section.SIZE, Section.INPUT) and name not in (*LARGE, *ALWAYS)
    ]
    random.Random(seed).shuffle(small)
    return [*ALWAYS, *small][:size]


def draw(names: Sequence[str], rasterizer: object, threads: Sequence[int] = THREADS) -> Tried:
    """Draw cases in both types with several numbers of threads, and judge them.

    Args:
        names: of cases.
        rasterizer: a ``Rasterizer``.
        threads: numbers of threads.
    """
    import torch

    from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
    from gsfw.studies.entrants import Entrant
    from gsfw.studies.stress.catalogue import CASES
    from gsfw.studies.stress.measure import Oracle, measure

    able = rasterizer.capabilities()  # type: ignore[attr-defined]
    entrant = Entrant("cpu", rasterizer, able, torch.device("cpu"), tuple(threads))  # type: ignore[arg-type]
    oracle, faults, other_bits, drawn = Oracle(ReferenceRasterizer()), [], [], 0
    for name in names:
        for dtype in (torch.float32, torch.float64):
            result = measure(entrant, CASES[name], dtype, oracle)
            drawn += 1
            told = [f"{name}, {result.dtype}: {fault}" for fault in result.faults]
            bits = [line for line in told if "other bits" in line]
            other_bits += bits
            faults += [line for line in told if line not in bits]
    return Tried(drawn, faults, other_bits, _library())


def _library() -> str:
    lot, digest = random.Random(0), hashlib.sha256()
    for function in (math.sin, math.exp, math.atan, math.log):
        for _ in range(20_000):
            digest.update(struct.pack("d", function(lot.uniform(0.001, 20.0))))
    return digest.hexdigest()[:8]


def available() -> list[Processor]:
    """Processors that this machine can be."""
    from gsfw.kernels.cpu.native_module import instruction_sets

    return [each for each in PROCESSORS if each.needs in instruction_sets()]


def on(processor: Processor, names: Sequence[str]) -> Tried:
    """Draw cases in a process that sees a processor.

    Raises:
        RuntimeError: the process failed.
    """
    done = subprocess.run(
        (sys.executable, __file__, json.dumps(list(names))),
        env=os.environ | processor.variables,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{processor.name}: exit {done.returncode}: {done.stderr[-500:]}")
    return Tried(**json.loads(done.stdout.splitlines()[-1]))


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Draw ``size`` cases on every processor that this machine can be."""
    names, failures, rows = names_of_cases(size, seed), [], []
    drawn = faults = other_bits = 0
    for processor in available():
        tried = on(processor, names)
        say(f"{processor.name}: {tried.drawn} drawings, {len(tried.faults)} faults")
        drawn, faults = drawn + tried.drawn, faults + len(tried.faults)
        other_bits += len(tried.other_bits)
        failures += [f"{processor.name}: {line}" for line in tried.faults + tried.other_bits]
        counts = (tried.drawn, len(tried.faults), len(tried.other_bits))
        rows.append((processor.name, tried.library, *counts))
    can_emulate = all(map(shutil.which, NEON))
    for each in PROCESSORS:
        if each not in available():
            where = f"here; {SUITE} runs it under qemu-user" if each.needs == "neon" else "here"
            tools = "" if can_emulate or each.needs != "neon" else " (its tools are missing here)"
            rows.append((f"{each.name}: not {where}{tools}", "-", 0, 0, 0))
    drawings = f"{drawn:,} drawings of {len(names)} extremes as {len(available())} processors"
    return Outcome(
        [
            Promise(
                "Renders and gradients stay within their error bounds with every x86 instruction "
                "set, and every variant of torch and the C library.",
                "The catalogue of extremes, in float32 and float64, forward and backward, against "
                "the reference. One machine stands for several processors, by environment "
                "variables; no other make of processor was available.",
                f"{drawings}, {faults} beyond their bounds",
                faults == 0,
            ),
            Promise(
                "The CPU gives the same bits for any number of threads.",
                f"Each drawing with {', '.join(map(str, THREADS))} threads.",
                f"{drawings}, {other_bits} with other bits",
                other_bits == 0,
            ),
        ],
        [
            Detail(
                "Processors:",
                ("processor", "C library", "drawings", "beyond bounds", "other bits"),
                rows,
            )
        ],
        failures,
    )


CAMPAIGN = Campaign("processors", "instruction sets, libraries and threads", "extremes", 60, run)

if __name__ == "__main__":
    from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer

    found = draw(json.loads(sys.argv[1]), CpuRasterizer())
    Path("/dev/stdout").write_text(json.dumps(found.__dict__) + "\n")
