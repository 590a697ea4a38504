"""Write a splat file as SOG, here and with splat-transform: seconds, bytes, and what images lose.

    python benchmarks/sog.py splats.ply
    python benchmarks/sog.py splats.ply --peer path/to/splat-transform --palette 4096

PSNR is that of images on an orbit against those of the given splats. splat-transform runs without a
GPU (``-g cpu``), as this does; its k-means compares all pairs, which takes minutes from 20,000
splats on. Seconds of processor time tell more than those of the clock where other programs run.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import torch

import gsfw
from gsfw.core.cameras import Cameras
from gsfw.core.exchange import SplatFile
from gsfw.formats.ply import PlyImporter
from gsfw.formats.sog.exporter import SogExporter
from gsfw.formats.sog.importer import SogImporter


def main() -> None:
    """Compare, and print a line for each writer."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("file", type=Path, help="a 3DGS PLY")
    parser.add_argument("--peer", default="", help="splat-transform, to compare with")
    parser.add_argument("--palette", type=int, default=0, help="as format.palette")
    parser.add_argument("--frames", type=int, default=8, help="images on the orbit")
    parser.add_argument("--width", type=int, default=400, help="of the images, in pixels")
    options = parser.parse_args()
    given = PlyImporter().read(options.file)
    path = gsfw.load(options.file).camera_path("orbit", frames=options.frames, width=options.width)
    expected = images(given, path)
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = Path(folder) / "ours.sog", Path(folder) / "theirs.sog"
        clock, processor = time.perf_counter(), time.process_time()
        SogExporter(options.palette).write(ours, given)
        spent = f"{time.perf_counter() - clock:.1f} s, {time.process_time() - processor:.1f} of CPU"
        report("gsfw", spent, ours, given, expected, path)
        if options.peer:
            clock = time.perf_counter()
            command = [options.peer, "-w", "-g", "cpu", str(options.file), str(theirs)]
            subprocess.run(command, check=True, capture_output=True)
            spent = f"{time.perf_counter() - clock:.1f} s"
            report("splat-transform", spent, theirs, given, expected, path)


def images(content: SplatFile, path: Cameras) -> torch.Tensor:
    """The images of a file on a path, in [0, 1]."""
    splats = content.splats.map(lambda tensor: tensor.float())
    with torch.no_grad():
        return gsfw.render(splats, path).color.clamp(0, 1)


def report(
    name: str, spent: str, file: Path, given: SplatFile, expected: torch.Tensor, path: Cameras
) -> None:
    """Print seconds, bytes and PSNR of a file."""
    errors = (images(SogImporter().read(file), path) - expected).square().mean(dim=(1, 2, 3))
    loss = float((-10 * errors.log10()).mean())
    each = file.stat().st_size / len(given.splats)
    print(f"{name}: {spent}; {each:.1f} bytes for each of {len(given.splats)}; {loss:.2f} dB")


if __name__ == "__main__":
    main()
