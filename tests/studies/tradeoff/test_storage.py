"""What a moving model stores is counted row by row, and edits take their part of it."""

import pytest
import torch
from support.mixed_model import MixedModel
from support.moving_splats import spacetime
from support.tracked_splats import after

from gsfw.studies.tradeoff.edits import Kept, ShTruncation
from gsfw.studies.tradeoff.storage import Storage

ROWS = torch.tensor([0, 2, 5])


def ragged_values(model, rows):
    return int(model.ragged.offsets.diff()[rows].sum())


@pytest.mark.parametrize(
    "model",
    [
        spacetime(),
        spacetime(colors="features"),
        spacetime(motion="adaptive"),
        after((0.0, 0.5, 1.0)),
    ],
)
def test_a_whole_model_stores_what_its_summary_says(model):
    storage = Storage.of(model)
    assert storage.num_bytes == model.summary()["model_bytes"]
    assert storage.num_rows == 20


def test_rows_that_are_gone_take_their_values_along_in_every_layout_and_networks_stay():
    model = MixedModel(7, dtype=torch.float32, bands=3)
    storage = Kept(ROWS).left_of(Storage.of(model))
    floats = 3 * (2 + 6 + 6) + 2 * ragged_values(model, ROWS)
    assert storage.num_bytes == 4 * (floats + 9)
    assert storage.num_rows == 3


def test_lower_degrees_store_fewer_coefficients_and_nothing_else_changes():
    model = spacetime(degree=2)
    whole = Storage.of(model)
    one, none = (ShTruncation(degree).left_of(whole) for degree in (1, 0))
    assert whole.num_bytes - one.num_bytes == 20 * 5 * 3 * 8
    assert one.num_bytes - none.num_bytes == 20 * 3 * 3 * 8
    assert ShTruncation(2).left_of(whole).num_bytes == whole.num_bytes


def test_rows_of_fewer_bands_lose_only_what_is_above_the_degree():
    storage = Storage.of(spacetime(degree=2))
    storage.rows["sh_rest"][:3] = torch.tensor([0, 3 * 24, 8 * 24])
    assert ShTruncation(1).left_of(storage).rows["sh_rest"][:4].tolist() == [0, 72, 72, 72]


def test_rows_without_time_lose_their_temporal_values():
    model = spacetime()
    # Three powers of motion, four numbers of rotation, centre and duration.
    each = 8 * (3 * model.order + 4 + 2)
    whole = Storage.of(model)
    assert whole.num_bytes - whole.without_time(ROWS).num_bytes == 3 * each
    everything = whole.without_time(torch.arange(20))
    assert whole.num_bytes - everything.num_bytes == 20 * each
    assert everything.num_rows == 20


def test_what_rows_share_goes_with_the_last_of_them_where_nothing_else_has_to_do_with_time():
    whole = Storage.of(MixedModel(7, dtype=torch.float32))
    assert whole.without_time(torch.arange(6)) == whole
    assert whole.num_bytes - whole.without_time(torch.arange(7)).num_bytes == 4 * 9


def test_the_decoder_of_features_stays_when_nothing_moves():
    storage = Storage.of(spacetime(colors="features")).without_time(torch.arange(20))
    assert storage.shared == 90 * 8
