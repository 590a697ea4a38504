"""Measures gsfw on a machine with a GPU: agreement, speed beside gsplat, training; one table.

It needs Python 3.11 or newer, a CUDA build of torch and what gsfw depends on, but no compiler, no
native module and no network; docs/guides/gpu.md says how to bring the rest along. Each part is a
process of its own with its own time, and results are written as they come. Exit code: 0 when every
part gave a result or was left out for a stated reason, 1 when one failed, 2 for a wrong option, 3
when there is no GPU.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from gpu_gsplat import Gsplat
from gpu_package import install_wheels, make_package
from gpu_plan import full, tiny
from gpu_report import Report
from gpu_session import Session

NO_GPU = 3

MACHINE = """
import json, platform, shutil, subprocess, torch
from gsfw.kernels.cuda.availability import cuda_system, unavailable

def dotted(version):
    return ".".join(map(str, version))

report = {"python": platform.python_version(), "torch": torch.__version__}
report["cuda"], report["unavailable"] = torch.version.cuda, unavailable()
if not report["unavailable"]:
    system, properties = cuda_system(), torch.cuda.get_device_properties(0)
    report["gpu"], report["targets"] = properties.name, ", ".join(system.targets)
    report["capability"] = f"{properties.major}.{properties.minor}"
    report["nvrtc"], report["driver knows CUDA"] = map(
        dotted, (system.nvrtc.version, system.driver.version)
    )
if shutil.which("nvidia-smi"):
    query = "driver_version,clocks.sm,clocks.max.sm,clocks.mem,power.limit,temperature.gpu"
    command = ["nvidia-smi", f"--query-gpu={query}", "--format=csv,noheader"]
    asked = subprocess.run(command, capture_output=True, text=True)
    report["nvidia-smi"] = f"{query}: {asked.stdout.strip()}"
print(json.dumps(report))
"""


WORKS = """
import json
from gsfw.rasterizers.cuda.tested_gpus import examine
found = examine(0)
print(json.dumps({"fault": found.fault, "told": str(found)}))
"""


def main() -> int:
    """Run the parts that were asked for; the exit code."""
    options = _options()
    started = time.monotonic()
    options.work.mkdir(parents=True, exist_ok=True)
    options.out.mkdir(parents=True, exist_ok=True)
    wheels = sorted(options.wheels.glob("*.whl")) if options.wheels else []
    gsplat_wheels = [wheel for wheel in wheels if wheel.name.startswith("gsplat-")]
    others = [wheel for wheel in wheels if wheel not in gsplat_wheels]
    site = options.work / "site"
    problem = install_wheels(others, site)
    report = Report(options.out)
    if problem:
        report.add("wheels", "failed", problem)
    paths = [str(make_package(options.work)), str(site), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]),
        "PYTHONSAFEPATH": "1",
        "PYTHONUNBUFFERED": "1",
        "GSFW_CACHE_DIR": str(options.work / "cache"),
    }
    plan = tiny() if options.dry_run_on_cpu else full(options.data)
    deadline = started + options.budget
    session = Session(plan, report, environment, options.work, deadline, options.parts)
    machine = session.json("machine", [sys.executable, "-c", MACHINE], 90.0)
    report.machine(machine)
    reason = machine.get("unavailable", "torch or gsfw could not be imported; see above")
    if reason and not options.dry_run_on_cpu:
        session.skip_everything(f"there is no GPU to use: {reason}")
        report.show()
        return 1 if report.failed else NO_GPU
    if not reason and not session.works([sys.executable, "-c", WORKS]):
        session.skip_everything("the kernels do not work on this GPU")
        report.show()
        return 1
    gsplats = [
        Gsplat(wheel, options.work, environment, machine, len(gsplat_wheels))
        for wheel in gsplat_wheels
        if not reason and session.wants_gsplat()
    ]
    if not gsplats:
        told = "a dry run has none" if reason else "no wheel of it is in the folder of --wheels"
        report.add("gsplat", "skipped", f"{told}, so nothing is compared with it")
    session.leave_out()
    session.tests()
    session.sanitizers()
    session.wait_for(gsplats)
    usable = [gsplat for gsplat in gsplats if not gsplat.problem]
    first = usable[0] if usable else None
    session.drawings(first)
    session.profiles()
    session.trainings(first, options.steps)
    if first:
        session.gsplat_tests(first)
    for other in usable[1:]:
        session.drawings(other, again=True)
    report.show()
    return 1 if report.failed else 0


def _options() -> argparse.Namespace:
    """The command line."""
    temporary = Path(tempfile.gettempdir(), "gsfw-gpu")
    parser = argparse.ArgumentParser(prog="gpu.sh", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--parts",
        default="works,tests,drawings,trainings",
        type=lambda text: tuple(text.split(",")),
        help="of works (seconds), tests, sanitizers, drawings, profiles, trainings, or single "
        "ones such as 5M (default: %(default)s)",
    )
    parser.add_argument("--budget", type=float, default=470.0, help="seconds for everything")
    parser.add_argument("--steps", type=int, default=30_000, help="of a training, if they fit")
    parser.add_argument("--data", type=Path, help="folder with garden_workload.npz, fox/, chair/")
    parser.add_argument("--wheels", type=Path, help="folder of wheels to install, gsplat's too")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(os.environ.get("OUT") or temporary / "out"),
        help="folder for gpu.md and gpu.json (default: %(default)s)",
    )
    parser.add_argument(
        "--work", type=Path, default=temporary, help="folder for the rest (default: %(default)s)"
    )
    parser.add_argument(
        "--dry-run-on-cpu", action="store_true", help="all parts at a tiny size, without a GPU"
    )
    options = parser.parse_args()
    for name in ("data", "wheels"):
        folder = getattr(options, name)
        if folder and not folder.is_dir():
            parser.error(f"--{name} {folder}: there is no such folder")
    for name in ("work", "out", "data", "wheels"):
        folder = getattr(options, name)
        setattr(options, name, folder and folder.resolve())
    return options


if __name__ == "__main__":
    sys.exit(main())
