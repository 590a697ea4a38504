"""Ray on this machine alone: nobody else reaches its processes, which run what they are sent."""

import os

import pytest
from support.listening import addresses, children

from gsfw.jobs.ray.cluster import connect, load_ray

# Seconds, until all processes of Ray are there.
pytestmark = pytest.mark.slow


@pytest.fixture
def ray(monkeypatch):
    found = pytest.importorskip("ray", reason="Ray is not installed (pip install 'gsfw[ray]')")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    yield found
    found.shutdown()


def test_its_processes_listen_on_loopback_alone(ray):
    before = addresses()
    assert connect("local")

    def process() -> int:
        return os.getpid()

    worker = load_ray().remote(process).options(num_cpus=0.1)
    assert load_ray().get(worker.remote()) != os.getpid()
    found = addresses(os.getpid(), *children(os.getpid())) - before
    assert found
    assert found <= {"127.0.0.1", "::1", "::ffff:127.0.0.1"}
