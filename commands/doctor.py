"""The verb ``doctor``: checks of this machine, with the reason and the remedy of each fault."""

from __future__ import annotations

import importlib
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from packaging.requirements import Requirement
from packaging.version import Version

from gsfw.commands.interface.arguments import Options, read_options
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.progress import loading_torch
from gsfw.core.cores import cores
from gsfw.core.machine_memory import memory_limits
from gsfw.plugins.loading import load_third_parties
from gsfw.plugins.registry import Registry, installed
from gsfw.plugins.specs import PROJECT

if TYPE_CHECKING:
    from gsfw.core.capabilities import Capabilities

SAFE_CHECKPOINTS = Version("2.10")
"""First torch whose ``weights_only=True`` no known file gets around (GHSA-63cw-57p8-fm3p)."""
LIBRARIES = {
    "matplotlib": "matplotlib",
    "numpy": "numpy",
    "pycolmap": "pycolmap",
    "scipy": "scipy",
    "tensorboard": "tensorboard",
    "PIL": "Pillow",
    "yaml": "PyYAML",
}
"""Libraries that training imports, and the packages that have them."""
FOR_DEVELOPERS = {"docs", "test"}
"""Extras of this package that no verb needs."""
WRITE_ACCESS = "write access"
"""The check of the folder that the command is given in."""


@dataclass(kw_only=True)
class DoctorOptions(Options):
    """Check the parts of this machine, and explain each fault.

    The exit code is 1 where something is missing without which nothing can be trained.
    """

    examples: ClassVar[tuple[str, ...]] = ("gsfw doctor", "gsfw doctor json=true")


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    what: str
    status: str
    """ok, missing (something is lost), or broken (nothing can be trained)."""
    details: str


def run(tokens: list[str]) -> int:
    """Run all checks."""
    options = read_options("doctor", DoctorOptions, tokens)
    console = Console(options.json)
    with loading_torch(" and other libraries"):
        findings = [*_versions(), *_libraries()]
    findings += [_extras(), _native(), _cuda(), *_self_tests()]
    findings += [*_rasterizers(installed()), *_plugins(installed()), _write_access()]
    console.table(
        ["", "status", "details"],
        [[finding.what, finding.status, finding.details] for finding in findings],
    )
    broken = [finding.what for finding in findings if finding.status == "broken"]
    console.say(f"broken: {', '.join(broken)}" if broken else _all_works(findings))
    console.result({"ok": not broken, "findings": [asdict(finding) for finding in findings]})
    return 1 if broken else 0


def _all_works(findings: Sequence[Finding]) -> str:
    """The verdict where nothing is broken, with what a run needs here."""
    can_write = all(item.status == "ok" for item in findings if item.what == WRITE_ACCESS)
    return f"everything that is needed works{'' if can_write else '; runs need out=DIR here'}"


def _versions() -> Iterator[Finding]:
    yield Finding(PROJECT, "ok", metadata.version(PROJECT))
    yield Finding("python", "ok", f"{platform.python_version()} at {sys.executable}")
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"
    share = "" if cores() == os.cpu_count() else f", of which this process may use {cores()}"
    yield Finding("machine", "ok", f"{machine}{share}")
    memory = dict.fromkeys(map(str, memory_limits()))
    yield Finding("memory", "ok", "; ".join(memory) or "the system does not tell")
    try:
        import torch
    except ImportError as error:
        yield Finding("torch", "broken", f"{error}; pip install torch")
        return
    yield Finding("torch", "ok", f"{torch.__version__}, {torch.get_num_threads()} threads")
    if Version(torch.__version__) < SAFE_CHECKPOINTS:
        yield Finding(
            "checkpoints of others", "missing",
            f"a safe way to read them: with torch before {SAFE_CHECKPOINTS}, a made-up checkpoint "
            "can corrupt memory (CVE-2026-24747). Update torch, or open your own runs alone.",
        )  # fmt: skip
    count = torch.cuda.device_count()
    names = ", ".join(torch.cuda.get_device_name(index) for index in range(count))
    yield Finding("GPUs", "ok", names or "torch sees none")


