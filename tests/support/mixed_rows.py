"""Small models of every method for moving scenes, some of whose rows stand still."""

from dataclasses import replace

import torch

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.table import SplatTable
from gsfw.methods.gaussians4d.config import DeformationConfig, HexPlaneConfig
from gsfw.methods.moving.gaussians import MovingGaussians
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig
from gsfw.methods.spacetime.config import SpacetimeConfig
from gsfw.scaffold.names import PartName
from gsfw.scaffold.package import package_files
from support.moving_splats import moving_scene
from support.page_plugins import module_of
from support.scenes import random_splats

WRITTEN = module_of(package_files("method", PartName("written"), "moving")["written/method.py"])
"""The method that ``gsfw new method written like=moving`` writes."""

CONFIGS = {
    "spacetime": SpacetimeConfig(sh_degree=1),
    "adaptive": SpacetimeConfig(sh_degree=1, motion="adaptive"),
    "features": SpacetimeConfig(colors="features"),
    "4d-rotor": SlicedGaussiansConfig(sh_degree=1),
    "two-quaternions": SlicedGaussiansConfig(sh_degree=1, rotation="two-quaternions"),
    "4dgs": DeformationConfig(
        sh_degree=1,
        hexplane=HexPlaneConfig(channels=4, resolution=4, width=6),
        deform_opacity=True,
        deform_sh=True,
    ),
    "sum of scales": DeformationConfig(
        sh_degree=1,
        hexplane=HexPlaneConfig(channels=4, resolution=4, width=6),
        scale_change="sum",
    ),
    "written": WRITTEN.WrittenConfig(sh_degree=1),
}


def standing(method: str, n: int = 16, **settings) -> tuple[MovingGaussians, SplatTable]:
    """A model all of whose rows stand still, in float64, and the table over it."""
    config = replace(CONFIGS[method], static="auto", **settings)
    generator = torch.Generator().manual_seed(3)
    degree = 0 if method == "features" else 1
    model = config.build().build_model(
        moving_scene(), Operators(), generator, random_splats(n, degree=degree)
    )
    assert isinstance(model, MovingGaussians)
    model.double()
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    return model, SplatTable(model, optimizer)


def mixed(method: str, n: int = 16, **settings) -> tuple[MovingGaussians, SplatTable]:
    """The same with every third row moving, by parameters drawn at random."""
    model, table = standing(method, n, **settings)
    rows = torch.arange(0, n, 3)
    model.start_(table, rows, torch.full((len(rows),), 0.4, dtype=torch.float64))
    shake_(model)
    return model, table


@torch.no_grad()
def shake_(model: MovingGaussians, strength: float = 0.2) -> None:
    """Move whatever changes rows with time, at random."""
    generator = torch.Generator().manual_seed(7)
    tensors = [column.values for column in model.temporal_columns().values()]
    tensors += [tensor for group in model.parameter_groups() for tensor in group.parameters]
    for tensor in tensors:
        noise = torch.randn(tensor.shape, generator=generator, dtype=torch.float64)
        tensor.add_(strength * noise.to(tensor))
    columns = model.temporal_columns()
    if "log_durations" in columns:
        columns["log_durations"].values.sub_(2.5)
    model.project_()


def check_rows(model: MovingGaussians, table: SplatTable) -> None:
    """Every row has exactly what it needs, in the columns and in the optimizer's moments."""
    assert model.still is not None
    still = model.still.mask()
    assert len(still) == len(table)
    for name, column in model.columns().items():
        assert column.num_rows == len(table), name
        lengths = torch.ones(len(table)) if column.offsets is None else column.offsets.diff()
        if name in model.temporal_columns():
            assert torch.equal(lengths.bool(), ~still), name
        assert int(lengths.sum()) == len(column.values), name
        if column.trained:
            for moments in table._optimizer.moments(name):
                assert moments.first.shape == moments.second.shape == column.values.shape, name
    assert torch.equal(model.still.stillness.offsets.diff() > 0, still)
