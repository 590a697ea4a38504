"""Tests of gsfw.plugins.compose: what does not fit together is said before training."""

import pytest
import torch
from torch import nn

from gsfw.core.column import Column
from gsfw.core.errors import ConfigError
from gsfw.core.model import PrimitiveModel
from gsfw.plugins.compose import check_rows


class Rows(PrimitiveModel):
    def __init__(self, **rows):
        super().__init__()
        self._made = nn.ModuleDict({name: Column(torch.zeros(n, 2)) for name, n in rows.items()})

    def columns(self):
        return dict(self._made.items())

    def splats(self, time=None, cameras=None):
        raise NotImplementedError


def test_a_column_with_another_number_of_rows_is_named():
    with pytest.raises(ConfigError) as caught:
        check_rows(Rows(means=4, glow=5))
    assert caught.value.message == ("column 'glow' of Rows has 5 rows, expected 4 as 'means' has.")
    check_rows(Rows(means=4, glow=4))
