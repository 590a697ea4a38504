"""Columns: rows in and out of each layout."""

import pytest
import torch
from support.mixed_model import MixedModel, row_values

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.learning_rate import LearningRate

NAMES = ["dense", "stacked", "ragged", "labels", "banded"]


@pytest.mark.parametrize("name", NAMES)
def test_taking_rows_gives_them_in_the_order_asked_for(name):
    column = MixedModel(9).columns()[name]
    before = row_values(column)
    rows = torch.tensor([7, 1, 1, 3])
    taken = column.take(rows)
    column.assign(taken)
    assert column.num_rows == 4
    assert row_values(column) == [before[i] for i in rows]


@pytest.mark.parametrize("name", NAMES)
def test_no_rows_at_all_is_a_column_too(name):
    column = MixedModel(5).columns()[name]
    column.assign(column.take(torch.tensor([], dtype=torch.int64)))
    assert column.num_rows == 0
    assert row_values(column) == []


@pytest.mark.parametrize("name", NAMES)
def test_joined_rows_follow_one_another(name):
    column = MixedModel(6).columns()[name]
    before = row_values(column)
    column.assign(column.join(column.take(torch.tensor([3, 0])), column.take(torch.tensor([5]))))
    assert row_values(column) == [before[3], before[0], before[5]]


@pytest.mark.parametrize("name", NAMES)
def test_writing_rows_changes_these_rows_only(name):
    column = MixedModel(9).columns()[name]
    before = row_values(column)
    rows = torch.tensor([4, 1])  # Both ragged rows have four values.
    column.write(rows, Rows.zeros_like(column.take(rows)))
    after = row_values(column)
    for i in range(9):
        assert after[i] == ([0.0] * len(before[i]) if i in (1, 4) else before[i])


def test_a_ragged_row_cannot_be_overwritten_by_one_of_another_length():
    column = MixedModel(9).ragged
    before = row_values(column)
    with pytest.raises(ValueError, match="ragged rows keep their number of values"):
        column.write(torch.tensor([0]), column.take(torch.tensor([1])))
    assert row_values(column) == before


def test_offsets_are_given_exactly_when_a_column_is_ragged():
    with pytest.raises(ValueError, match="a ragged column: offsets are given exactly"):
        Column(torch.zeros(3, 2), layout=Layout.RAGGED)
    with pytest.raises(ValueError, match="a dense column: offsets are given exactly"):
        Column(torch.zeros(3, 2), offsets=torch.tensor([0, 3]))


def test_counting_rows_refuses_those_of_another_column():
    model = MixedModel(4)
    assert model.ragged.count(model.ragged.take(torch.tensor([1, 3]))) == 2
    with pytest.raises(ValueError, match=r"rows of shape \(3, 2, 2\) do not fit a dense column"):
        model.dense.count(model.stacked.take(torch.tensor([1, 3])))
    with pytest.raises(ValueError, match="do not fit a ragged column"):
        model.ragged.count(Rows(torch.zeros(3, 2), torch.tensor([1, 1])))


def test_only_columns_with_a_learning_rate_are_parameters():
    trained, buffer = Column(torch.zeros(3), LearningRate(1.0)), Column(torch.zeros(3))
    assert trained.trained
    assert trained.values.requires_grad
    assert not buffer.trained
    assert not buffer.values.requires_grad
    assert [name for name, _ in buffer.named_buffers()] == ["values"]


def test_a_state_with_another_number_of_rows_is_loaded():
    small, large = MixedModel(3), MixedModel(8)
    small.load_state_dict(large.state_dict())
    for name, column in small.columns().items():
        assert row_values(column) == row_values(large.columns()[name])
        assert column.values.data_ptr() != large.columns()[name].values.data_ptr()
