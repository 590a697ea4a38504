"""Processes go by the one whose memory is shortest, so that all of them edit the same rows.

Threads stand for processes here; tests/commands/test_train_memory.py has real ones.
"""

import pytest
import torch
from support.memory_training import CPU, Recorder, trainer, with_parts
from support.sampling import sampled
from support.states import assert_same_bits
from support.thread_group import in_threads

from gsfw.core.errors import LostProcessError, NotEnoughMemoryError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.memory_watch import MemoryWatch
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.machine_memory import MachineMemory
from gsfw.core.training_memory import model_row_memory
from gsfw.parallel.data_parallel import DataParallel
from gsfw.parallel.sharded.team import GaussianParallel

pytestmark = pytest.mark.unchecked

SIZE, STEPS, SHARDS = 2, 40, 4
ENOUGH, FULL = MachineMemory(10**9, 5 * 10**8, 10**8), MachineMemory(10**9, 10**7, 9 * 10**8)


def in_data_parallel(run, group):
    return with_parts(run, team=DataParallel(group))


def in_shards(run, group):
    team = GaussianParallel(group, SHARDS)
    parts = team.share(run.parts)
    return with_parts(run, team=team, table=parts.table, edited=parts.edited)


def processes(work, folder, divided, memory):
    """Calls ``work`` with the trainer of each process, which reads ``memory(rank, step)``."""

    def run(group):
        own = divided(trainer(folder, "adc", Recorder(), views_per_step=2, steps=STEPS), group)
        own._memory = MemoryWatch(True, CPU, lambda: memory(group.rank, own.step))
        return work(own)

    return in_threads(SIZE, run)


@pytest.mark.parametrize(("divided", "has_all"), [(in_data_parallel, True), (in_shards, False)])
def test_all_processes_have_the_limit_of_the_one_with_least_room(tmp_path, divided, has_all):
    row = model_row_memory(trainer(tmp_path, "adc", Recorder()).parts.model).peak
    little = MachineMemory(10**9, 120_000_000 + int(4 * row * 10.5), 10**8)  # For ten rows.
    for memories in ((ENOUGH, little), (little, ENOUGH), (little, None)):
        limits = processes(
            lambda own: own._memory.limits(own).max_rows, tmp_path, divided,
            lambda rank, _, memories=memories: memories[rank],
        )  # fmt: skip
        rows = 100 + (10 if has_all else 20)  # Each of two processes has room for ten of its own.
        assert limits == [rows, rows]


@pytest.mark.slow
@pytest.mark.parametrize("divided", [in_data_parallel, in_shards])
def test_enough_memory_changes_no_bit(tmp_path, divided):
    for name, memory in (("bare", None), ("watched", ENOUGH)):
        summary, _ = processes(
            lambda own: own.fit(), tmp_path / name, divided, lambda *_, memory=memory: memory
        )
        assert summary["num_gaussians"] > 100, "the runs have to grow"
    bare, watched = (
        read_checkpoint(RunFolder(tmp_path / name).checkpoint(STEPS))["model"]
        for name in ("bare", "watched")
    )
    assert_same_bits(bare, watched)


@pytest.mark.parametrize("divided", sampled([(in_data_parallel,), (in_shards,)], [0]))
@pytest.mark.parametrize("full", [0, 1])
def test_a_process_without_memory_ends_the_run_with_one_checkpoint(tmp_path, divided, full):
    def run(own):
        table = own.parts.team._group._table
        if own.parts.team.leads:
            with pytest.raises(NotEnoughMemoryError) as raised:
                own.fit()
            table.leave()  # As its process ends, the others lose it.
            return str(raised.value)
        with pytest.raises(LostProcessError):
            own.fit()
        return None

    def memory(rank, step):
        return FULL if rank == full and step >= 20 else ENOUGH

    message, _ = processes(run, tmp_path, divided, memory)
    assert "memory is full after 20 steps" in message
    state = read_checkpoint(RunFolder(tmp_path).checkpoint(20))
    assert all(torch.isfinite(values).all() for values in state["model"].values())
