"""The GPU script says what it leaves out and why, and all its parts run where there is no GPU."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import step_kernels
import torch
from gpu_gsplat import Gsplat
from gpu_package import ROOT, install_wheels, make_package
from gpu_plan import TESTS, full, tiny
from gpu_process import Process
from gpu_profile import METRICS
from gpu_report import Report
from gpu_session import Session
from support.gpu_sessions import on_a_gpu, parts, stand_in

SCRIPT = ROOT / "benchmarks" / "gpu.sh"

no_gpu = pytest.mark.skipif(torch.cuda.is_available(), reason="this is about machines without one")


def script(tmp_path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [str(SCRIPT), "--work", str(tmp_path / "work"), "--out", str(tmp_path / "out")]
    environment = os.environ | {"PYTHON": sys.executable, "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [*command, *arguments], env=environment, capture_output=True, text=True, check=False
    )


@no_gpu
@pytest.mark.slow
def test_without_a_gpu_each_part_is_one_sentence_and_the_code_is_3(tmp_path):
    ended = script(tmp_path)
    assert ended.returncode == 3, ended.stdout + ended.stderr
    parts = ("tests", "memcheck", "gsplat", "1M", "5M", "first use", "sort", "garden")
    for part in (*parts, "training fox"):
        assert f"\n{part}: skipped: there is no GPU to use: " in ended.stdout
    document = json.loads((tmp_path / "out" / "gpu.json").read_text())
    assert {part["status"] for part in document["parts"].values()} == {"skipped"}
    assert "no GPU to use" in (tmp_path / "out" / "gpu.md").read_text()


@pytest.mark.slow
def test_all_parts_run_at_a_tiny_size_on_the_cpu(tmp_path):
    ended = script(tmp_path, "--dry-run-on-cpu", "--steps", "10")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    document = json.loads((tmp_path / "out" / "gpu.json").read_text())
    parts = {name: part["status"] for name, part in document["parts"].items()}
    ran = {"tests", "garden", "garden x25", "agreement", "first use"}
    ran.add("training built in, reference")
    assert {name for name, status in parts.items() if status == "ok"} == ran
    left_out = {"gsplat", "sort", "sanitizers"}
    assert {name for name, status in parts.items() if status == "skipped"} == left_out
    table = (tmp_path / "out" / "gpu.md").read_text()
    assert "| garden | forward + backward, reference:chunk_mb=2 |" in table
    assert "| first use | reference, cold cache, seconds: torch " in table
    assert "10 steps, 150 Gaussians, PSNR " in table


def test_a_folder_that_is_not_there_is_a_wrong_option(tmp_path):
    ended = script(tmp_path, "--data", "/no/such/folder")
    assert ended.returncode == 2
    assert "--data /no/such/folder: there is no such folder" in ended.stderr


@pytest.mark.slow
def test_the_package_is_importable_without_a_build(tmp_path):
    folder = make_package(tmp_path)
    code = (
        "import sys\n"
        "sys.meta_path = [item for item in sys.meta_path if 'skbc' not in type(item).__module__]\n"
        "import gsfw\n"
        "from importlib import metadata\n"
        "from gsfw.kernels.cpu.native_module import native\n"
        "from gsfw.kernels.cuda.source_files import headers, source_text\n"
        "assert native() is None\n"
        "assert headers() and source_text('blend.cu')\n"
        "print(gsfw.__file__, gsfw.__version__, metadata.version('gsfw'))"
    )
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == [str(folder / "gsfw" / "__init__.py"), "0.1.0", "0.1.0"]
    assert make_package(tmp_path) == folder  # A second time too.


@pytest.mark.slow
def test_a_wheel_that_is_none_is_told(tmp_path):
    wheel = tmp_path / "broken-1.0-py3-none-any.whl"
    wheel.write_bytes(b"nothing")
    assert install_wheels([], tmp_path / "site") == ""
    assert "broken-1.0" in install_wheels([wheel], tmp_path / "site")
    assert not (tmp_path / "site").exists()


def test_data_is_found_wherever_the_folder_has_it(tmp_path):
    assert set(full(None).missing) == {"garden", "training fox", "training chair"}
    (tmp_path / "garden_workload.npz").touch()
    (tmp_path / "captures" / "fox").mkdir(parents=True)
    plan = full(tmp_path)
    assert set(plan.missing) == {"training chair"}
    assert plan.drawings[0].arguments[0] == f"workload={tmp_path / 'garden_workload.npz'}"
    assert plan.trainings == {"fox": (f"data={tmp_path / 'captures' / 'fox'}",)}


def process(tmp_path: Path, code: str) -> Process:
    return Process("child", [sys.executable, "-S", "-c", code], os.environ, tmp_path)


def test_a_process_that_fails_is_told_by_its_last_words(tmp_path):
    ended = process(tmp_path, "print(1); raise SystemExit('no luck')").wait(30.0)
    assert (ended.output, ended.problem) == ("1\n", "it ended with code 1: no luck")


def test_a_process_that_takes_too_long_is_ended_with_its_children(tmp_path):
    code = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-S', '-c', 'import time; time.sleep(60)'])\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(60)"
    )
    running = process(tmp_path, code)
    while not (tmp_path / "child.out").read_text():
        time.sleep(0.01)
    ended = running.wait(0.1)
    assert ended.problem.startswith("it had not ended after ")
    child = int(ended.output)
    deadline = time.monotonic() + 30
    while _runs(child) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not _runs(child)


def _runs(process_id: int) -> bool:
    try:
        state = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def session(tmp_path: Path, seconds: float = 100.0) -> Session:
    deadline = time.monotonic() + seconds
    return Session(tiny(), Report(tmp_path), os.environ, tmp_path, deadline, ("tests", "trainings"))


@pytest.mark.parametrize(
    ("output", "status", "told"),
    [
        (
            "collected 9 items / 6 deselected / 3 selected\n"
            "tests/a.py::one PASSED\ntests/a.py::two PASSED\ntests/a.py::three SKIPPED (no)\n",
            "ok",
            "2 passed, 0 failed, 1 skipped",
        ),
        (
            "4 workers [3 items]\n[gw0] [ 33%] PASSED tests/a.py::one\n"
            "[gw1] [ 66%] FAILED tests/a.py::two\n"
            "=== short test summary info ===\nFAILED tests/a.py::two\n",
            "failed",
            "1 passed, 1 failed, 0 skipped, 1 left out",
        ),
        ("ImportError", "failed", "0 passed, 0 failed, 0 skipped"),
    ],
)
def test_tests_are_counted_as_they_end(tmp_path, monkeypatch, output, status, told):
    monkeypatch.setattr("gpu_session.sys.executable", _program(tmp_path, output))
    session(tmp_path).tests()
    found = parts(tmp_path)["tests"]
    assert (found["status"], found["reason"]) == (status, told)


def _program(tmp_path: Path, output: str) -> str:
    """A program that prints something, whatever it is asked."""
    text, program = tmp_path / "text", tmp_path / "program"
    text.write_text(output)
    program.write_text(f"#!/bin/sh\ncat {text}\n")
    program.chmod(0o755)
    return str(program)


def test_the_adapter_of_gsplat_is_tested_beside_a_gsplat(tmp_path, monkeypatch):
    running = on_a_gpu(tmp_path, "gsplat tests")
    assert running.wants_gsplat()
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(running, "_test", lambda *asked_for: asked.append(asked_for))
    running.gsplat_tests(SimpleNamespace(environment={"PYTHONPATH": "gsplat"}))
    assert asked == [("gsplat tests", full(None).gsplat_tests, {"PYTHONPATH": "gsplat"})]


def profile_table() -> str:
    """What Nsight Compute prints of three launches, with a unit below each metric."""
    names = ["ID", "Kernel Name", *METRICS]
    units = ["", "", "us", "register/thread", "warp", "inst", "%", "%", "Mbyte"]
    blend = "void blend<float, 3, 128, 0>(gsfw::cuda::BlendJob)"
    rows = [
        ["0", blend, "100.5", "56", "28.5", "1,500,000", "60", "20", "1.5"],
        ["1", "scatter(Job)", "4", "64", "30", "1000", "5", "50", "2"],
        ["2", blend, "101.5", "56", "28.5", "1,500,000", "60", "20", "1.5"],
    ]
    lines = [",".join(f'"{cell}"' for cell in row) for row in (names, units, *rows)]
    return "\n".join(["==PROF== Connected to process 1", *lines])


def test_counters_of_kernels_are_read_from_the_table_that_the_profiler_prints(
    tmp_path, monkeypatch
):
    (tmp_path / "table").write_text(profile_table())
    stand_in(tmp_path, monkeypatch, "ncu", f"cat {tmp_path}/table")
    running = on_a_gpu(tmp_path, "profile 1M")
    running._environment = dict(os.environ)
    running.profiles()
    blend, scatter = parts(tmp_path)["profile 1M"]["kernels"]
    assert blend["name"] == "blend<float, 3, 128, 0>"
    assert (blend["launches"], blend["microseconds"], blend["bytes"]) == (2, 101.0, 1.5e6)
    assert (scatter["name"], scatter["registers"], scatter["instructions"]) == ("scatter", 64, 1000)
    assert "2 launches, 56 registers, 28.5 warps" in (tmp_path / "gpu.md").read_text()
    stand_in(tmp_path, monkeypatch, "ncu", "exit 1")
    running.profiles()
    assert parts(tmp_path)["profile 1M"]["status"] == "failed"


@no_gpu
def test_the_kernels_of_a_step_need_a_gpu_and_a_chunk_needs_two_numbers(monkeypatch, capsys):
    command = ["step_kernels.py", "random:10"]
    monkeypatch.setattr("sys.argv", command)
    assert step_kernels.main() == 3
    assert capsys.readouterr().out == "there is no GPU to use: torch sees none\n"
    monkeypatch.setattr("sys.argv", [*command, "--chunk", "128"])
    with pytest.raises(SystemExit) as caught:
        step_kernels.main()
    assert caught.value.code == 2
    assert "argument --chunk: invalid" in capsys.readouterr().err


@pytest.mark.parametrize("fault", ["", "an image differs"])
def test_nothing_is_run_on_a_gpu_whose_kernels_do_not_work(tmp_path, fault):
    running = on_a_gpu(tmp_path, "works")
    running._environment = dict(os.environ)
    told = json.dumps({"fault": fault, "told": fault or "passed"})
    assert running.works([sys.executable, "-S", "-c", f"print({told!r})"]) is not bool(fault)
    assert parts(tmp_path)["works"]["status"] == ("failed" if fault else "ok")
    assert not running.works([sys.executable, "-S", "-c", "raise SystemExit('no GPU')"])
    assert parts(tmp_path)["works"]["reason"].endswith("no GPU")


def test_parts_that_compare_nothing_need_no_gsplat(tmp_path):
    assert not on_a_gpu(tmp_path, "tests", "sanitizers", "profiles", "sort").wants_gsplat()
    assert on_a_gpu(tmp_path, "1M").wants_gsplat()


def test_files_with_tests_of_a_gpu_are_all_named():
    marked = {
        path.relative_to(ROOT)
        for path in (ROOT / "tests").rglob("test_*.py")
        if "mark.cuda" in path.read_text() and path != Path(__file__)
    }
    named = [Path(name) for name in TESTS]
    assert not [path for path in marked if not any(path.is_relative_to(name) for name in named)]
    assert all((ROOT / name).exists() for name in named)


def trained(seconds_per_step: float):
    """Stands in for training: notes what is asked, and takes no time."""

    def train(title, settings, name, steps, limit, environment):
        taken = steps * seconds_per_step
        asked.append((name, steps))
        return {
            "steps": steps,
            "train_seconds": taken,
            "seconds": taken + 1.0,
            "num_gaussians": 1000,
            "psnr": 30.0,
            "peak_gpu_memory_mb": 512.0,
        }

    asked: list[tuple[str, int]] = []
    return train, asked


@pytest.mark.parametrize(
    ("seconds_per_step", "steps"), [(0.001, 30_000), (0.01, 6_960), (20.0, None)]
)
def test_a_training_takes_as_many_steps_as_fit(tmp_path, monkeypatch, seconds_per_step, steps):
    running = session(tmp_path)
    train, asked = trained(seconds_per_step)
    monkeypatch.setattr(running, "_train", train)
    running.trainings(None, 30_000)
    assert asked[0] == ("reference", 5)
    if steps is None:
        found = parts(tmp_path)["training built in"]
        assert found["status"] == "skipped"
        assert found["reason"] == "there was time for 3 steps only"
        return
    assert asked[1][0] == "reference"
    assert asked[1][1] == pytest.approx(steps, rel=0.05)
    assert "PSNR 30.00 dB, 512 MB" in (tmp_path / "gpu.md").read_text()


@pytest.mark.slow
def test_a_gsplat_that_does_not_install_says_so(tmp_path):
    wheel = tmp_path / "gsplat-1.5.3-py3-none-any.whl"
    wheel.write_bytes(b"nothing")
    environment = dict(os.environ) | {"PYTHONPATH": ""}
    gsplat = Gsplat(wheel, tmp_path, environment, {"capability": "9.0"}, 1)
    assert gsplat.version == "1.5.3"
    assert gsplat.environment["TORCH_CUDA_ARCH_LIST"] == "9.0"
    session(tmp_path).wait_for([gsplat])
    found = parts(tmp_path)["gsplat 1.5.3"]
    assert found["status"] == "failed"
    assert "gsplat-1.5.3" in found["reason"]


def result(name: str, factor: float) -> dict:
    """What `gsfw bench` says of a rasterizer on a GPU."""
    stages = ("forward", "image", "step", "sparse_step", "blend")
    figures = {f"{stage}_ms": factor for stage in stages}
    figures |= {f"{stage}_spread_ms": 0.1 for stage in stages}
    return {
        "rasterizer": name,
        "image_peak_mb": 100 * factor,
        "step_peak_mb": 200 * factor,
        **figures,
    }


def test_the_table_compares_with_every_other_rasterizer(tmp_path):
    gsplat = result("gsplat", 3.0) | {"own_step_ms": 2.5, "own_step_spread_ms": 0.2}
    errors = {"image": 1e-6, "largest": 2e-5, "flips": 3.0, "gradient of means": 4e-5}
    found = {
        "seconds": 9.0,
        "workload": {"description": "5 splats", "pairs_per_pixel": 48.2},
        "own_step_ssim": "ours",
        "results": [result("cuda", 1.0), result("cuda:deterministic", 1.25), gsplat],
        "agreement": {"cuda": {"workload": errors}},
    }
    report = Report(tmp_path)
    report.drawing("garden", found, alone=False)
    table = (tmp_path / "gpu.md").read_text()
    for row in (
        "| garden | 5 splats; 48 pairs per pixel | cuda |  |  |",
        "| garden | forward, gsplat | 1.000 ± 0.100 ms | 3.000 ± 0.100 ms | 3.00 |",
        "| forward + backward, cuda:deterministic | 1.000 ± 0.100 ms | 1.250 ± 0.100 ms | 1.25 |",
        "as gsplat's trainer does it (SSIM: ours) | 1.000 ± 0.100 ms | 2.500 ± 0.200 ms | 2.50 |",
        "| memory of an image, gsplat | 100 MB | 300 MB | 3.00 |",
        "| stages in ms: blend 1.000 |",
        "largest 2.0e-05, image 1.0e-06, gradient of means 4.0e-05, 3 flips",
    ):
        assert row in table
    assert not report.failed


def test_a_measurement_that_ran_alone_tells_no_speed(tmp_path):
    sorts = [
        {
            "keys": 1000,
            "bits": 13,
            "radix_sort_ms": 0.5,
            "radix_sort_spread_ms": 0.0,
            "torch_sort_ms": 1.0,
            "torch_sort_spread_ms": 0.0,
            "same": False,
        }
    ]
    workload = {"description": "5 splats", "pairs_per_pixel": 48.2}
    found = {"seconds": 1.0, "workload": workload, "results": [result("cuda", 1.0)]}
    Report(tmp_path).drawing("sort", found | {"sorts": sorts}, alone=True)
    table = (tmp_path / "gpu.md").read_text()
    assert "1,000 keys of 13 bits, torch.sort: OTHER ORDER | 0.500 ± 0.000 ms" in table
    assert "forward" not in table


@pytest.mark.parametrize("status", ["ok", "skipped", "failed"])
def test_only_a_failed_part_fails_the_whole(tmp_path, status):
    report = Report(tmp_path)
    report.add("5M", status, "said so")
    assert report.failed is (status == "failed")


def test_ours_is_measured_alone_where_it_fails_beside_gsplat(tmp_path, monkeypatch):
    running = session(tmp_path)
    running._parts = ("garden",)
    gsplat = Gsplat.__new__(Gsplat)
    gsplat.version, gsplat.environment = "1.5.3", {"WITH": "gsplat"}
    asked = []

    def document(name, command, limit, environment=None):
        asked.append((name, command[4], environment))
        return {}

    monkeypatch.setattr(running, "json", document)
    running.drawings(gsplat)
    ours = "rasterizer=reference,reference:chunk_mb=2"
    beside = ("garden, gsplat 1.5.3", f"{ours},gsplat", {"WITH": "gsplat"})
    assert asked == [beside, ("garden", ours, None)]
    asked.clear()
    running.drawings(gsplat, again=True)
    assert asked == [beside]
