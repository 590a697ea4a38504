"""Plan: what is run on a GPU, and the same at a tiny size on the CPU, to prove that it runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

GARDEN = "reference/garden_workload.npz"
CAPTURES = {"fox": "captures/fox", "chair": "synthetic/chair"}
"""Paths in the shared data; a folder that holds them by their last name alone will do."""

FIELDS = ("all_operators", "hash_features", "penalties", "plane_product", "slice")
"""Tests of temporal fields, which are those of all kernels."""

TESTS = (
    "tests/rasterizers",
    "tests/kernels/cuda",
    *(f"tests/kernels/test_{name}.py" for name in FIELDS),
    "tests/test_devices.py",
    "tests/core/loop/test_cuda_recorder.py",
    "tests/core/loop/test_determinism.py",
    "tests/datamanagers/test_loader.py",
    "tests/datamanagers/test_upload.py",
)
"""Files with tests of a GPU. The others are not collected: they import packages that a machine with
a GPU need not have."""

GSPLAT_TESTS = ("tests/rasterizers/gsplat",)


@dataclass(frozen=True)
class Drawing:
    """A measurement of `gsfw bench`."""

    name: str
    arguments: tuple[str, ...]
    limit: float
    """Seconds."""
    alone: bool = False
    """True if it concerns our first rasterizer only, and not its speed."""
    profiled: bool = False
    """Counters of every kernel are read too, where Nsight Compute is there."""


@dataclass(frozen=True)
class Plan:
    """Everything that is run, in this order."""

    device: str
    ours: tuple[str, ...]
    """Rasterizers; the first is compared with all others."""
    tests: tuple[str, ...]
    """Arguments of pytest."""
    drawings: tuple[Drawing, ...]
    gsplat_tests: tuple[str, ...] = ()
    """Arguments of pytest, beside a gsplat."""
    sanitizers: tuple[str, ...] = ()
    """Tools of NVIDIA's compute-sanitizer, which watch a small image and its gradient."""
    trainings: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Settings by scene."""
    missing: dict[str, str] = field(default_factory=dict)
    """Reasons of parts that cannot be run, by part."""
    trial_steps: int = 1000
    """Steps of a short training, by which the number of steps is chosen."""
    least_steps: int = 2000
    """Fewer say nothing."""


def full(data: Path | None) -> Plan:
    """On a GPU."""
    missing: dict[str, str] = {}
    drawings = [
        Drawing(
            "1M", ("workload=random:1000000", "repeats=20", "sparse=true"), 60.0, profiled=True
        ),
        Drawing("5M", ("workload=random:5000000", "repeats=10", "sparse=true"), 90.0),
        Drawing("first use", ("first_use=true", "repeats=1"), 60.0, alone=True),
        Drawing("sort", ("sort=1000000", "repeats=1"), 40.0, alone=True),
    ]
    garden = _found(data, GARDEN)
    if garden:
        workload = f"workload={garden}"
        drawings[:0] = [
            Drawing("garden", (workload, "repeats=30", "sparse=true"), 60.0, profiled=True),
            Drawing(
                "garden x25",
                (workload, "copies=5", "size=1920x1080", "repeats=20", "sparse=true"),
                90.0,
            ),
            Drawing("agreement", (workload, "agreement=100", "repeats=1"), 120.0, alone=True),
        ]
    else:
        missing["garden"] = f"{Path(GARDEN).name} is not in the folder that --data gives"
    trainings: dict[str, tuple[str, ...]] = {}
    for name, place in CAPTURES.items():
        folder = _found(data, place)
        if folder:
            trainings[name] = (f"data={folder}",)
        else:
            missing[f"training {name}"] = f"{name}/ is not in the folder that --data gives"
    return Plan(
        device="cuda",
        ours=("cuda", "cuda:deterministic"),
        tests=("-m", "cuda", *TESTS),
        drawings=tuple(drawings),
        gsplat_tests=("-m", "cuda", *GSPLAT_TESTS),
        sanitizers=("memcheck", "racecheck", "synccheck"),
        trainings=trainings,
        missing=missing,
    )


def tiny() -> Plan:
    """The same parts on the CPU, in seconds."""
    small = ("size=48x32", "repeats=1", "sparse=true")
    scene = ("datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32")
    return Plan(
        device="cpu",
        ours=("reference", "reference:chunk_mb=2"),
        tests=("tests/studies/bench/test_timing.py",),
        drawings=(
            Drawing("garden", ("workload=random:300", *small), 120.0),
            Drawing("garden x25", ("workload=random:20", "copies=5", *small), 120.0),
            Drawing("agreement", ("workload=random:300", "agreement=1", *small), 120.0, True),
            Drawing("first use", ("workload=random:50", "first_use=true", *small), 120.0, True),
        ),
        trainings={
            "built in": (*scene, "datamanager.height=24", "datamanager.points=150"),
        },
        missing={
            "sort": "it compares kernels that only a GPU runs",
            "sanitizers": "they watch kernels that only a GPU runs",
        },
        trial_steps=5,
        least_steps=5,
    )


def _found(data: Path | None, place: str) -> Path | None:
    """A file or folder of the data, wherever it is there."""
    if data is None:
        return None
    for candidate in (data / place, data / Path(place).name):
        if candidate.exists():
            return candidate.resolve()
    return None
