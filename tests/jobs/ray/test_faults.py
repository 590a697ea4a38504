"""A machine is lost, jobs are stopped, the command is killed: no more is lost than must be."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.ray_cluster import cluster  # noqa: F401 - a fixture
from support.slow_stages import without_slow_stages

pytestmark = pytest.mark.slow

TINY = (
    *("datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=64"),
    *("datamanager.height=48", "datamanager.points=150", "rasterizer=cpu"),
)
FIGURES = ("psnr", "ssim", "num_gaussians", "judged_psnr", "model_bytes")
PATIENCE = 300


def start(verb: str, *words: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "gsfw", verb, *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, **pipes, env={**os.environ, "OMP_NUM_THREADS": "1"})


def wait_until(condition, process: subprocess.Popen) -> None:
    until = time.monotonic() + PATIENCE
    while not condition():
        if process.poll() is not None or time.monotonic() > until:
            process.kill()
            pytest.fail("".join(process.communicate()))
        time.sleep(0.05)


def figures(folder: Path) -> dict[tuple, list]:
    """What was measured, but for times."""
    results = json.loads((folder / "results.json").read_text())["results"]
    return {
        (item["row"], item["scene"], item["seed"]): [item["figures"][name] for name in FIGURES]
        for item in results
    }


def logs(folder: Path) -> list[Path]:
    """Runs that have logged a step."""
    return [path for path in folder.glob("runs/**/metrics.jsonl") if path.stat().st_size]


def pids(folder: Path) -> list[int]:
    """Processes of runs in a folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().split(b"\0")
        except OSError:
            continue
        mine = any(str(folder).encode() in word for word in words)
        if mine and (b"train" in words or b"resume" in words):
            found.append(int(entry.parent.name))
    return found


def test_a_tradeoff_that_loses_a_machine_has_the_results_of_one_machine(cluster, tmp_path):  # noqa: F811
    words = [*TINY, "steps=400", "axes=antialias", "log_every=10", "repeats=1"]
    here = start("tradeoff", *words, f"out={tmp_path / 'here'}", "jobs=1", "job.cpus=1")
    _, complained = here.communicate(timeout=PATIENCE)
    assert here.returncode == 0, complained
    out = tmp_path / "there"
    on_ray = ["executor=ray", f"ray.address={cluster.address}", "job.cpus=1"]
    there = start("tradeoff", *words, f"out={out}", *on_ray)
    wait_until(lambda: len(logs(out)) == 2, there)
    lost = next(node for node in cluster.list_all_nodes() if not node.head)
    cluster.remove_node(lost, allow_graceful=False)
    said, complained = there.communicate(timeout=PATIENCE)
    assert there.returncode == 0, complained
    assert without_slow_stages(complained) == ""
    assert "raylet" not in said
    assert figures(out) == figures(tmp_path / "here")
    assert not pids(out)


def study(folder: Path) -> str:
    file = folder / "s.yaml"
    settings = "".join(f"  {word.replace('=', ': ')}\n" for word in TINY)
    file.write_text(
        f"title: Small\nsettings:\n{settings}  steps: 100000\n  log_every: 10\n"
        "rows: {still: {method: 3dgs}}\nscenes: {balls: {}}\nseeds: [1, 2]\n"
    )
    return str(file)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=["ctrl-c", "killed"])
def test_jobs_end_with_checkpoints_when_the_driver_is_stopped(cluster, tmp_path, number):  # noqa: F811
    out = tmp_path / "out"
    words = [study(tmp_path), f"out={out}", "executor=ray", f"ray.address={cluster.address}"]
    process = start("study", *words)
    wait_until(lambda: len(logs(out)) == 2, process)
    process.send_signal(number)
    said, complained = process.communicate(timeout=PATIENCE)
    assert process.returncode == (130 if number is signal.SIGINT else -signal.SIGKILL), complained
    until = time.monotonic() + PATIENCE
    while pids(out) and time.monotonic() < until:
        time.sleep(0.2)
    assert not pids(out)
    later = [path for path in out.glob("runs/**/step_*.pt") if path.stem != "step_000000000"]
    assert len({path.parent for path in later}) == 2
    if number is signal.SIGINT:
        assert "2 runs left: interrupted by Ctrl-C. The same command continues." in said
        assert not json.loads((out / "results.json").read_text())["failures"]
