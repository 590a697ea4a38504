"""Memory of a tree in a file: what a view reads of a model that is larger than the bound.

    python benchmarks/level_of_detail_memory.py [GAUSSIANS] [BOUND_MB] [BUDGET]

Writes a made tree (random Gaussians of degree 3 on hills of 100 x 100 units) to a temporary file,
and opens it in a process of its own, which draws 12 views on a walk through it.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

WALK = """
import json, sys, time
import torch
from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings
from gsfw.commands.interface.detail import Detail, open_tree
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer
from pathlib import Path
path, bound, budget = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
begin = time.perf_counter()
status = lambda: Path("/proc/self/status").read_text().split("VmHWM:")[1]
peak = lambda: int(status().split()[0]) * 1024
layer = Layer(COMMAND_LINE, {"device": "cpu"})
run = open_tree(path, installed(), layer, Detail(budget, 0.0, bound))
parts, settings = run.composition.parts, run.composition.plan.settings
tree, world = parts.model.tree, run.composition.scene.world_from_scene
opened = time.perf_counter() - begin
before, seconds, drawn = peak(), [], []
for n in range(12):
    eye = torch.tensor([-40.0 + 7 * n, -3.0, -10.0], dtype=torch.float64)
    camera = Cameras.look_at(
        world.inverse().apply(eye), world.inverse().apply(eye + torch.tensor([3.0, 1.5, 10.0])),
        width=640, height=360,
    )
    camera = Cameras(camera.world_to_camera.float(), camera.intrinsics.float(), 640, 360)
    begin = time.perf_counter()
    splats = parts.model.splats(None, camera)
    seconds.append(time.perf_counter() - begin)
    drawn.append(len(splats))
    parts.rasterizer.render(splats, camera, settings)
print(json.dumps({
    "file_mb": path.stat().st_size / 1e6, "bound_mb": bound / 1e6, "opened_s": opened,
    "drawn": drawn[-1], "chunks_held_mb": tree.most_held / 1e6, "read_mb": tree.bytes_read / 1e6,
    "peak_before_mb": before / 1e6, "peak_after_mb": peak() / 1e6,
    "cut_s_median": sorted(seconds)[6],
}))
"""


def main() -> None:
    """Write the tree, walk through it, and print the figures."""
    import torch

    from gsfw.core.exchange import SplatFile
    from gsfw.core.splats import Sh, Splats
    from gsfw.lod.exporter import LodExporter

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gaussians", nargs="?", type=int, default=2_000_000)
    parser.add_argument("bound_mb", nargs="?", type=float, default=128.0)
    parser.add_argument("budget", nargs="?", default="50000")
    given = parser.parse_args()
    count, bound, budget = given.gaussians, given.bound_mb, given.budget
    random = torch.Generator().manual_seed(0)
    places = 100 * torch.rand(count, 3, generator=random) - 50
    places[:, 1] = (places[:, 0] / 9).sin() + (places[:, 2] / 7).cos()
    splats = Splats(
        means=places.double(),
        opacities=torch.rand(count, generator=random).double(),
        colors=Sh(0.3 * torch.randn(count, 16, 3, generator=random), 3),
        quats=torch.randn(count, 4, generator=random).double(),
        scales=0.03 * (0.2 + torch.rand(count, 3, generator=random)).double(),
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "hills.lod")
        LodExporter().write(path, SplatFile(splats))
        words = [sys.executable, "-c", WALK, str(path), str(int(bound * 1e6)), budget]
        found = subprocess.run(words, capture_output=True, text=True, check=True)
        for name, value in json.loads(found.stdout.splitlines()[-1]).items():
            print(f"{name:16} {value:.2f}")


if __name__ == "__main__":
    main()
