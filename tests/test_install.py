"""Installing, as users without a compiler do it."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from gsfw.core.files.toml_text import parsed_toml

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.slow
def test_without_a_compiler_the_package_installs_as_pure_python(tmp_path):
    environment = os.environ | {"CXX": "/no/such/c++", "CC": "/no/such/cc"}
    wheel = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", str(tmp_path), str(ROOT)]
    command = [*wheel, f"-Cbuild-dir={tmp_path / 'build'}"]  # Not in the repository.
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    (built,) = tmp_path.glob("gsfw-*.whl")
    names = zipfile.ZipFile(built).namelist()
    assert "gsfw/core/loop/trainer.py" in names
    assert "gsfw/py.typed" in names
    own = zipfile.ZipFile(built).read("gsfw/__init__.py").decode()
    assert '"runs": ("Run", "open", "train")' in own
    assert '__version__ = "${version}"' not in own
    assert not [name for name in names if name.endswith((".so", ".pyd", ".cpp"))]
    for path in (*ROOT.glob("kernels/cuda/sources/*"), *ROOT.glob("kernels/shared/*.h")):
        assert f"gsfw/{path.relative_to(ROOT)}" in names, "what CUDA kernels are compiled from"
    for path in ROOT.glob("scaffold/templates/*/*.*"):
        assert f"gsfw/{path.relative_to(ROOT)}" in names, "what gsfw new writes packages of"
    for path in ROOT.glob("reports/page.*"):
        assert f"gsfw/{path.relative_to(ROOT)}" in names, "style and script of reports"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
@pytest.mark.skipif(not any(map(shutil.which, ("c++", "g++", "clang++"))), reason="no C++ compiler")
def test_a_compiler_that_is_installed_later_is_found_in_the_same_build_folder(tmp_path):
    before = ["-DCMAKE_CXX_COMPILER=NOTFOUND", "-DSKBUILD_PROJECT_VERSION=0"]
    command = ["cmake", "-S", str(ROOT), "-B", str(tmp_path), *before]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "The CXX compiler identification is" in result.stdout
    assert "no working C++ compiler" not in result.stderr


def test_the_page_on_installation_has_every_extra():
    project = parsed_toml((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (ROOT / "docs" / "start" / "installation.md").read_text(encoding="utf-8")
    table = page.partition("## Extras")[2].partition("\n## ")[0]
    named = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    assert sorted(named) == sorted(project["optional-dependencies"])


def test_the_version_is_that_of_the_distribution():
    from importlib import metadata

    import gsfw

    assert gsfw.__version__ == metadata.version("gsfw")
