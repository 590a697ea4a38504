"""What an ordinary step of 3dgs asks of the host: a small scene waits for it, not for the GPU."""

from dataclasses import replace

import pytest
from support.calls import Calls, CountedLauncher

from gsfw.core import render_output
from gsfw.core.callback import RunInfo
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.table import SplatTable
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer

SETTINGS = {
    **{"method": "3dgs", "rasterizer": "reference", "steps": "100", "strategy": "adc"},
    **{"sh_degree": "1", "sh_degree_interval": "1"},
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


def trainer_on(launcher: CountedLauncher, folder) -> Trainer:
    """A run whose images, losses and steps come from the CUDA kernels, before its second step."""
    composition = compose(resolve(installed(), [Layer(COMMAND_LINE, SETTINGS)]), installed())
    parts, plan = composition.parts, composition.plan
    operators = CudaOperators(launcher)
    optimizer = Optimizer(parts.model, operators, OptimizerSettings())
    parts = replace(
        parts,
        optimizer=optimizer,
        table=SplatTable(parts.model, optimizer),
        rasterizer=CudaRasterizer(launcher),
        operators=operators,
    )
    plan = replace(plan, log_every=1000, max_skipped=1000)
    info = RunInfo(folder, "3dgs", "test", 100, 0, {}, {})
    trainer = Trainer(parts, plan, RunFolder(folder), info)
    trainer.step = 1  # The first step is logged.
    return trainer


def test_a_step_makes_few_calls(tmp_path, monkeypatch):
    # On a GPU the host does not know if a step was finite.
    monkeypatch.setattr(render_output, "known_by_host", lambda flag: False)
    launcher = CountedLauncher()
    trainer = trainer_on(launcher, tmp_path)
    for _ in range(2):
        trainer._one_step()
    with Calls(launcher) as calls:
        trainer._one_step()
    assert [name.partition("<")[0] for name in calls.launches] == LAUNCHES
    assert len(calls.operations) <= MOST_OPERATIONS, calls.operations
