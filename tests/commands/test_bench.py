"""`gsfw bench` measures rasterizers and a training step, and says what the figures mean."""

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
import pytest
import torch
from support.fake_parts import registry_of
from support.scenes import front_camera, random_splats

from gsfw.commands import bench
from gsfw.commands.interface.console import Console
from gsfw.commands.main import main
from gsfw.core.capabilities import Capabilities, Feature
from gsfw.core.config import RasterizerConfig
from gsfw.core.errors import ConfigError
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer, StageTime
from gsfw.plugins import registry
from gsfw.plugins.specs import Spec, hookimpl
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.bench import agreement as bench_agreement
from gsfw.studies.bench import first_use as bench_first_use
from gsfw.studies.bench import machine as bench_machine
from gsfw.studies.bench import rounds as bench_round
from gsfw.studies.bench import timing as bench_timing
from gsfw.studies.bench import workload as bench_workload
from gsfw.studies.bench.timing import GpuTimings

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

QUICK = ("rasterizer=reference", "repeats=1")


@pytest.fixture
def workload(tmp_path):
    """A file of 40 splats and one small camera."""
    splats, camera = random_splats(40), front_camera(20, 12)
    path = tmp_path / "tiny.npz"
    np.savez(
        path,
        means=splats.means,
        quats=splats.quats,
        scales=splats.scales,
        opacities=splats.opacities,
        colors=torch.rand(40, 3),
        world_to_camera=camera.world_to_camera[0],
        intrinsics=camera.intrinsics[0],
        width=20,
        height=12,
    )
    return path


def measured(capsys, *arguments: str) -> dict:
    """The document that programs get, and nothing else on standard output."""
    assert main(["bench", "json=true", *arguments]) == 0
    return json.loads(capsys.readouterr().out)


def refusal(capsys, *arguments: str) -> str:
    assert main(["bench", *arguments]) == 2
    return capsys.readouterr().err


def test_programs_get_one_document_with_medians_and_least_times(workload, capsys):
    document = measured(capsys, *QUICK, f"workload={workload}")
    (result,) = document["results"]
    assert (result["rasterizer"], result["threads"]) == ("reference", 1)
    stages = ("forward", "backward", "step", "activation", "render", "loss", "step_backward")
    for stage in (*stages, "check", "optimizer"):
        for figure in ("ms", "wall_ms", "min_ms", "min_wall_ms"):
            assert result[f"{stage}_{figure}"] >= 0.0
    assert result["forward_wall_ms"] > 0.0
    assert result["step_wall_ms"] > result["render_wall_ms"]
    assert "project_ms" not in result  # The reference measures no stages.
    assert "step_outside_kernels" not in result
    assert document["ratios"] == []
    assert document["repeats"] == 1
    assert document["operators"]
    assert document["workload"]["name"] == str(workload)
    assert document["workload"]["splats"] == 40
    machine = document["machine"]
    assert machine["gsfw"] == "0.1.0"
    assert machine["torch"] == torch.__version__
    assert machine["cpu"]


def test_time_per_pair_is_forward_time_over_pairs(workload, capsys):
    document = measured(capsys, *QUICK, f"workload={workload}")
    (result,) = document["results"]
    pairs = document["workload"]["contributing_pairs"]
    assert pairs > 0
    for stage in ("forward", "backward"):
        expected = result[f"{stage}_ms"] * 1e6 / pairs
        assert result[f"{stage}_ns_per_pair"] == pytest.approx(expected, rel=1e-4)


def test_people_get_a_table_of_each_clock(workload, capsys):
    assert main(["bench", *QUICK, f"workload={workload}"]) == 0
    said = capsys.readouterr().out
    assert "40 splats, RGB, one camera of 20x12" in said
    assert "CPU time over all threads, median of 1 in ms" in said
    assert "wall time, median of 1 in ms" in said
    assert "\n  step backward" in said
    assert "per contributing pair of a pixel and a splat" in said


def test_harmonics_and_several_cameras_are_drawn(workload, capsys):
    with np.load(workload) as archive:
        fields = dict(archive)
    fields["colors"] = np.zeros((40, 9, 3))
    fields["world_to_camera"] = np.stack([fields["world_to_camera"]] * 2)
    np.savez(workload, **fields)
    document = measured(capsys, *QUICK, f"workload={workload}")
    assert document["workload"]["description"] == "40 splats, SH degree 2, 2 cameras of 20x12"


