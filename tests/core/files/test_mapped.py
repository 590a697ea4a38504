"""Mapped tensors: in files that have no name, and end with the tensors."""

import os

import pytest
import torch

from gsfw.core.errors import OutputError
from gsfw.core.files import mapped
from gsfw.core.files.mapped import mapped_tensor


def test_a_mapped_tensor_is_a_tensor_of_zeros_that_leaves_no_file(tmp_path):
    values = mapped_tensor(tmp_path / "new", (5, 2, 3), torch.float32)
    assert values.shape == (5, 2, 3)
    assert not values.any()
    values += torch.arange(3)
    torch.testing.assert_close(values[4, 1], torch.arange(3.0))
    assert not list((tmp_path / "new").iterdir())


def test_a_tensor_without_values_needs_no_file(tmp_path):
    assert mapped_tensor(tmp_path / "none", (0, 3), torch.float64).shape == (0, 3)
    assert not (tmp_path / "none").exists()


@pytest.mark.skipif(os.name == "nt", reason="plain memory on Windows")
def test_room_that_is_missing_is_an_error_in_words(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mapped, "_reserve", full)
    with pytest.raises(OutputError, match="disk is full"):
        mapped_tensor(tmp_path, (9,), torch.float32)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="plain memory on Windows")
def test_systems_without_fallocate_write_zeros(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    monkeypatch.setattr(mapped, "ZEROS", bytes(7))
    assert not mapped_tensor(tmp_path, (9,), torch.float32).any()
