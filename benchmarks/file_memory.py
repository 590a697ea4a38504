"""Memory of splat files: the peak of writing and of reading one, each in a process of its own.

    python benchmarks/file_memory.py 1000000 ply compressed-ply splat

Prints, in MB: the splats in memory (float64, colours float32, as importers return them), and what
writing and reading need besides them. A degree of 3 is 280 bytes a splat in memory.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import torch

from gsfw.core.exchange import Exporter, Importer, SplatFile
from gsfw.core.splats import Sh, Splats
from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed

DEGREE = 3


def made(count: int) -> Splats:
    """Random splats, made without temporary copies."""
    generator = torch.Generator().manual_seed(0)

    def uniform(*shape: int, kind: torch.dtype = torch.float64) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=kind)

    width = (DEGREE + 1) ** 2
    return Splats(
        means=uniform(count, 3),
        opacities=uniform(count),
        colors=Sh(uniform(count, width, 3, kind=torch.float32), DEGREE),
        quats=uniform(count, 4).add_(0.1),
        scales=uniform(count, 3).mul_(0.01),
    )


def megabytes(splats: Splats) -> float:
    """Size of the tensors."""
    return sum(tensor.nbytes for tensor in splats.tensors().values()) / 1e6


def peak() -> float:
    """Largest memory of this process so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def measure(action: str, form: str, path: Path, count: int) -> None:
    """Write or read one file, and print the memory of the splats, and the peak above it."""
    exporter: Exporter = load("exporter", installed().find("exporter", form))()
    # What is imported on the way counts as the process, not as the file.
    few = path.with_name(f"few{exporter.suffix}")
    exporter.write(few, SplatFile(made(300)))
    importer: Importer = load("importer", installed().find("importer", form))()
    importer.read(few)
    before = peak()
    if action == "write":
        splats = made(count)
        exporter.write(path, SplatFile(splats))
    else:
        splats = importer.read(path).splats
    sys.stdout.write(f"{megabytes(splats)} {peak() - before - megabytes(splats)}\n")


def main(words: list[str]) -> None:
    """Measure each format in processes of their own."""
    if words[:1] == ["measure"]:
        measure(words[1], words[2], Path(words[3]), int(words[4]))
        return
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("count", type=int, metavar="SPLATS")
    parser.add_argument("forms", nargs="+", metavar="FORMAT")
    given = parser.parse_args(words)
    count, forms = given.count, given.forms
    sys.stdout.write(f"{count:,} splats of degree {DEGREE}; MB\n")
    sys.stdout.write("format           file  splats  writing  reading\n")
    for form in forms:
        kind: type[Exporter] = load("exporter", installed().find("exporter", form))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"splats{kind.suffix}"
            needs = []
            for action in ("write", "read"):
                command = [sys.executable, __file__, "measure", action, form, str(path), str(count)]
                run = subprocess.run(command, capture_output=True, text=True, check=True)
                needs.append(tuple(map(float, run.stdout.split())))
            size = path.stat().st_size / 1e6
        (held, writing), (_, reading) = needs
        sys.stdout.write(f"{form:14} {size:6.0f} {held:7.0f} {writing:8.0f} {reading:8.0f}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
