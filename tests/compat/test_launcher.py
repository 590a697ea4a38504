import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from support.forks import ended_forks

SCRIPTS = Path(__file__).parent / "scripts"


def launched(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gsfw.compat", *map(str, arguments)]
    one_thread = {"OMP_NUM_THREADS": "1", "GSFW_STATE_DIR": "none"}
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | one_thread | environment,
    )


def figures(done: subprocess.CompletedProcess[str]) -> tuple[float, int]:
    """PSNR and number of Gaussians that a small trainer says."""
    assert done.returncode == 0, done.stderr
    found = re.match(r"PSNR ([0-9.]+) gaussians (\d+)", done.stdout)
    assert found, done.stdout
    return float(found[1]), int(found[2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "options"),
    [
        ("inria_like.py", ()),
        ("gsplat_like.py", ()),
        ("gsplat_like.py", ("packed", "absgrad")),
    ],
)
def test_a_small_trainer_for_cuda_learns_and_grows_on_the_cpu(script, options):
    psnr, count = figures(launched(SCRIPTS / script, "60", *options))
    assert psnr > 23
    assert count > 100, "it started from 60"


@pytest.mark.slow
def test_a_script_sees_its_own_modules_arguments_and_the_chosen_rasterizer(tmp_path):
    (tmp_path / "scene.py").write_text("NAME = 'its own'\n")
    (tmp_path / "train.py").write_text(
        "import os, sys, torch\n"
        "from scene import NAME\n"
        "from gsplat.rendering import rasterization\n"
        "from simple_knn._C import distCUDA2\n"
        "print(__name__, NAME, sys.argv[1:], torch.zeros(2, device='cuda').device.type,\n"
        "      os.environ['GSFW_RASTERIZER'], rasterization.__module__)\n"
    )
    done = launched("--rasterizer", "reference", tmp_path / "train.py", "-s", "DATA")
    expected = "__main__ its own ['-s', 'DATA'] cpu reference gsfw.compat.gsplat\n"
    assert done.stdout == expected, done.stderr
    assert "simple_knn" in done.stderr.splitlines()[0]
    assert done.stderr.splitlines()[0].endswith("; rasterizer reference.")


@pytest.mark.slow
@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU to keep it for")
def test_without_a_gpu_an_installed_module_is_replaced_and_the_first_line_says_so(tmp_path):
    (tmp_path / "simple_knn").mkdir()
    (tmp_path / "simple_knn" / "__init__.py").write_text("")
    (tmp_path / "simple_knn" / "_C.py").write_text("distCUDA2 = 'the original'\n")
    (tmp_path / "train.py").write_text(
        "from simple_knn._C import distCUDA2\nprint(callable(distCUDA2))\n"
    )
    done = launched(tmp_path / "train.py")
    assert done.stdout == "True\n"
    first = done.stderr.splitlines()[0]
    assert "simple_knn" in first.partition(" replaced;")[0]
    assert "there is no GPU, so installed ones are replaced too" in first


REFUSED = (
    ("import lpipsy", 2, "train.py:2: the package 'lpipsy' is not installed."),
    ("import lpipsy", 2, "put --without lpipsy before the script."),
    ("import diff_surfel_rasterization", 2, "gsfw train method=2dgs"),
    (
        "from diff_gaussian_rasterization import SparseGaussianAdam",
        2,
        "train.py:2: gsfw.compat does not support diff_gaussian_rasterization.SparseGaussianAdam.",
    ),
    ("import diff_gaussian_rasterization._C", 2, "support diff_gaussian_rasterization._C."),
    ("image, radii, depth, alpha = (1, 2)", 1, "its fork returns 4 results"),
    ("assert torch.cuda.is_available(), 'no GPU'", 1, "put --claim-gpu before the script"),
    ("image, radii, depth = (1, 2)", 1, "--third depth or --third invdepth"),
    (
        "from gsplat import rasterization_2dgs\nrasterization_2dgs()",
        2,
        "train.py:3: gsplat: gsfw.compat does not support rasterization_2dgs.",
    ),
    ("raise RuntimeError('its own')", 1, "RuntimeError: its own"),
)
"""Code of scripts, and with which code and words they end."""

LOADED = """
from importlib import import_module
import torch._dynamo
from gsfw.compat import explanation, replacement
for places in replacement.MODULES.values():
    for place in places.values():
        import_module(f"gsfw.compat.{place}")
"""
"""What every launch loads."""

LAUNCH = """
import runpy
sys.argv[1:] = [{script!r}]
runpy.run_module("gsfw.compat", run_name="__main__", alter_sys=True)
"""


@pytest.fixture(scope="module")
def refused(tmp_path_factory) -> dict[str, subprocess.CompletedProcess[str]]:
    """Each script of ``REFUSED`` as the launcher ends it, by its code."""
    folder = tmp_path_factory.mktemp("refused")
    codes = list(dict.fromkeys(code for code, _, _ in REFUSED))
    programs = {}
    for number, code in enumerate(codes):
        script = folder / str(number) / "train.py"
        script.parent.mkdir()
        script.write_text(f"import torch\n{code}\n")
        programs[f"said{number}"] = LAUNCH.format(script=str(script))
    return dict(zip(codes, ended_forks(LOADED, programs, folder).values(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("code", "exit_code", "said"), REFUSED)
def test_what_a_script_cannot_do_is_said_with_its_line_and_a_remedy(refused, code, exit_code, said):
    done = refused[code]
    assert done.returncode == exit_code
    assert said in done.stderr
    assert (exit_code == 1) == ("Traceback" in done.stderr)


@pytest.mark.slow
def test_a_script_that_is_not_there_is_named():
    done = launched("trane.py")
    assert done.returncode == 1
    assert (
        done.stderr == "There is no script trane.py. Give its path after python -m gsfw.compat.\n"
    )
