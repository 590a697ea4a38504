"""A run whose memory runs short gives up growth, then images, and ends with a checkpoint."""

import pytest
import torch
from support.memory_training import CPU, MemoryData, Recorder, trainer, with_parts
from support.states import assert_same_bits

from gsfw.core.errors import NotEnoughMemoryError
from gsfw.core.loop.memory_watch import MemoryWatch
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.update import Update
from gsfw.core.machine_memory import Limit, MachineMemory
from gsfw.core.training_memory import model_row_memory

ALLOWED = 10**9


class Memory:
    """What a run reads: a part of ``ALLOWED`` that is free, from a look on."""

    def __init__(self, free: float, own: float = 0.4, looks: int = 0) -> None:
        self.free, self.own, self.looks = free, own, looks

    def __call__(self) -> MachineMemory:
        self.looks -= 1
        free = 1.0 if self.looks >= 0 else self.free
        return MachineMemory(
            ALLOWED, int(free * ALLOWED), int(self.own * ALLOWED), limit=Limit.GROUP
        )


class CountedData(MemoryData):
    """Counts how often it is asked for memory."""

    drops = freed = 0

    def drop_images(self) -> int:
        self.drops += 1
        return self.freed


def run(folder, memory=None, strategy="adc", is_on=True):
    """A short training that grows; its memory is read from ``memory``."""
    made = with_parts(trainer(folder, strategy, Recorder()), data=CountedData())
    made._memory = (
        MemoryWatch(is_on, CPU, lambda: None) if memory is None else MemoryWatch(is_on, CPU, memory)
    )
    return made


@pytest.mark.slow
def test_enough_memory_changes_no_bit(tmp_path, caplog):
    bare, watched = run(tmp_path / "a"), run(tmp_path / "b", Memory(0.6))
    bare.fit()
    watched.fit()
    assert_same_bits(bare.parts.model.state_dict(), watched.parts.model.state_dict())
    assert len(bare.parts.table) > 100, "the runs have to grow"
    assert "memory" not in caplog.text


def test_a_model_grows_without_a_limit_while_it_may_double(tmp_path):
    made = run(tmp_path / "a")
    rows, each = len(made.parts.table), 4 * model_row_memory(made.parts.model).peak

    def most(new_rows: float) -> int | None:
        free = 120_000_000 + int(new_rows * each)
        memory = MachineMemory(10**9, free, 10**8)
        return MemoryWatch(True, CPU, lambda: memory).limits(made).max_rows

    assert most(rows + 0.5) is None
    assert most(rows - 0.5) == rows + rows - 1
    assert most(0.5) == rows


def test_one_of_many_processes_has_its_part_of_the_memory(tmp_path):
    made = run(tmp_path / "a")
    part = MachineMemory(10**12, 9 * 10**11, 10**9).shared_by(40)
    assert MemoryWatch(True, CPU, lambda: part).limits(made).max_rows is None
    assert made.parts.data.drops == 0


def test_a_run_looks_at_its_first_step_and_once_in_ten(tmp_path):
    made, memory = run(tmp_path / "a"), Memory(0.6)
    watch = MemoryWatch(True, CPU, memory)
    for step in (7, 8, 9, 11, 19, 19, 33, 47):
        made.step = step
        watch.limits(made)
    assert memory.looks == -4


def test_what_a_run_needs_at_its_end_is_not_for_rows(tmp_path):
    made = run(tmp_path / "a")
    short = MachineMemory(5 * 10**8, 11 * 10**7, 2 * 10**8)
    assert MemoryWatch(True, CPU, lambda: short).limits(made).max_rows == len(made.parts.table)


