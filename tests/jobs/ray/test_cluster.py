"""Room on the machines of a cluster, and what is said where there is none; without Ray."""

import builtins
import os
import time
from types import SimpleNamespace

import pytest

from gsfw.core.errors import ConfigError, UnavailableError
from gsfw.jobs.job import Resources
from gsfw.jobs.ray import cluster as ray_cluster
from gsfw.jobs.ray.cluster import CLUSTERS, Cluster, Machine, connect

GB = 1e9
PLAIN, SMALL = Machine(16.0, 0.0, 64 * GB), Machine(8.0, 0.0, 32 * GB)
WITH_GPUS = Machine(32.0, 4.0, 256 * GB)


def cluster(*machines: Machine, jobs: int = 0) -> Cluster:
    made = Cluster(jobs)
    made._machines, made._seen = machines, time.monotonic() + 1e6
    return made


def test_without_numbers_a_job_takes_a_gpu_and_its_part_of_the_cores():
    found = cluster(WITH_GPUS, PLAIN)
    assert found.settle(Resources()) == Resources(8.0, 1.0)
    assert found.places(Resources()) == 4
    assert found.settle(Resources(gpus=0.5)) == Resources(4.0, 0.5)
    assert found.places(Resources(gpus=0.5)) == 8


def test_without_gpus_a_job_takes_a_machine_or_its_part_of_one():
    assert cluster(PLAIN, SMALL).settle(Resources()) == Resources(8.0, 0.0)
    assert cluster(PLAIN, SMALL).places(Resources()) == 3
    assert cluster(PLAIN, SMALL, jobs=4).settle(Resources()) == Resources(4.0, 0.0)
    assert cluster(PLAIN, SMALL, jobs=4).places(Resources()) == 4


def test_memory_bounds_the_jobs_of_a_machine():
    assert cluster(PLAIN, SMALL).places(Resources(1.0, 0.0, round(30 * GB))) == 3


def test_numbers_stay_when_machines_go():
    found = cluster(PLAIN, SMALL)
    assert found.settle(Resources()).cpus == 8
    found._machines = (PLAIN,)
    assert found.settle(Resources()).cpus == 8


def test_more_than_any_machine_has_is_refused_with_what_there_is():
    with pytest.raises(UnavailableError) as caught:
        cluster(PLAIN, SMALL).places(Resources(4.0, 1.0))
    assert caught.value.message == (
        "no machine of the Ray cluster has what a job asks for: 4 cores, 1 GPUs."
    )
    assert "The machines have 16 cores, 0 GPUs, 64000 MB; or 8 cores" in caught.value.advice


def test_an_address_that_is_none_is_refused():
    with pytest.raises(ConfigError, match="expected auto, local or HOST:PORT"):
        connect("somewhere")


def test_a_machine_that_does_not_answer_is_no_cluster():
    with pytest.raises(UnavailableError) as caught:
        connect("127.0.0.1:1")
    assert caught.value.message == "there is no Ray cluster at 127.0.0.1:1."
    assert "ray.address=local" in caught.value.advice


def test_without_ray_its_installation_is_named(monkeypatch):
    importing = builtins.__import__

    def refuse(name, *rest):
        if name == "ray":
            raise ImportError("No module named 'ray'", name="ray")
        return importing(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(UnavailableError) as caught:
        connect("local")
    assert caught.value.message.startswith("executor=ray needs Ray, which cannot be imported")
    assert caught.value.advice == "Install it with: pip install 'gsfw[ray]'"


def test_a_python_that_unpacks_no_folder_safely_is_refused(monkeypatch):
    monkeypatch.delattr("tarfile.data_filter")
    monkeypatch.setattr("platform.python_version", lambda: "3.11.2")
    with pytest.raises(UnavailableError) as caught:
        connect("local")
    assert caught.value.message.startswith("executor=ray needs Python 3.10.12, 3.11.4, 3.12")
    assert caught.value.message.endswith("this is Python 3.11.2.")
    assert "executor=local" in caught.value.advice


def fake_ray(monkeypatch) -> tuple[SimpleNamespace, list]:
    """Ray's constants, and what these and the environment are when it starts."""
    constants, seen = SimpleNamespace(ENABLE_RAY_CLUSTER=True), []
    ray = SimpleNamespace(
        is_initialized=lambda: False,
        init=lambda **settings: seen.append(
            (constants.ENABLE_RAY_CLUSTER, os.environ.get(CLUSTERS))
        ),
        exceptions=SimpleNamespace(RayError=RuntimeError),
    )
    monkeypatch.setattr(ray_cluster, "load_ray", lambda: ray)
    monkeypatch.setattr(ray_cluster, "import_module", lambda name: constants)
    monkeypatch.setattr(ray_cluster, "_check", lambda address: None)
    monkeypatch.delenv(CLUSTERS, raising=False)
    return constants, seen


def test_the_processes_of_one_machine_listen_on_loopback_alone(monkeypatch):
    constants, seen = fake_ray(monkeypatch)
    assert connect("local")
    assert seen == [(False, "0")]
    assert constants.ENABLE_RAY_CLUSTER
    assert CLUSTERS not in os.environ


def test_a_cluster_of_several_machines_and_a_users_own_value_stay(monkeypatch):
    _, seen = fake_ray(monkeypatch)
    connect("10.0.0.1:6379")
    monkeypatch.setenv(CLUSTERS, "1")
    connect("local")
    assert seen == [(True, None), (True, "1")]
