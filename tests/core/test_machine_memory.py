"""The memory that this process may have, read from files of the kernel."""

from pathlib import Path

import pytest

from gsfw.core import control_groups, machine_memory
from gsfw.core.machine_memory import Limit, MachineMemory, memory_limits

GB = 1 << 30
UNLIMITED_OF_1 = 9223372036854771712


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine of 8 GiB, 6 of them free, where this process has 1, and is in the group /a/b."""
    monkeypatch.setattr(control_groups, "MOUNTED", tmp_path / "groups")
    monkeypatch.setattr(control_groups, "MEMBERSHIP", tmp_path / "membership")
    monkeypatch.setattr(machine_memory, "MACHINE", tmp_path / "meminfo")
    monkeypatch.setattr(machine_memory, "STATUS", tmp_path / "status")
    kilobytes = {"MemTotal": 8 * GB >> 10, "MemAvailable": 6 * GB >> 10, "SwapFree": 0}
    lines = [f"{name}:  {number} kB" for name, number in kilobytes.items()]
    write(tmp_path / "meminfo", *lines, "HugePages_Total:  0")
    write(tmp_path / "status", "Name:\tpython", f"RssAnon:\t{GB >> 10} kB", "Threads:\t2")
    write(tmp_path / "membership", "0::/a/b")
    return tmp_path


def write(path: Path, *lines: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(map(str, lines)) + "\n")


def in_version_1(system: Path) -> Path:
    write(system / "membership", "9:cpu:/", "4:memory:/a/b", "0::/")
    return system / "groups" / "memory" / "a" / "b"


def test_without_control_groups_there_is_what_the_machine_has(system):
    found = machine_memory.machine_memory()
    assert found == MachineMemory(8 * GB, free=6 * GB, own=GB)
    assert found.room == 7 * GB
    assert str(found) == "this machine has 8.6 GB, of which 7.5 GB are left"


@pytest.mark.parametrize("place", ["a/b", "a", ""])
def test_the_limit_of_a_group_or_its_parents_holds(system, place):
    write(system / "groups" / place / "memory.max", 2 * GB)
    write(system / "groups" / place / "memory.current", GB)
    found = machine_memory.machine_memory()
    assert found == MachineMemory(2 * GB, free=GB, own=GB, limit=Limit.GROUP)
    assert str(found) == "the control group of this process allows 2.1 GB"


def test_the_least_of_all_limits_holds(system):
    write(system / "groups" / "a" / "memory.max", 2 * GB)
    write(system / "groups" / "a" / "b" / "memory.max", 3 * GB)
    assert machine_memory.machine_memory().allowed == 2 * GB
    assert [limit.allowed // GB for limit in memory_limits()] == [8, 3, 2]


def test_what_others_in_the_group_have_is_not_left_but_cached_files_are(system):
    group = system / "groups" / "a" / "b"
    write(group / "memory.max", 5 * GB)
    write(group / "memory.current", 4 * GB)
    write(group / "memory.stat", f"anon {3 * GB}", f"active_file {GB // 2}", "inactive_file 8")
    found = machine_memory.machine_memory()
    assert found.room == 5 * GB - (4 * GB - GB // 2 - 8) + GB


def test_version_1_has_other_files(system):
    group = in_version_1(system)
    write(group / "memory.limit_in_bytes", 3 * GB)
    write(group / "memory.usage_in_bytes", 2 * GB)
    write(group / "memory.stat", f"cache {GB}", f"total_inactive_file {GB}")
    assert machine_memory.machine_memory() == MachineMemory(3 * GB, 2 * GB, GB, limit=Limit.GROUP)


@pytest.mark.parametrize("limit", [UNLIMITED_OF_1, 9 * GB])
def test_a_limit_above_the_memory_of_the_machine_is_none(system, limit):
    write(in_version_1(system) / "memory.limit_in_bytes", limit)
    assert machine_memory.machine_memory().limit is Limit.MACHINE


def test_max_is_no_limit(system):
    write(system / "groups" / "a" / "memory.max", "max")
    assert machine_memory.machine_memory().limit is Limit.MACHINE


def test_swap_counts_as_far_as_the_group_may_use_it(system):
    lines = (system / "meminfo").read_text().replace("SwapFree:  0", f"SwapFree:  {GB >> 10}")
    (system / "meminfo").write_text(lines)
    group = system / "groups" / "a" / "b"
    write(group / "memory.max", 2 * GB)
    assert machine_memory.machine_memory().swap == GB
    write(group / "memory.swap.max", 0)
    assert machine_memory.machine_memory().swap == 0


def test_swap_of_version_1_is_beyond_the_limit_of_main_memory(system):
    lines = (system / "meminfo").read_text().replace("SwapFree:  0", f"SwapFree:  {GB >> 10}")
    (system / "meminfo").write_text(lines)
    group = in_version_1(system)
    write(group / "memory.limit_in_bytes", 2 * GB)
    write(group / "memory.memsw.limit_in_bytes", 2 * GB + 5)
    assert machine_memory.machine_memory().swap == 5


def test_a_group_that_is_too_full_leaves_what_this_process_has(system):
    write(system / "groups" / "memory.max", GB)
    write(system / "groups" / "memory.current", 2 * GB)
    assert machine_memory.machine_memory().room == GB


def test_a_system_without_these_files_tells_its_size(system, monkeypatch):
    (system / "meminfo").unlink()
    sizes = {"SC_PHYS_PAGES": 4, "SC_PAGE_SIZE": GB}
    monkeypatch.setattr("os.sysconf", sizes.__getitem__, raising=False)
    assert machine_memory.machine_memory() == MachineMemory(4 * GB, 4 * GB)


def test_a_system_that_tells_nothing_has_no_known_limit(system, monkeypatch):
    (system / "meminfo").unlink()
    monkeypatch.delattr("os.sysconf", raising=False)
    assert machine_memory.machine_memory() is None


def test_processes_share_what_is_free_and_keep_what_they_have():
    half = MachineMemory(8 * GB, free=6 * GB, own=GB, swap=GB).shared_by(2)
    assert half.fair == 4 * GB
    assert half == MachineMemory(8 * GB, free=3 * GB, own=GB, swap=GB // 2, processes=2)