def _libraries() -> Iterator[Finding]:
    for name, package in LIBRARIES.items():
        try:
            importlib.import_module(name)
        except ImportError as error:
            advice = f"{error}; pip install --force-reinstall {package}"
            yield Finding(name, "broken", advice)
        else:
            yield Finding(name, "ok", "")


def _extras() -> Finding:
    """The optional parts that are installed, and how to install the others."""
    wanted = [Requirement(line) for line in metadata.requires(PROJECT) or ()]
    names = set(metadata.metadata(PROJECT).get_all("Provides-Extra") or ()) - FOR_DEVELOPERS
    missing = [name for name in sorted(names) if not all(map(_is_installed, _of(name, wanted)))]
    found = ", ".join(sorted(names - set(missing))) or "none"
    others = f"; not installed: {', '.join(missing)} (pip install 'gsfw[NAME]')" if missing else ""
    return Finding("extras", "ok", f"{found}{others}")


def _of(extra: str, wanted: Sequence[Requirement]) -> list[Requirement]:
    """The requirements that an extra adds on this machine."""
    return [
        item
        for item in wanted
        if item.marker and item.marker.evaluate({"extra": extra}) and not item.marker.evaluate()
    ]


def _is_installed(wanted: Requirement) -> bool:
    try:
        return wanted.specifier.contains(metadata.version(wanted.name), prereleases=True)
    except metadata.PackageNotFoundError:
        return False


def _native() -> Finding:
    from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets, unavailable

    found = instruction_sets()
    if not found:
        return Finding("native CPU module", "missing", unavailable() or NOT_BUILT)
    return Finding("native CPU module", "ok", f"instruction sets: {', '.join(found)}")


def _cuda() -> Finding:
    from gsfw.kernels.cuda.availability import cuda_system, unavailable

    reason = unavailable()
    if reason:
        return Finding("CUDA kernels", "missing", reason)
    from gsfw.kernels.cuda.cache import KernelCache, cache_folder

    system, cache = cuda_system(), KernelCache(cache_folder())
    problem = cache.problem()
    details = [
        f"NVRTC {'.'.join(map(str, system.nvrtc.version))} at {system.nvrtc.path}",
        f"driver for CUDA {'.'.join(map(str, system.driver.version))}",
        f"compiled for {', '.join(system.targets)}",
        f"compiled anew by every process: {problem}" if problem else f"kept in {cache.folder}",
    ]
    return Finding("CUDA kernels", "ok", "; ".join(details))


def _self_tests() -> Iterator[Finding]:
    """The self-test of every GPU that the CUDA kernels can use; made anew each time."""
    from gsfw.kernels.cuda.availability import cuda_system, unavailable

    if unavailable():
        return
    from gsfw.rasterizers.cuda.tested_gpus import ADVICE, examine, gpu_name

    for index in cuda_system().devices:
        found, what = examine(index), f"self-test cuda:{index}"
        if found.fault:
            yield Finding(what, "missing", f"{gpu_name(index)}: {found.fault}. {ADVICE}")
        else:
            yield Finding(what, "ok", f"{gpu_name(index)} {found}")


def _rasterizers(registry: Registry) -> Iterator[Finding]:
    from gsfw.plugins.automatic import rasterizer_capabilities

    capabilities = rasterizer_capabilities(registry)
    for name, able in capabilities.items():
        status = "missing" if able.unavailable else "ok"
        yield Finding(f"rasterizer {name}", status, able.unavailable or _abilities(able))
    if all(able.unavailable for able in capabilities.values()):
        yield Finding("rasterizers", "broken", "none works here")


def _abilities(able: Capabilities) -> str:
    details = "".join(f"; {key}: {value}" for key, value in able.details.items())
    return f"runs on {', '.join(sorted(able.devices))}{details}"


def _plugins(registry: Registry) -> Iterator[Finding]:
    load_third_parties(registry)  # Only loading a plugin shows its faults.
    for item in registry.broken:
        yield Finding(
            f"{item.kind} {item.name} ({item.package})", "missing", f"{item.reason}. {item.advice}"
        )


def _write_access() -> Finding:
    here = Path.cwd()
    if os.access(here, os.W_OK):
        return Finding(WRITE_ACCESS, "ok", f"runs go to {here / 'runs'}")
    return Finding(WRITE_ACCESS, "missing", f"{here} cannot be written to; give out=DIR")
