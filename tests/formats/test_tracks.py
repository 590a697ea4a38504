"""The archive of paths holds what it says, for NumPy."""

import numpy as np
import pytest
import torch

from gsfw.core.errors import OutputError
from gsfw.core.exchange import TrackFile
from gsfw.core.temporal_metrics.tracks import Tracks
from gsfw.formats.tracks import TracksExporter


def content() -> TrackFile:
    """Two rows at three times, near a place where float32 has no centimetres left."""
    origin = torch.tensor([4.5e6, 0.0, 100.0], dtype=torch.float64)
    positions = origin + torch.rand(3, 2, 3, dtype=torch.float64)
    positions[1, 0] = torch.nan
    opacities = torch.tensor([[0.5, 1.0], [0.0, 1.0], [0.25, 1.0]])
    return TrackFile(
        Tracks((0.0, 0.5, 1.0), positions, opacities),
        origin,
        data_times=(10.0, 15.0, 20.0),
        colors=torch.tensor([[0.0, 0.5, 2.0], [-1.0, 1.0, 0.1]]),
    )


def test_paths_come_back_to_a_millimetre_wherever_the_world_is(tmp_path):
    made = content()
    TracksExporter().write(tmp_path / "tracks.npz", made)
    with np.load(tmp_path / "tracks.npz", allow_pickle=False) as found:
        arrays = dict(found)
    shapes = {name: (array.shape, array.dtype.name) for name, array in arrays.items()}
    assert shapes == {
        "positions": ((3, 2, 3), "float32"),
        "origin": ((3,), "float64"),
        "opacities": ((3, 2), "float32"),
        "present": ((3, 2), "bool"),
        "colors": ((2, 3), "uint8"),
        "times": ((3,), "float64"),
        "data_times": ((3,), "float64"),
    }
    world = arrays["positions"].astype(np.float64) + arrays["origin"]
    np.testing.assert_allclose(world, made.tracks.positions.numpy(), rtol=0, atol=1e-6)
    assert np.isnan(arrays["positions"][1, 0]).all()
    assert arrays["present"].tolist() == [[True, True], [False, True], [True, True]]
    assert arrays["colors"].tolist() == [[0, 128, 255], [0, 255, 26]]
    assert arrays["data_times"].tolist() == [10.0, 15.0, 20.0]


def test_a_place_that_cannot_be_written_is_one_message(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        TracksExporter().write(tmp_path / "file" / "tracks.npz", content())
