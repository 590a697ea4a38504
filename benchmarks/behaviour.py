"""Train the same short runs with two installations of gsfw and compare them bit for bit.

A refactoring must not change what is trained. Every case is trained and resumed by a process of its
own, in the given Python. The digests cover the trained parameters, the optimizer's moments and the
random generator of the last checkpoint, whatever their names are, and the held-out figures. They
hold for one machine: record both sides on the same one.

    python benchmarks/behaviour.py record --python OLD/bin/python before.json
    python benchmarks/behaviour.py record --python NEW/bin/python after.json
    python benchmarks/behaviour.py compare before.json after.json
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

STEPS, CHECKPOINT = 240, 130
"""Length of each run, and the step from which it is resumed."""
SCENE = (
    *("datamanager.views=8", "datamanager.eval_views=2", "datamanager.width=40"),
    *("datamanager.height=30", "datamanager.points=300"),
)
COMMON = (
    *SCENE,
    *(f"steps={STEPS}", f"checkpoint_every={CHECKPOINT}", "eval_every=100", "seed=7"),
)
MOVING = ("datamanager.moving=true", "datamanager.times=4", "random_points=1500")
REFINING = (*("strategy.refine_start=30", "strategy.refine_every=20", "strategy.refine_stop=220"),)
ADC = (*REFINING, "strategy.reset_every=90", "strategy.grow_gradient=1e-5")
MCMC = ("strategy=mcmc", *REFINING, "strategy.cap_max=500")
BANDS = ("sh=adaptive", "bands.every=40", "bands.grow_stop=100", "bands.stop=220")
SETTLING = ("static=auto", "static_start=60", "static_every=20")

CASES: dict[str, tuple[str, ...]] = {
    "adc": ("method=3dgs", *ADC),
    "adc absgrad, large splats pruned": (
        *("method=3dgs", *ADC, "strategy.absgrad=true", "strategy.grow_absgrad=4e-5"),
        *("strategy.prune_radius=20", "antialias=true"),
    ),
    "mcmc": ("method=3dgs", *MCMC),
    "none": ("method=3dgs", "strategy=none"),
    "budget=auto": ("method=3dgs", *ADC, "strategy.budget=auto", "strategy.budget_every=25"),
    "budget=200": ("method=3dgs", *ADC, "strategy.budget=200", "strategy.budget_every=25"),
    "budget, mcmc": (
        *("method=3dgs", *MCMC, "strategy.budget=0.1MB", "strategy.budget_every=25"),
        "strategy.gradient_share=0.5",
    ),
    "guided": (
        *("method=3dgs", *ADC, "strategy.guided.rounds=3", "strategy.guided.start=60"),
        "strategy.guided.every=40",
    ),
    "bands": ("method=3dgs", *ADC, *BANDS),
    "bands, budget, mcmc": (
        *("method=3dgs", *MCMC, *BANDS, "strategy.budget=300", "strategy.budget_every=25"),
    ),
    "corrections": (
        *("method=3dgs", "exposure=true", "refine_poses=true", "resolution_schedule=auto"),
        *("resolution_steps=100", *ADC, "sampler=error-weighted"),
    ),
    "4dgs": ("method=4dgs", *MOVING, *ADC),
    "4dgs, settling": ("method=4dgs", *MOVING, *ADC, *SETTLING),
    "4dgs, mlp": ("method=4dgs", *MOVING, "preset=mlp", *REFINING),
    "4d-rotor": ("method=4d-rotor", *MOVING, *REFINING),
    "4d-rotor, settling, bands": (
        "method=4d-rotor",
        *MOVING,
        *REFINING,
        *SETTLING,
        *BANDS,
        "sampler=same-time",
    ),
    "spacetime": ("method=spacetime", *MOVING, *ADC),
    "spacetime, guided, settling": (
        *("method=spacetime", *MOVING, *ADC, *SETTLING, "strategy.guided.rounds=3"),
        *("strategy.guided.start=60", "strategy.guided.every=40"),
    ),
    "spacetime, motion": ("method=spacetime", *MOVING, *ADC, "motion=adaptive"),
    "spacetime, freetime": ("method=spacetime", *MOVING, "preset=freetime", *REFINING),
    "dynamic3dgs": ("method=dynamic3dgs", *MOVING[:2]),
}


def main() -> int:
    """Record the digests of one installation, or compare two recordings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    record = verbs.add_parser("record", help="train every case and write its digests")
    record.add_argument("file", type=Path)
    record.add_argument("--python", default=sys.executable, help="of the installation")
    record.add_argument("--only", default="", help="cases whose name contains this")
    record.add_argument("--jobs", type=int, default=2, help="runs at the same time")
    compare = verbs.add_parser("compare", help="say where two recordings differ")
    compare.add_argument("before", type=Path)
    compare.add_argument("after", type=Path)
    options = parser.parse_args()
    if options.verb == "compare":
        return compare_recordings(read(options.before), read(options.after))
    chosen = {name: case for name, case in CASES.items() if options.only in name}
    known = read(options.file) if options.only and options.file.is_file() else {}
    with ThreadPoolExecutor(options.jobs) as pool:
        found = pool.map(lambda case: digests(options.python, case), chosen.values())
        for name, result in zip(chosen, found, strict=True):
            print(f"{name}: {result['rows']} rows, {result.get('psnr', 0):.3f} dB", flush=True)
            known[name] = result
            options.file.write_text(json.dumps(known, indent=1))
    return 0