def test_numbers_of_threads_take_turns_and_are_put_back(workload, capsys):
    before = torch.get_num_threads()
    document = measured(capsys, *QUICK, f"workload={workload}", "threads=1,2")
    assert [result["threads"] for result in document["results"]] == [1, 2]
    (ratio,) = document["ratios"]
    assert ratio["threads"] == 2
    assert ratio["to"] == {"rasterizer": "reference", "threads": 1}
    first, second = document["results"]
    expected = second["forward_wall_ms"] / first["forward_wall_ms"]
    assert ratio["wall"]["forward"] == pytest.approx(expected, rel=1e-4)
    assert torch.get_num_threads() == before


class Staged(Rasterizer):
    """The reference, with stages of known length; notes when it draws."""

    turns: tuple[str, ...] = ()

    def __init__(self, name: str, blend_ms: float) -> None:
        self._name, self._blend_ms = name, blend_ms

    @classmethod
    def capabilities(cls):
        features = frozenset({Feature.GRADIENT, Feature.SH})
        return Capabilities(frozenset({"cpu"}), features=features, details={"made": "up"})

    def stage_times(self):
        blend = StageTime(self._blend_ms, self._blend_ms)
        return {"blend": blend, "blend_backward": blend}

    def _render(self, splats, cameras, settings):
        Staged.turns += (self._name,)
        return ReferenceRasterizer()._render(splats, cameras, settings)


class Unstaged(Staged):
    """The same without stages."""

    def stage_times(self):
        return {}


@dataclass
class One(RasterizerConfig):
    def capabilities(self):
        return Staged.capabilities()

    def build(self, device):
        return Staged("one", 1e-3)


@dataclass
class Two(One):
    def build(self, device):
        return Staged("two", 2e-3)


@dataclass
class Timed(One):
    """Measures its stages only where it is told to."""

    time_stages: bool = False

    def build(self, device):
        return Staged("timed, stages", 5e-3) if self.time_stages else Unstaged("timed", 0.0)


@dataclass
class Blind(One):
    def capabilities(self):
        return replace(Staged.capabilities(), features=frozenset({Feature.SH}))


class Parts:
    @hookimpl
    def gsfw_rasterizers(self):
        kinds = {"one": One, "two": Two, "timed": Timed, "blind": Blind}
        return [Spec(name, "", f"{__name__}:{kind.__name__}") for name, kind in kinds.items()]

    @hookimpl
    def gsfw_operators(self):
        return [Spec("fast", "", f"{__name__}:FastOperators")]


class FastOperators(Operators):
    """Not the plain ones: their time counts as time in kernels."""


@pytest.fixture
def staged(monkeypatch):
    """Two rasterizers that measure their stages, on a machine whose limits are known."""
    parts = registry_of(Parts())
    monkeypatch.setattr(registry, "installed", lambda: parts)
    limits = bench_machine.Limits(fma_gflops=200.0, exponential_gexp=10.0)
    monkeypatch.setattr(bench_machine, "measure_limits", lambda: limits)
    monkeypatch.setattr(Staged, "turns", ())


