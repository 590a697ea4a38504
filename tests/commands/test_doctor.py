"""Tests of gsfw.commands.doctor."""

import json
import sys
from importlib import metadata
from types import SimpleNamespace

import pytest
import torch
from support.fake_parts import registry_of

from gsfw.commands import doctor
from gsfw.commands.main import main
from gsfw.kernels.cpu import native_module
from gsfw.kernels.cuda import availability
from gsfw.kernels.cuda.cache import KernelCache
from gsfw.plugins.specs import Spec, hookimpl
from gsfw.rasterizers.cuda import tested_gpus
from gsfw.rasterizers.cuda.self_test import SelfTest


def findings(capsys) -> dict[str, tuple[str, str]]:
    document = json.loads(capsys.readouterr().out)
    return {item["what"]: (item["status"], item["details"]) for item in document["findings"]}


def test_what_is_installed_works_here(capsys):
    assert main(["doctor", "json=true"]) == 0
    found = findings(capsys)
    assert found["gsfw"] == ("ok", "0.1.0")
    assert found["torch"][0] == found["python"][0] == "ok"
    assert found["rasterizer reference"][0] == "ok"
    assert "cpu" in found["rasterizer reference"][1]


@pytest.mark.parametrize(("version", "is_told"), [("2.9.1+cu128", True), ("2.10.0", False)])
def test_a_torch_that_reads_no_checkpoint_of_others_safely_is_told(
    capsys, monkeypatch, version, is_told
):
    monkeypatch.setattr(torch, "__version__", version)
    assert main(["doctor", "json=true"]) == 0
    assert ("checkpoints of others" in findings(capsys)) == is_told


def test_people_get_a_table_and_a_verdict(capsys):
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert said.endswith("everything that is needed works\n")


def test_in_a_folder_that_cannot_be_written_to_runs_need_another(capsys, monkeypatch):
    monkeypatch.setattr("gsfw.commands.doctor.os.access", lambda path, mode: False)
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out.endswith(
        "everything that is needed works; runs need out=DIR here\n"
    )


def test_without_the_native_module_it_says_what_is_lost(capsys, monkeypatch):
    monkeypatch.setattr(native_module, "instruction_sets", list)
    assert main(["doctor", "json=true"]) == 0
    status, details = findings(capsys)["native CPU module"]
    assert status == "missing"
    assert "a working C++ compiler (GCC or Clang) or the headers of Python were missing" in details


def test_a_library_that_does_not_load_is_installed_anew_by_the_name_of_its_package(
    capsys, monkeypatch
):
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert main(["doctor", "json=true"]) == 1
    status, details = findings(capsys)["PIL"]
    assert status == "broken"
    assert details.endswith("; pip install --force-reinstall Pillow")


def test_optional_parts_are_listed_with_the_command_that_installs_them(capsys, monkeypatch):
    version = metadata.version

    def old(name):
        if name == "av":
            raise metadata.PackageNotFoundError(name)
        return "1.0" if name == "usd-core" else version(name)

    monkeypatch.setattr(metadata, "version", old)
    assert main(["doctor", "json=true"]) == 0
    status, details = findings(capsys)["extras"]
    installed, _, missing = details.partition("; not installed: ")
    assert status == "ok"
    assert "viewer" in installed
    assert missing.endswith("usd, video (pip install 'gsfw[NAME]')")


def test_without_cuda_it_says_why(capsys, monkeypatch):
    reason = "there is no NVIDIA driver on this machine. Install one."
    monkeypatch.setattr(availability, "unavailable", lambda: reason)
    assert main(["doctor", "json=true"]) == 0
    assert findings(capsys)["CUDA kernels"] == ("missing", reason)


@pytest.mark.parametrize(
    ("problem", "kept"),
    [
        ("", "kept in {folder}"),
        ("/ cannot be written to", "compiled anew by every process: / cannot be written to"),
    ],
)
def test_with_cuda_it_says_what_is_used_and_kept_where(
    capsys, monkeypatch, tmp_path, problem, kept
):
    nvrtc = SimpleNamespace(version=(13, 0), path="/lib/libnvrtc.so.13")
    system = SimpleNamespace(
        nvrtc=nvrtc,
        driver=SimpleNamespace(version=(13, 1)),
        targets=("sm_90", "sm_120"),
        devices=(0, 2),
    )
    results = {0: SelfTest(2.04), 2: SelfTest(1.0, "an image differs")}
    monkeypatch.setattr(tested_gpus, "examine", results.__getitem__)
    monkeypatch.setattr(tested_gpus, "gpu_name", "GPU {}".format)
    monkeypatch.setattr(availability, "unavailable", str)
    monkeypatch.setattr(availability, "cuda_system", lambda: system)
    monkeypatch.setenv("GSFW_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(KernelCache, "problem", lambda self: problem)
    assert main(["doctor", "json=true"]) == 0
    found = findings(capsys)
    assert found["self-test cuda:0"] == (
        "ok",
        "GPU 0 passed in 2.0 s: sorting, an image and its gradient are right",
    )
    status, details = found["self-test cuda:2"]
    assert status == "missing"
    assert details.startswith("GPU 2: an image differs. Use rasterizer=gsplat if it is installed, ")
    assert found["CUDA kernels"] == (
        "ok",
        "NVRTC 13.0 at /lib/libnvrtc.so.13; driver for CUDA 13.1; compiled for sm_90, sm_120; "
        + kept.format(folder=tmp_path / "kernels"),
    )


class Lost:
    @hookimpl
    def gsfw_rasterizers(self):
        return [Spec("lost", "", "no_such_module_of_gsfw:Config")]

    @hookimpl
    def gsfw_samplers(self):
        raise RuntimeError("no network")


def test_without_any_rasterizer_nothing_can_be_trained(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "installed", lambda: registry_of(Lost()))
    assert doctor.run(["json=true"]) == 1
    found = findings(capsys)
    assert found["rasterizers"] == ("broken", "none works here")
    assert found["rasterizer lost"][1].endswith("No module named 'no_such_module_of_gsfw'.")
    status, details = found["hook gsfw_samplers (pkg0 1.0)"]
    assert status == "missing"
    assert details.startswith("it raised RuntimeError: no network. This is ")
