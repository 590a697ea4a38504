"""Native stereo agrees with plain torch, and has the same bits for any number of threads."""

from collections.abc import Callable

import pytest
import torch
from support.textured_plane import DEPTH, views_of_a_plane

from gsfw.core.operators import Operators
from gsfw.core.stereo.fusion import FusionRule
from gsfw.core.stereo.plans import SweepPlan
from gsfw.kernels.cpu.native_module import instruction_sets, native, required
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.skipif(native() is None, reason="the native module was not built")

PLANS = [
    SweepPlan(0, (1, 2), 2.0, 10.0, 33),
    SweepPlan(1, (0, 2, 3), 2.0, 10.0, 16),
    SweepPlan(3, (2,), 3.0, 6.0, 20),
]
HEIGHTS = (36, 17, 36, 29)
"""No multiple of anything, and different."""


@pytest.fixture(params=instruction_sets())
def instruction_set(request: pytest.FixtureRequest):
    before = required().instruction_set()
    required().use_instruction_set(request.param)
    yield request.param
    required().use_instruction_set(before)


@pytest.mark.usefixtures("instruction_set")
def test_sweeps_agree_with_plain_torch():
    views = views_of_a_plane(4, heights=HEIGHTS)
    for one, other in zip(
        CpuOperators().sweep_views(views, PLANS), Operators().sweep_views(views, PLANS), strict=True
    ):
        near = ((one.depths - other.depths).abs() < 0.02 * DEPTH).float().mean()
        assert near > 0.95, "8 bits of costs choose another plane where two fit"
        assert (one.scores - other.scores).abs().median() < 0.01
        assert (one.contrasts - other.contrasts).abs().median() < 0.01


def test_fusion_agrees_with_plain_torch():
    views = views_of_a_plane(4, heights=HEIGHTS)
    generator = torch.Generator().manual_seed(0)
    depths = [
        DEPTH * (1 + 0.02 * torch.randn(image.shape[:2], generator=generator))
        for image in views.colors
    ]
    depths[0][:5] = 0.0
    views.empty[2][20:, 20:] = True
    others = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [2, 1]]
    rule = FusionRule(contradictions=0)
    one = CpuOperators().fuse_views(views, depths, others, rule)
    other = Operators().fuse_views(views, depths, others, rule)
    for a, b in zip(one, other, strict=True):
        assert (a.kept == b.kept).float().mean() > 0.998
        assert (a.confirmed == b.confirmed).float().mean() > 0.998
        both = a.kept & b.kept
        assert torch.allclose(a.points[both], b.points[both], atol=1e-5)
    assert sum(int(image.kept.sum()) for image in one) > 100


def test_results_do_not_depend_on_the_number_of_threads(use_threads: Callable[[int], None]):
    views = views_of_a_plane(4, heights=HEIGHTS)
    results = []
    for threads in (1, 3):
        use_threads(threads)
        operators = CpuOperators()
        swept = operators.sweep_views(views, PLANS)
        depths = [torch.zeros(views.size(view)) for view in range(4)]
        for plan, image in zip(PLANS, swept, strict=True):
            depths[plan.view] = image.depths
        fused = operators.fuse_views(views, depths, [[1, 3], [0, 3], [], [0, 1]], FusionRule())
        results.append([*swept, *fused])
    for one, other in zip(*results, strict=True):
        for name in vars(one):
            assert torch.equal(getattr(one, name), getattr(other, name))


def test_a_plan_that_makes_no_sense_is_refused():
    views = views_of_a_plane()
    for plan in (
        SweepPlan(0, (7,), 2.0, 10.0, 20),
        SweepPlan(0, (), 2.0, 10.0, 20),
        SweepPlan(0, (1,), 2.0, 1.0, 20),
        SweepPlan(0, (1,), 2.0, 3.0, 100_000),
    ):
        with pytest.raises(ValueError, match=r"neighbour|depths|planes"):
            CpuOperators().sweep_views(views, [plan])


def test_no_plans_give_no_depths():
    assert CpuOperators().sweep_views(views_of_a_plane(), []) == []