def test_rasterizers_take_turns_and_are_compared(staged, workload, capsys):
    arguments = ["rasterizer=one,two", "repeats=2", f"workload={workload}", "json=true"]
    assert bench.run(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    # Once to wake up, once alone, and once in a training step.
    each = ("one",) * 3 + ("two",) * 3
    assert Staged.turns == each * (bench.WARM_UP + 2)
    one, two = document["results"]
    assert (one["rasterizer"], two["rasterizer"]) == ("one", "two")
    assert one["details"] == {"made": "up"}
    (ratio,) = document["ratios"]
    assert (ratio["rasterizer"], ratio["to"]["rasterizer"]) == ("two", "one")
    assert ratio["cpu"]["blend"] == ratio["wall"]["blend"] == 2.0


def test_blending_is_set_against_what_the_machine_could_do(staged, workload, capsys):
    arguments = ["rasterizer=one", "repeats=1", f"workload={workload}"]
    assert bench.run([*arguments, "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    (result,) = document["results"]
    assert (result["blend_ms"], result["blend_wall_ms"]) == (1e-3, 1e-3)
    limits = document["limits"]
    # 17 and 36 operations at 100 per ns, and one exponential at 10 per ns.
    assert limits["blend_ns_per_pair"] == pytest.approx(0.17 + 0.1)
    assert limits["blend_backward_ns_per_pair"] == pytest.approx(0.36 + 0.1)
    per_pair = 1e-3 * 1e6 / document["workload"]["contributing_pairs"]
    assert result["blend_ns_per_pair"] == pytest.approx(per_pair, rel=1e-4)
    assert result["blend_of_limit"] == pytest.approx(0.27 / per_pair, rel=1e-4)
    inside = result["step_kernels_ms"] / result["step_ms"]
    assert result["step_outside_kernels"] == pytest.approx(1.0 - inside, abs=1e-4)
    least = 2e-3 + sum(result[f"{name}_ms"] for name in ("loss", "check", "optimizer"))
    assert result["step_kernels_ms"] == pytest.approx(least, rel=1e-3)


def test_people_read_stages_limits_and_what_lies_outside_the_kernels(staged, workload, capsys):
    assert bench.run(["rasterizer=one,two", "repeats=1", f"workload={workload}"]) == 0
    said = capsys.readouterr().out
    assert "two, 1 thread / first" in said
    assert "\n  blend backward" in said
    assert "one, 1 thread: blending forward runs at " in said
    assert "of the limit (0.27 ns per contributing pair)" in said
    assert "of a step is outside the kernels" in said
    assert "this machine, one thread: 200 GFLOP/s of fused multiply-adds, 10.00 exponen" in said


def test_automatic_means_one_that_fits(staged, workload, capsys):
    assert bench.run(["repeats=1", f"workload={workload}", "json=true"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    assert result["rasterizer"] in ("one", "two")


def test_without_a_file_the_built_in_workload_is_drawn(staged, monkeypatch, capsys):
    for name, value in {"SPLATS": 50, "WIDTH": 32, "HEIGHT": 21}.items():
        monkeypatch.setattr(bench_workload, name, value)
    assert bench.run(["rasterizer=one", "repeats=1", "json=true"]) == 0
    workload = json.loads(capsys.readouterr().out)["workload"]
    assert workload["name"] == "built in"
    assert workload["description"] == "50 splats, RGB, one camera of 32x21"


def test_an_image_of_nothing_has_no_time_per_pair(staged, workload, capsys):
    with np.load(workload) as archive:
        fields = dict(archive)
    fields["means"] = fields["means"] - np.float32([0.0, 0.0, 99.0])
    np.savez(workload, **fields)
    assert bench.run(["rasterizer=one", "repeats=1", f"workload={workload}", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["workload"]["contributing_pairs"] == 0
    assert "forward_ns_per_pair" not in document["results"][0]


def test_a_rasterizer_that_cannot_train_is_refused(staged, workload):
    with pytest.raises(ConfigError, match="gsfw bench needs feature 'gradient'") as refused:
        bench.run(["rasterizer=blind", f"workload={workload}"])
    assert "Rasterizers that fit here: one, timed, two." in refused.value.advice


def test_settings_of_a_rasterizer_follow_its_name(workload, capsys):
    names = "reference,reference:chunk_mb=2:pairs_mb=64"
    document = measured(capsys, f"rasterizer={names}", "repeats=1", f"workload={workload}")
    assert [result["rasterizer"] for result in document["results"]] == names.split(",")
    assert document["ratios"][0]["rasterizer"] == "reference:chunk_mb=2:pairs_mb=64"


def test_wrong_settings_of_a_rasterizer_are_one_message(capsys):
    said = refusal(capsys, "rasterizer=reference:chunk=2")
    assert "rasterizer=reference:chunk=2: there is no setting 'chunk'." in said
    assert "Settings of this rasterizer: chunk_mb, pairs_mb." in said
    said = refusal(capsys, "rasterizer=reference:chunk_mb=much")
    assert "rasterizer=reference:chunk_mb=much: chunk_mb: expected a number, found 'much'." in said
    assert "chunk_mb: Working memory of one chunk of tiles" in said
    said = refusal(capsys, "rasterizer=reference:chunk_mb=0")
    assert "rasterizer=reference:chunk_mb=0: chunk_mb=0: expected a number above 0." in said


def test_a_device_that_no_rasterizer_fits_is_refused(capsys):
    assert "rasterizer 'reference'" not in refusal(capsys, "rasterizer=cpu", "device=cuda")


def test_a_rasterizer_that_is_slower_with_stages_draws_once_more_for_them(staged, workload, capsys):
    assert bench.run(["rasterizer=timed", "repeats=1", f"workload={workload}", "json=true"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    assert result["blend_ms"] == 5e-3
    assert Staged.turns == ("timed", "timed, stages", "timed") * (bench.WARM_UP + 1)


def test_what_is_asked_for_is_measured_besides(capsys, monkeypatch):
    monkeypatch.setattr(bench_agreement, "RANDOM_SPLATS", 30)
    monkeypatch.setattr(bench_agreement, "RANDOM_SIZE", (8, 6))
    scene = ("workload=random:30", "copies=3", "size=24x16")
    document = measured(capsys, *QUICK, *scene, "sparse=true", "agreement=1")
    assert document["workload"]["name"] == "random:30, 3x3 copies"
    assert document["workload"]["description"] == "270 splats, RGB, one camera of 24x16"
    pairs = document["workload"]["contributing_pairs"] / (24 * 16)
    assert document["workload"]["pairs_per_pixel"] == pytest.approx(pairs, rel=1e-4)
    (result,) = document["results"]
    assert result["sparse_step_wall_ms"] > 0.0
    assert result["image_wall_ms"] >= result["forward_wall_ms"]
    assert result["image_spread_ms"] == 0.0
    assert document["device"] == "cpu"
    assert document["machine"]["gpu"] is None
    errors = document["agreement"]["reference"]
    assert errors.keys() == {"workload", "1 random scenes"}
    assert "sorts" not in document


def test_people_read_what_was_asked_for(capsys, monkeypatch):
    seconds = {"torch_seconds": 1.0, "first_image_seconds": 0.25}
    first_use = {"cold": seconds, "warm": seconds}
    monkeypatch.setattr(bench_first_use, "first_use", lambda name, device: first_use)
    scene = ("workload=random:30", "size=24x16")
    assert main(["bench", *QUICK, *scene, "agreement=0", "first_use=true"]) == 0
    said = capsys.readouterr().out
    assert "distance to the float64 reference" in said
    assert "reference, workload" in said
    assert "\nfirst image  0.25" in said
    assert "reference, cold  reference, warm" in said


def test_impossible_requests_are_one_message(capsys):
    assert "repeats=0: expected a number of at least 1." in refusal(capsys, "repeats=0")
    assert "threads=1,0: expected numbers of at least 1." in refusal(capsys, "threads=1,0")
    assert "copies=2: expected an odd number, with the one that is seen in the middle." in refusal(
        capsys, "copies=2"
    )
    assert "size=big: expected WIDTHxHEIGHT in pixels, such as 1920x1080." in refusal(
        capsys, "size=big"
    )
    assert "threads=2,2: expected each only once." in refusal(capsys, "threads=2,2")
    assert "threads=: expected at least one." in refusal(capsys, "threads=")
    assert "threads=x: expected a list (a whole number, ...)" in refusal(capsys, "threads=x")
    assert "no rasterizer 'referense'. Did you mean 'reference'?" in refusal(
        capsys, "rasterizer=referense"
    )
    assert "unknown key 'thread'. Did you mean 'threads'?" in refusal(capsys, "thread=1")
    assert "workload=gone.npz: there is no such file." in refusal(capsys, "workload=gone.npz")


def test_figures_of_a_gpu_are_told_as_such(staged, workload, capsys):
    assert bench.run(["rasterizer=one,two", "repeats=1", f"workload={workload}", "json=true"]) == 0
    report = json.loads(capsys.readouterr().out)
    report["machine"]["gpu"] = {"name": "Imaginary 9000", "cuda": "13.0"}
    for result in report["results"]:
        result |= {"threads": 0, "image_peak_mb": 1234.5, "step_peak_mb": 5678.9}
    report["sorts"] = [
        {
            "sort": "tile",
            "keys": 1000,
            "bits": 13,
            "radix_sort_ms": 0.5,
            "torch_sort_ms": 1.0,
            "same": False,
        }
    ]
    bench.show(Console(), report)
    said = capsys.readouterr().out
    assert "rendered on Imaginary 9000, CUDA 13.0" in said
    assert "time of the GPU, median of 1 in ms" in said
    assert "one: 1,234 MB for an image and its gradients at most, 5,679 MB for a step" in said
    assert "thread" not in said.partition("this machine")[0]
    assert "1,000 keys of 13 bits (tile)  0.500       1.000       NO" in said


def test_a_round_is_measured_by_the_clock_of_a_gpu_as_well(staged, workload, capsys, monkeypatch):
    ticks = count()
    monkeypatch.setattr(bench_timing, "mark", lambda device: float(next(ticks)))
    monkeypatch.setattr(bench_timing, "milliseconds", lambda begin, end: end - begin)
    monkeypatch.setattr(bench_timing, "wait_for", lambda device: None)
    monkeypatch.setattr(bench_round, "timings_on", GpuTimings)
    arguments = ["rasterizer=one", "repeats=2", f"workload={workload}", "sparse=true"]
    assert bench.run([*arguments, "json=true"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    # From one mark to the next is 1; an image has two marks for each of its two parts within.
    assert (result["image_ms"], result["forward_ms"], result["backward_ms"]) == (5.0, 1.0, 1.0)
    assert (result["step_ms"], result["loss_ms"], result["sparse_step_ms"]) == (13.0, 1.0, 1.0)


def test_help_imports_no_torch():
    code = (
        "import sys\n"
        "from gsfw.commands.main import main\n"
        "main(['bench', '--help'])\n"
        "assert not {'torch', 'numpy'} & set(sys.modules)"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.startswith("usage: gsfw bench [key=value ...]")
    assert "rasterizer=auto" in shown.stdout
