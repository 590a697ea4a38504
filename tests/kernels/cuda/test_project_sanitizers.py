"""Projection under the compiler's sanitizers."""

import pytest
from emulation.sanitizers import run_sanitized

PROJECT = """
import sys
import torch
from emulation.launcher import EmulatedLauncher
from support.projection_jobs import SCENES, projected, run_backward, scene_of

launcher = EmulatedLauncher(sanitize=sys.argv[1])
for name in ("SH in two parts", "channels", "ragged beyond the active degree"):
    projection = projected(scene_of(name, torch.float32), launcher)
    fields = 6 + projection.channels + 2
    found = run_backward(launcher, projection, torch.rand(len(projection.radii), fields))
    run_backward(launcher, projection, torch.rand(len(projection.radii), fields), None,
                 found.gradients)
    ends = projection.tile_counts.cumsum(0)
    run_backward(launcher, projection, torch.rand(int(ends[-1]), fields), ends)
"""


@pytest.mark.native("kernels", "core", "rasterizers", "tests/support")
@pytest.mark.slow
@pytest.mark.parametrize("sanitize", ["address", "undefined"])
def test_projection_touches_only_what_it_may(sanitize):
    done = run_sanitized(PROJECT, sanitize)
    assert (done.returncode, done.stderr) == (0, "")
