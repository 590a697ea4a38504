"""What an ordinary step of 3dgs asks of the host: a small scene waits for it, not for the GPU."""

import pytest
from support.calls import Calls, CountedLauncher
from support.composed_runs import composed, trainer_drawn_by

from gsfw.core import render_output
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer

SETTINGS = {
    **{"strategy": "adc", "sh_degree": "1", "sh_degree_interval": "1"},
    **{"log_every": "1000", "max_skipped": "1000"},
    **{"datamanager.views": "6", "datamanager.eval_views": "2", "datamanager.points": "150"},
    **{"datamanager.width": "96", "datamanager.height": "96"},
}

LAUNCHES = [
    *("project", "count_digits", *["scatter"] * 4, "sum_counts", "emit"),
    *("count_digits", "scatter", "find_tiles", "blend", "ssim", "add_losses"),
    *("ssim_backward", "blend_backward", "project_backward"),
    *("check_finite", "begin_adam", "adam"),
]
"""Wider images take a second pass to sort by tile."""

MOST_OPERATIONS = 103
"""Operations of torch 2.6; 2.13 has 98. More than half of them are views, allocations, and what the
watch itself adds."""

# Whole compositions; shapes are checked by the tests of the parts.
pytestmark = pytest.mark.unchecked


def test_a_step_makes_few_calls(tmp_path, monkeypatch):
    # On a GPU the host does not know if a step was finite.
    monkeypatch.setattr(render_output, "known_by_host", lambda flag: False)
    launcher = CountedLauncher()
    trainer = trainer_drawn_by(
        tmp_path, composed(SETTINGS), CudaRasterizer(launcher), CudaOperators(launcher)
    )
    trainer.step = 1  # The first step is logged.
    for _ in range(2):
        trainer._one_step()
    with Calls(launcher) as calls:
        trainer._one_step()
    assert [name.partition("<")[0] for name in calls.launches] == LAUNCHES
    assert len(calls.operations) <= MOST_OPERATIONS, calls.operations
