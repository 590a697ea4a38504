"""Processes of one machine find one another where no other machine reaches them."""

import os
import socket
import stat

import pytest
import torch
import torch.distributed as dist
from support.listening import addresses
from torch.distributed.elastic.multiprocessing.errors import ProcessFailure

from gsfw.parallel import launch
from gsfw.parallel.launch import STORE, connected, run_workers


@pytest.fixture
def alone(monkeypatch):
    """An environment without a launcher, that is restored."""
    for name in ("RANK", "WORLD_SIZE", "MASTER_ADDR", STORE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("GLOO_SOCKET_IFNAME", "lo")


def test_the_list_of_addresses_has_those_that_anybody_reaches():
    before = addresses()
    with socket.create_server(("", 0)), socket.create_server(("127.0.0.1", 0)):
        assert addresses() - before == {"0.0.0.0", "127.0.0.1"} - before


def test_a_process_with_shards_of_its_own_listens_on_loopback_alone(alone):
    before = addresses()
    with connected(torch.device("cpu"), shards=1):
        assert dist.is_initialized()
        assert addresses() - before <= {"127.0.0.1", "::1"}


@pytest.mark.parametrize(("shards", "spare"), [(0, 0), (1, 1)])
def test_processes_have_spare_connections_only_if_they_share_gaussians(
    alone, monkeypatch, shards, spare
):
    made, new_group = [], dist.new_group
    monkeypatch.setattr(dist, "new_group", lambda **given: made.append(given) or new_group(**given))
    with connected(torch.device("cpu"), shards):
        assert len(made) == spare


class Failed:
    """What torch's launcher returns when all has failed."""

    def __init__(self) -> None:
        self.failures = {rank: ProcessFailure(rank, 0, 1, "/nowhere") for rank in range(2)}

    def is_failed(self) -> bool:
        return True


class Workers:
    """torch's launcher, without processes."""

    def __init__(self, kind, program, args, envs, logs_specs) -> None:
        self.environments = envs
        folder = os.path.dirname(envs[0][STORE])
        self.mode = stat.S_IMODE(os.stat(folder).st_mode)
        self.listened = addresses()
        Workers.made = self

    def pids(self):
        return {}

    def wait(self, period):
        return Failed()


def test_processes_meet_in_a_file_that_this_user_alone_sees_and_not_at_a_port(monkeypatch):
    monkeypatch.setattr("torch.distributed.elastic.multiprocessing.start_processes", Workers)
    before = addresses()
    assert run_workers(["train"], 2) == launch.FAILED
    made = Workers.made
    assert made.mode == 0o700
    assert made.listened == before
    stores = {environment[STORE] for environment in made.environments.values()}
    assert len(stores) == 1
    assert not os.path.exists(os.path.dirname(stores.pop()))
    assert not any("MASTER_PORT" in environment for environment in made.environments.values())


def test_the_store_of_processes_tells_later_ones_which_run_has_begun(monkeypatch, tmp_path):
    monkeypatch.setenv(STORE, str(tmp_path / "store"))
    assert launch.run_of_launcher() is None
    launch.tell_launcher(tmp_path / "run")
    assert launch.run_of_launcher() == tmp_path / "run"
