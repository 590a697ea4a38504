"""Cores that this process may use, and the threads that follow from them."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from gsfw.core import control_groups
from gsfw.core.cores import CHOSEN, LIMITED, affinity, chosen_threads, cores, limit_threads
from gsfw.jobs.local import threads_per_job
from gsfw.kernels.cpu.threads import num_threads
from gsfw.parallel.launch import _environment


@pytest.fixture(autouse=True)
def _fresh_limits(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def forget() -> None:
        cores.cache_clear()
        affinity.cache_clear()

    forget()
    for name in (CHOSEN, LIMITED):
        monkeypatch.setenv(name, "")  # Put back after the test.
        monkeypatch.delenv(name)
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)
    forget()


@pytest.fixture
def eight_cores(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Eight cores and no limit but those that the test puts into the folder."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(control_groups, "MOUNTED", tmp_path)
    monkeypatch.setattr(control_groups, "MEMBERSHIP", tmp_path / "membership")
    (tmp_path / "membership").write_text("0::/work/mine\n")
    return tmp_path


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_torch_says_how_many(eight_cores):
    for wanted in (1, 3):
        torch.set_num_threads(wanted)
        assert num_threads() == wanted


def test_no_more_than_the_cores_that_this_process_may_use(eight_cores):
    torch.set_num_threads(20)
    assert num_threads() == 8


@pytest.mark.parametrize("group", ["", "work", "work/mine"])
def test_a_quota_of_the_group_or_its_parents_is_a_limit(eight_cores, group):
    write(eight_cores / group / "cpu.max", "250000 100000\n")
    torch.set_num_threads(6)
    assert num_threads() == 3


def test_a_quota_below_one_core_leaves_one_thread(eight_cores):
    write(eight_cores / "cpu.max", "20000 100000\n")
    torch.set_num_threads(6)
    assert num_threads() == 1


def test_no_quota_is_no_limit(eight_cores):
    write(eight_cores / "cpu.max", "max 100000\n")
    torch.set_num_threads(6)
    assert num_threads() == 6


def test_what_the_user_chose_overrules_the_quota(eight_cores, monkeypatch):
    write(eight_cores / "cpu.max", "100000 100000\n")
    monkeypatch.setenv("OMP_NUM_THREADS", "6")
    torch.set_num_threads(6)
    assert num_threads() == 6


def test_where_there_are_no_control_groups_there_is_no_quota(eight_cores):
    (eight_cores / "membership").unlink()
    torch.set_num_threads(6)
    assert num_threads() == 6


def test_quotas_of_version_1_have_a_file_for_each_number(eight_cores):
    membership = "12:memory:/box\n4:cpu,cpuacct:/box\n1:name=systemd:/box\n0::/\n"
    (eight_cores / "membership").write_text(membership)
    write(eight_cores / "cpu/box/cpu.cfs_quota_us", "150000\n")
    write(eight_cores / "cpu/box/cpu.cfs_period_us", "100000\n")
    write(eight_cores / "cpu/cpu.cfs_quota_us", "-1\n")
    write(eight_cores / "cpu/cpu.cfs_period_us", "100000\n")
    torch.set_num_threads(6)
    assert num_threads() == 2


def test_jobs_and_processes_share_what_the_quota_allows(eight_cores):
    write(eight_cores / "cpu.max", "400000 100000\n")
    assert threads_per_job(2) == 2
    assert _environment(0, 4, "store")["OMP_NUM_THREADS"] == "1"


def test_torch_starts_no_more_threads_than_the_quota_allows(eight_cores):
    write(eight_cores / "cpu.max", "400000 100000\n")
    limit_threads()
    assert os.environ["OMP_NUM_THREADS"] == "4"
    assert chosen_threads() is None  # Processes of this one still divide the cores.
    assert _environment(0, 2, "store")["OMP_NUM_THREADS"] == "2"


def test_a_process_does_not_take_the_limit_of_its_parent_for_a_choice(eight_cores):
    write(eight_cores / "cpu.max", "400000 100000\n")
    limit_threads()
    asks = [sys.executable, "-c", "import gsfw.core.cores as c; print(c.chosen_threads())"]
    assert subprocess.check_output(asks, text=True) == "None\n"
    chosen = os.environ | {"OMP_NUM_THREADS": "2"}
    assert subprocess.check_output(asks, text=True, env=chosen) == "2\n"


def test_a_number_of_threads_that_the_user_chose_stays(eight_cores, monkeypatch):
    write(eight_cores / "cpu.max", "400000 100000\n")
    monkeypatch.setenv("OMP_NUM_THREADS", "6")
    limit_threads()
    assert chosen_threads() == 6
    assert _environment(0, 2, "store")["OMP_NUM_THREADS"] == "6"


def test_without_a_quota_the_number_of_threads_is_left_to_torch(eight_cores):
    limit_threads()
    assert "OMP_NUM_THREADS" not in os.environ
