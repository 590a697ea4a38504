"""Floats are counted by what they are for, whatever the model calls its columns."""

import torch
from support.gaussians import gaussians
from support.mixed_model import MixedModel

from gsfw.core.column import Column, Layout
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.studies.requirements.census import Census

RATE = LearningRate(0.1)


def census(model, degree=3):
    return Census.of(model, Optimizer(model, Operators(), OptimizerSettings()), degree)


def ragged(lengths, *shape):
    """A column whose rows have these numbers of values."""
    offsets = torch.tensor([0, *lengths]).cumsum(0)
    return Column(torch.ones(int(offsets[-1]), *shape), RATE, Layout.RAGGED, offsets)


def test_the_floats_of_classic_gaussians_are_59_each_of_which_48_are_colours():
    found = census(gaussians(20, degree=3))
    assert found.floats == {
        "positions": 60, "rotations and sizes": 140, "opacities": 20,
        "SH band 0": 60, "SH band 1": 180, "SH band 2": 300, "SH band 3": 420,
    }  # fmt: skip
    assert sum(found.floats.values()) == 20 * 59
    assert (found.sh_floats, found.sh_floats_full) == (20 * 48, 20 * 48)
    assert found.rows_by_degree == (0, 0, 0, 20)
    assert found.for_training == {"optimizer": 2 * 20 * 59}


def test_gaussians_of_one_colour_could_have_no_more_by_their_settings():
    found = census(gaussians(20, degree=0))
    assert (found.sh_floats, found.sh_floats_full, found.rows_by_degree) == (60, 60, (20,))


def test_ragged_bands_are_counted_row_by_row_and_compared_with_the_settings():
    model = gaussians(5, degree=3)
    model.sh_rest = ragged([0, 3, 8, 8, 0], 3)
    found = census(model, degree=3)
    assert found.rows_by_degree == (2, 1, 2)
    assert [found.floats[f"SH band {band}"] for band in (0, 1, 2)] == [15, 27, 30]
    assert "SH band 3" not in found.floats
    assert found.sh_floats == 15 + 3 * (3 + 8 + 8)
    assert found.sh_floats_full == 5 * 48


def test_a_model_of_other_columns_is_counted_by_their_names():
    model = MixedModel(7, dtype=torch.float32, bands=3)
    found = census(model)
    values = sum(column.values.numel() for name, column in model.columns().items())
    assert found.floats["dense"] == 14
    assert found.floats["stacked"] == 42
    assert found.floats["ragged"] == model.ragged.values.numel()
    assert found.floats["SH band 1"] == 7 * 3 * 2
    assert found.floats["network"] == 9
    assert found.for_training["labels"] == 7
    assert sum(found.floats.values()) == values - 7 + 9


def test_time_parameters_are_one_group_and_rows_without_any_are_counted():
    class Moving(type(gaussians())):
        def temporal_columns(self):
            return {"paths": self.paths, "past": self.past}

        def columns(self):
            return {**super().columns(), **self.temporal_columns()}

    model = gaussians(4, degree=0)
    model.__class__ = Moving
    model.paths = ragged([1, 0, 2, 0], 3)
    model.past = Column(torch.zeros(2, 4, dtype=torch.int16), layout=Layout.STACKED)
    assert census(model).floats["time parameters"] == 9 + 8 // 2
    assert census(model).rows_without_time == 0
    model.past = ragged([1, 0, 1, 0])
    assert census(model).floats["time parameters"] == 11
    assert census(model).rows_without_time == 2
