"""A step's kernels under the compiler's sanitizers."""

import pytest
from emulation.sanitizers import run_sanitized

STEP = """
import sys
import torch
from emulation.launcher import EmulatedLauncher
from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate
from gsfw.kernels.cuda.operators import CudaOperators

operators = CudaOperators(EmulatedLauncher(sanitize=sys.argv[1]))
for shape in ((1, 17, 33, 3), (2, 1, 1, 1)):
    rendered = torch.rand(shape, requires_grad=True)
    valid = torch.rand(*shape[:3], 1) > 0.5
    sum(operators.l1_dssim(rendered, torch.rand(shape), valid)).backward()
values = torch.rand(301, 5, 3)
moments = AdamMoments.zeros_like(values)
finite = operators.all_finite([values, rendered.grad, torch.rand(8193)])
for rows in (None, torch.tensor([300, 7])):
    update = AdamUpdate(values, values.clone(), moments, 0.1, rows)
    operators.adam_([update], AdamSettings(), finite)
bands = AdamMoments(moments.first[:, :2], moments.second[:, :2], moments.count)
update = AdamUpdate(values[:, :2], values[:, :2].clone(), bands, 0.1)
operators.adam_([update], AdamSettings(), finite)
assert moments.count == 3
assert operators.neighbors(torch.rand(301, 4), 5).shape == (301, 5)
"""

FIELD = """
import sys
import torch
from emulation.launcher import EmulatedLauncher
from gsfw.kernels.cuda.operators import CudaOperators

operators = CudaOperators(EmulatedLauncher(sanitize=sys.argv[1]))
places = 2.4 * torch.rand(33, 3) - 1.2
places[0], places[1], places[2] = 1.0, torch.nan, torch.inf
places.requires_grad_()
planes = [torch.rand(3, side, side, 5, requires_grad=True) for side in (2, 7)]
lines = [torch.rand(3, side, 5, requires_grad=True) for side in (2, 7)]
tables = [torch.rand(rows, 3, requires_grad=True) for rows in (54, 16)]
quats = torch.rand(33, 4, requires_grad=True)
parts = [
    operators.plane_product(places, planes, lines, 1.0),
    operators.hash_features(places, torch.tensor(1.0), tables, [(3, 2), (30, 9)]),
    *operators.slices(quats, quats, quats),
    operators.squared_differences(planes[1], (1, 2), 1, 1.0),
    operators.squared_differences(lines[1], (1,), 2, 1.0),
    operators.mean_distance(lines[0], 1.0, 1.0),
]
sum(part.sum() for part in parts).backward()
assert all(table.grad.isfinite().all() for table in (*planes, *lines, *tables, quats))
"""


@pytest.mark.native("kernels", "core")
@pytest.mark.slow
@pytest.mark.parametrize("sanitize", ["address", "undefined"])
def test_a_field_touches_only_what_it_may(sanitize):
    done = run_sanitized(FIELD, sanitize)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.native("kernels", "core")
@pytest.mark.slow
@pytest.mark.parametrize("sanitize", ["address", "undefined"])
def test_a_step_touches_only_what_it_may(sanitize):
    done = run_sanitized(STEP, sanitize)
    assert (done.returncode, done.stderr) == (0, "")
