"""States after a power loss: a sound order of operations passes, and each unsound one is found."""

import io
import random

import pytest
import torch
from disk_states import Disk, Fate, Operation
from power_loss import check_states, problems_of, reported_step

DRAW = random.Random(0)


def checkpoint(root, step, inode):
    """The operations of an atomic write of a checkpoint, and its report."""
    folder = f"{root}/run/checkpoints"
    part, path = f"{folder}/.step.part", f"{folder}/step_{step:09d}.pt"
    buffer = io.BytesIO()
    torch.save({"schema": 2, "step": step, "values": torch.ones(64)}, buffer)
    content = buffer.getvalue()
    half = len(content) // 2
    return [
        Operation("create", inode, path=part),
        Operation("write", inode, 0, data=content[:half]),
        Operation("write", inode, half, data=content[half:]),
        Operation("fsync", inode, path=part),
        Operation("rename", path=part, other=path),
        Operation("fsync", 1, path=folder),
        Operation("mark", path=f"checkpoint {step}"),
    ]


def training(root):
    """The operations of a training with three checkpoints, of which two are kept."""
    run, folder = f"{root}/run", f"{root}/run/checkpoints"
    return [
        Operation("mkdir", path=run),
        Operation("fsync", 2, path=str(root)),
        Operation("create", 3, path=f"{run}/.config.part"),
        Operation("write", 3, 0, data=b"method: 3dgs\n"),
        Operation("fsync", 3, path=f"{run}/.config.part"),
        Operation("rename", path=f"{run}/.config.part", other=f"{run}/config.yaml"),
        Operation("mkdir", path=folder),
        Operation("fsync", 4, path=run),
        *checkpoint(root, 1, 10),
        *checkpoint(root, 2, 11),
        *checkpoint(root, 3, 12),
        Operation("unlink", path=f"{folder}/step_{1:09d}.pt"),
    ]


def failures(tmp_path, operations):
    root = tmp_path / "disk"
    return check_states(
        operations, root, 700, random.Random(1),
        lambda folder, reported, number: problems_of(folder / "run", reported),
    ).failures  # fmt: skip


def test_a_sound_order_holds_in_every_state(tmp_path):
    assert failures(tmp_path, training(tmp_path / "disk")) == []


def test_a_rename_before_the_data_is_found(tmp_path):
    operations = [
        item for item in training(tmp_path / "disk")
        if item.kind != "fsync" or not item.path.endswith(".step.part")
    ]  # fmt: skip
    found = failures(tmp_path, operations)
    assert any("a damaged checkpoint has its final name" in each for each in found)
    assert any(Fate.ZEROS.value in each for each in found)


def test_a_name_that_is_not_synchronised_is_found(tmp_path):
    root = tmp_path / "disk"
    operations = [
        item for item in training(root)
        if item.kind != "fsync" or item.path != f"{root}/run/checkpoints"
    ]  # fmt: skip
    assert any("was reported, found: []" in each for each in failures(tmp_path, operations))


def test_a_report_before_the_write_is_found(tmp_path):
    operations = training(tmp_path / "disk")
    operations.insert(0, Operation("mark", path="checkpoint 3"))
    assert any("checkpoint 3 was reported" in each for each in failures(tmp_path, operations))


def test_a_file_that_is_written_in_place_is_found(tmp_path):
    root = tmp_path / "disk"
    in_place = [
        item if item.kind == "fsync" else Operation(
            item.kind, item.file, item.place, item.path.replace(".step.part", "step_000000009.pt"),
            item.other, item.data,
        )
        for item in checkpoint(root, 9, 20) if item.kind != "rename"
    ]  # fmt: skip
    found = failures(tmp_path, [*training(root), *in_place])
    assert any("a damaged checkpoint has its final name" in each for each in found)


@pytest.mark.parametrize("fate", Fate)
def test_what_is_synchronised_is_there_whatever_happens(fate):
    disk = Disk()
    for item in training("/disk"):
        disk.apply(item)
    state = disk.state(fate, DRAW)
    assert state["/disk/run/config.yaml"] == b"method: 3dgs\n"
    assert "/disk/run/checkpoints/step_000000003.pt" in state
    assert reported_step(disk.marks) == 3
