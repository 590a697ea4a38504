"""A model with a column of every layout, for tests of the row machinery."""

import torch

from gsfw.core.column import Column, Layout
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.model import DensifiableModel, PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.splats import Splats
from gsfw.core.table import SplatTable

LENGTHS = (1, 4, 0, 9, 4, 1, 2)
"""Values of each row of the ragged column, repeated as often as needed."""


class MixedModel(DensifiableModel):
    """Every value of row i of a column is i plus a little; ``labels`` is a buffer."""

    def __init__(self, n: int, dtype: torch.dtype = torch.float64, bands: int = 3) -> None:
        super().__init__()
        rate = LearningRate(0.1)
        generator = torch.Generator().manual_seed(n)

        def filled(*shape: int) -> torch.Tensor:
            return torch.rand(*shape, generator=generator, dtype=dtype) / 2

        index = torch.arange(n, dtype=dtype)
        lengths = torch.tensor([LENGTHS[i % len(LENGTHS)] for i in range(n)], dtype=torch.int64)
        offsets = torch.cat([torch.zeros(1, dtype=torch.int64), lengths.cumsum(0)])
        owner = index.repeat_interleave(lengths)
        self.dense = Column(filled(n, 2) + index[:, None], rate)
        self.stacked = Column(filled(3, n, 2) + index[:, None], rate, Layout.STACKED)
        self.ragged = Column(
            filled(len(owner), 2) + owner[:, None], rate, Layout.RAGGED, offsets=offsets
        )
        self.labels = Column(index.clone())
        self.banded = Column(filled(n, bands, 2) + index[:, None, None], rate, bands=True)
        self.network = torch.nn.Linear(2, 3, dtype=dtype)
        with torch.no_grad():
            self.network.weight.fill_(0.5)
            self.network.bias.fill_(-0.2)
        self.active: int | None = None

    def columns(self):
        return {
            "dense": self.dense,
            "stacked": self.stacked,
            "ragged": self.ragged,
            "labels": self.labels,
            "banded": self.banded,
        }

    def parameter_groups(self):
        parameters = tuple(self.network.parameters())
        return (ParameterGroup("network", parameters, LearningRate(0.01), weight_decay=0.1),)

    def active_bands(self):
        return self.active

    def splats(self, time=None, cameras=None) -> Splats:
        raise NotImplementedError

    def opacities(self):
        return torch.full((self.num_rows,), 0.5, dtype=torch.float64)

    def sizes(self):
        return torch.ones(self.num_rows, dtype=torch.float64)

    def split_rows(self, rows, copies, generator):
        return self.clone_rows(rows.repeat(copies))

    def rows_at(self, points, colors, sizes, time):
        return self.clone_rows(torch.arange(len(points)) % self.num_rows)

    def relocated(self, rows, counts):
        return self.clone_rows(rows)

    def perturb_(self, rate, generator, operators):
        pass

    def change_opacities_(self, function):
        return ()


def row_values(column: Column, values: torch.Tensor | None = None) -> list[list[float]]:
    """The values of each row of a column (or of its moments) as plain lists."""
    values = column.values if values is None else values
    rows = (column.take(torch.tensor([i]), values).values for i in range(column.num_rows))
    return [row.flatten().tolist() for row in rows]


def with_optimizer(model: PrimitiveModel) -> tuple[Optimizer, SplatTable]:
    """An optimizer whose moments differ from row to row, and the table over both."""
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    for name, column in model.columns().items():
        if column.trained:
            for moments in optimizer.moments(name):
                moments.first.copy_(column.values.detach() + 1000)
                moments.second.copy_(column.values.detach() + 2000)
                moments.count.fill_(5)
    return optimizer, SplatTable(model, optimizer)
