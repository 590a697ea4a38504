"""Checkpoints hold finite values, read back as written, and run no code."""

import errno
import os
import zipfile

import pytest
import torch

from gsfw.core.errors import DataError
from gsfw.core.loop import checkpoint_file
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder


def test_a_checkpoint_reads_back_bit_for_bit(tmp_path):
    folder = RunFolder(tmp_path)
    state = {"model": {"means": torch.randn(5, 3)}, "count": 3, "names": ["a", "b"]}
    path = folder.write_checkpoint(7, state)
    read = read_checkpoint(path)
    assert torch.equal(read["model"]["means"], state["model"]["means"])
    assert (read["step"], read["count"], read["names"]) == (7, 3, ["a", "b"])


def test_a_state_that_is_not_finite_is_never_written(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_checkpoint(1, {"model": {"means": torch.ones(2)}})
    bad = {"model": {"means": torch.tensor([1.0, float("nan")])}}
    with pytest.raises(ValueError, match=r"^model\.means is not finite$"):
        folder.write_checkpoint(2, bad)
    assert [path.name for path in folder.checkpoints.iterdir()] == ["step_000000001.pt"]


def test_a_value_that_is_not_finite_is_found_in_every_part_of_a_large_tensor(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.core.loop.checkpoint_file.CHECKED_AT_ONCE", 4)
    folder = RunFolder(tmp_path)
    for place in range(9):
        values = torch.ones(3, 3)
        values.view(-1)[place] = float("inf")
        with pytest.raises(ValueError, match=r"^values is not finite$"):
            folder.write_checkpoint(1, {"values": values})
    folder.write_checkpoint(1, {"values": torch.ones(3, 3), "none": torch.ones(0)})


def test_a_checkpoint_that_was_cut_short_is_refused_with_advice(tmp_path):
    folder = RunFolder(tmp_path)
    path = folder.write_checkpoint(1, {"values": torch.zeros(1000)})
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(DataError, match="cannot be read as a checkpoint") as caught:
        read_checkpoint(path)
    assert "use an earlier one" in str(caught.value)


def test_a_checkpoint_of_another_schema_is_refused(tmp_path):
    torch.save({"schema": 99}, tmp_path / "step_000000001.pt")
    with pytest.raises(DataError, match="expected checkpoint schema 2, found 99"):
        read_checkpoint(tmp_path / "step_000000001.pt")


def test_a_checkpoint_of_gsfw_0_1_gives_each_refiner_its_state(tmp_path):
    gathered = {"gradient": torch.ones(3), "views": torch.ones(3), "radius": torch.zeros(3)}
    strategy = {**gathered, "count": {"stopped": 40}, "guided": {"rounds": 2}}
    torch.save({"schema": 1, "strategy": strategy, "step": 7}, tmp_path / "step_000000007.pt")
    state = read_checkpoint(tmp_path / "step_000000007.pt")
    assert set(state) == {"schema", "step", "refiners"}
    refiners = state["refiners"]
    assert refiners["budget"] == {"stopped": 40}
    assert refiners["guided"] == {"rounds": 2}
    assert refiners["adc"]["gathered"].keys() == gathered.keys()
    assert refiners["adc"]["may_grow"] is False


def test_a_checkpoint_cannot_run_code(tmp_path):
    torch.save({"schema": 1, "evil": os.system}, tmp_path / "evil.pt")
    with pytest.raises(DataError, match="cannot be read as a checkpoint"):
        read_checkpoint(tmp_path / "evil.pt")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_name_of_any_length_does_not_reach_torch(tmp_path, monkeypatch, method):
    def never(*_: object, **__: object) -> None:
        raise AssertionError("torch takes the square of the length of a name")

    monkeypatch.setattr(torch, "load", never)
    path = tmp_path / "step_000000001.pt"
    length = 40_000 if method == zipfile.ZIP_STORED else 10
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("archive/data.pkl", b"\x80\x02c" + b"x" * length + b"\nname\n.")
    with pytest.raises(DataError, match="cannot be read as a checkpoint: ValueError"):
        read_checkpoint(path)


def test_a_checkpoint_that_may_not_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(checkpoint_file, "_check_names", refuse)
    with pytest.raises(PermissionError):
        read_checkpoint(tmp_path / "step_000000001.pt")
