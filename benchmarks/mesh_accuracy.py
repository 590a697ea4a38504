"""Distances of the mesh of a run on the built-in still scene from its true surface.

    gsfw train method=3dgs datamanager.width=240 datamanager.height=180 steps=1000 out=runs/built-in
    python benchmarks/mesh_accuracy.py runs/built-in [--resolutions 96 160 256]

Prints a Markdown table: triangles, processor seconds of the fusion, and distances in units of the
world, in which the scene is 3 wide.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from printing import say
from support.true_surface import distances, true_surface

from gsfw.core.loop.run_folder import RunFolder
from gsfw.formats.mesh.exporter import MeshExporter
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore
from gsfw.plugins.run_source import RunSource

HEAD = (
    "| `resolution` | triangles | CPU s | to the surface: median | 95 % | from it: median | 95 % |"
)


def main() -> None:
    """Measure a run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--resolutions", type=int, nargs="+", default=[96, 160, 256])
    asked = parser.parse_args()
    views = RunSource(restore(RunFolder(asked.run), installed())).depth_views()
    surface = true_surface()
    say(HEAD)
    say("| ---: " * 7 + "|")
    for resolution in asked.resolutions:
        began = time.process_time()
        mesh = MeshExporter(resolution=resolution).mesh(views)
        seconds = time.process_time() - began
        found = distances(mesh.vertices, surface)
        figures = " | ".join(f"{value:.4f}" for value in (*found.accuracy, *found.completeness))
        say(f"| {resolution} | {len(mesh.triangles):,} | {seconds:.0f} | {figures} |")


if __name__ == "__main__":
    main()