@pytest.mark.parametrize("strategy", ["adc", "mcmc"])
def test_growth_ends_where_no_row_fits_and_the_run_goes_on(tmp_path, strategy, caplog):
    made = run(tmp_path / "a", lambda: MachineMemory(10**10, 10**9, 8 * 10**9), strategy)
    assert made.fit()["completed"]
    assert len(made.parts.table) <= 100, "the model starts with so many, and would grow"
    assert caplog.text.count("memory runs short") == 1
    assert "growth slows down" in caplog.text
    assert made.parts.data.drops == 0


def test_a_run_whose_first_step_does_not_fit_ends_before_it(tmp_path):
    made = run(tmp_path / "a")
    model = made.parts.model
    first = model.num_rows * model_row_memory(model).first
    memory = Memory(0.03 + 0.84 * first / ALLOWED)
    with pytest.raises(NotEnoughMemoryError, match="memory is full after 0 steps, with 100 Gauss"):
        MemoryWatch(True, CPU, memory).limits(made)
    made.step = 10  # Its gradients are there.
    assert MemoryWatch(True, CPU, memory).limits(made).max_rows == 100


@pytest.mark.slow
def test_images_are_dropped_before_the_run_ends(tmp_path, caplog):
    made = run(tmp_path / "a", Memory(0.05, own=0.9))
    made.fit()
    assert made.parts.data.drops == 6  # At each look of 60 steps.
    assert "fewer decoded images are kept (cache_mb)" in caplog.text


@pytest.mark.slow
def test_images_that_make_room_keep_a_run_alive(tmp_path):
    made = run(tmp_path / "a", Memory(0.01, own=0.95))
    made.parts.data.freed = ALLOWED // 40
    assert made.fit()["completed"]


def test_a_run_without_memory_ends_with_a_checkpoint_and_what_helps(tmp_path):
    made = run(tmp_path / "a", Memory(0.01, own=0.95, looks=3))
    with pytest.raises(NotEnoughMemoryError) as caught:
        made.fit()
    assert caught.value.exit_code == 2
    rows = len(made.parts.table)
    assert caught.value.message == (
        f"memory is full after 30 steps, with {rows} Gaussians: 10.0 MB are free, and the control "
        "group of this process allows 1.0 GB."
    )
    kept = RunFolder(tmp_path / "a").checkpoint(30)
    assert kept.exists()
    assert f"fewer Gaussians (strategy=mcmc strategy.cap_max={rows // 2})" in caught.value.advice
    assert (
        f"{kept} is kept: gsfw resume {tmp_path / 'a'} continues from there." in caught.value.advice
    )


def test_a_model_on_a_gpu_grows_by_the_memory_of_the_gpu(tmp_path, monkeypatch):
    made = run(tmp_path / "a")
    rows, each = len(made.parts.table), 4 * model_row_memory(made.parts.model).peak
    free = {"main": 0.5, "gpu": 10**8 + 10.5 * each}
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (int(free["gpu"]), 10**9))
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda device: 50_000_000)
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda device: 30_000_000)

    def most() -> int | None:
        return MemoryWatch(True, torch.device("cuda"), Memory(free["main"])).limits(made).max_rows

    assert most() == rows + 10  # Torch keeps 20 MB for later: with these, 120 MB are no row's.
    with monkeypatch.context() as recorded:  # Recordings alone can use these 20 MB.
        recorded.setattr(Update, "idle_memory", 20_000_000)
        free["gpu"] += 20_000_000
        assert most() == rows + 10
    free["gpu"] = 5 * 10**8
    assert most() is None
    free["gpu"] = 0.0  # Torch has an error for a GPU that is full.
    assert most() == rows
    free["main"] = 0.01
    with pytest.raises(NotEnoughMemoryError, match="memory is full after 0 steps"):
        most()


@pytest.mark.slow
def test_a_watch_that_is_off_or_knows_nothing_lets_runs_go_on(tmp_path):
    assert run(tmp_path / "a", Memory(0.0, own=1.0), is_on=False).fit()["completed"]
    assert run(tmp_path / "b", Memory(0.0, own=0.0)).fit()["completed"]
