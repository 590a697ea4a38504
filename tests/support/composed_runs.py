"""Composed runs whose images, losses and steps come from other parts."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from gsfw.core.callback import RunInfo
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.table import SplatTable
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve


def composed(settings: Mapping[str, str]) -> Composition:
    """A run of the built-in scene, unless ``settings`` say otherwise."""
    given = {"method": "3dgs", "rasterizer": "reference", "steps": "100", **settings}
    return compose(resolve(installed(), [Layer(COMMAND_LINE, given)]), installed())


def trainer_drawn_by(
    folder: Path, composition: Composition, rasterizer: Rasterizer, operators: Operators
) -> Trainer:
    """The trainer of a composed run, with the given parts instead of its own."""
    parts, plan = composition.parts, composition.plan
    optimizer = Optimizer(
        parts.model, operators, OptimizerSettings(), parts.corrections.parameter_groups()
    )
    parts = replace(
        parts,
        optimizer=optimizer,
        table=SplatTable(parts.model, optimizer),
        rasterizer=rasterizer,
        operators=operators,
    )
    info = RunInfo(folder, "3dgs", "test", plan.steps, 0, {}, {})
    return Trainer(parts, plan, RunFolder(folder), info)