def read(path: Path) -> dict[str, Any]:
    """A recording."""
    return json.loads(path.read_text())  # type: ignore[no-any-return]


def compare_recordings(before: dict[str, Any], after: dict[str, Any]) -> int:
    """Print a line for each case; 1 if any differs."""
    different = 0
    both = {name: expected for name, expected in before.items() if name in after}
    for name, expected in both.items():
        found = after[name]
        keys = [key for key in expected if found.get(key) != expected[key]]
        different += bool(keys)
        print(f"{name}: {'equal' if not keys else 'DIFFERENT: ' + ', '.join(keys)}")
        if keys:
            print(*(f"    {key}: {expected[key]} -> {found.get(key)}\n" for key in keys), sep="")
    print(f"{len(both) - different} of {len(both)} cases are equal; {len(before)} are known.")
    return int(different > 0)


def digests(python: str, case: tuple[str, ...]) -> dict[str, Any]:
    """Train a case, resume it from its middle, and digest both ends."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder, "run")
        gsfw(python, "train", *case, *COMMON, f"out={run}")
        result = digest(run)
        (run / "checkpoints" / f"step_{STEPS}.pt").unlink(missing_ok=True)
        for path in checkpoints(run)[1:]:
            path.unlink()
        gsfw(python, "resume", str(run))
        resumed = digest(run)
        return {**result, "resumed equals": resumed == result, "resumed": resumed["state"]}


def gsfw(python: str, *arguments: str) -> None:
    """Run a command of gsfw on one thread.

    Raises:
        RuntimeError: it failed; has what it printed.
    """
    command = [python, "-m", "gsfw", *arguments]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
    # Not in a folder with modules of the same names.
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, cwd="/"
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stdout}\n{done.stderr}")


def checkpoints(run: Path) -> list[Path]:
    """The checkpoints of a run, the first one first."""
    return sorted((run / "checkpoints").glob("step_*.pt"), key=lambda path: int(path.stem[5:]))


def digest(run: Path) -> dict[str, Any]:
    """The results of a run, to be compared."""
    state = torch.load(checkpoints(run)[-1], weights_only=True)
    figures = json.loads((run / "metrics.json").read_text())
    parts = {key: state[key] for key in ("model", "corrections", "optimizer", "generator")}
    hashes = sorted(hashed(tensor) for tensor in tensors(parts))
    return {
        "rows": figures["num_gaussians"],
        "psnr": figures.get("psnr"),
        "ssim": figures.get("ssim"),
        "state": hashlib.sha256("".join(hashes).encode()).hexdigest()[:16],
    }


def tensors(value: Any) -> Iterator[Tensor]:  # noqa: ANN401
    """Every tensor of nested dictionaries and lists that holds anything."""
    if isinstance(value, Tensor):
        if value.numel():
            yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from tensors(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from tensors(item)


def hashed(tensor: Tensor) -> str:
    """Digest of a tensor's type, shape and bits."""
    header = f"{tensor.dtype} {tuple(tensor.shape)}".encode()
    return hashlib.sha256(header + tensor.contiguous().numpy().tobytes()).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
