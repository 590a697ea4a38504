"""A Ray cluster of several machines on this one, whose cores are only counted."""

import os
import tempfile
from collections.abc import Iterator

import pytest

CORES = 1
"""Of each machine."""

STORE = 80 * 2**20
"""Bytes of an object store: about the least that Ray takes."""


@pytest.fixture
def cluster(monkeypatch) -> Iterator:
    """Two machines; the first one cannot be lost."""
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'gsfw[ray]')")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    # What the environment says goes to all processes of the machines.
    monkeypatch.setenv("RAY_health_check_period_ms", "1000")
    monkeypatch.setenv("RAY_health_check_failure_threshold", "3")
    from ray.cluster_utils import Cluster

    # The paths of its sockets may not be long.
    with tempfile.TemporaryDirectory(dir="/tmp", prefix="r-", ignore_cleanup_errors=True) as place:
        # It notes its address in the folder of all Ray programs, and needs that to be there.
        monkeypatch.setenv("RAY_TMPDIR", place)
        settings = {"num_cpus": CORES, "num_gpus": 0, "object_store_memory": STORE}
        first = {**settings, "include_dashboard": False, "temp_dir": f"{place}/ray"}
        there = Cluster(initialize_head=True, head_node_args=first)
        try:
            there.add_node(**settings)
            yield there
        finally:
            there.shutdown()
            os.environ.pop("RAY_ADDRESS", None)
