"""Tests of package/gsfw/__init__.py, from which the build makes the package's own module."""

import re
import subprocess
import sys
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
from support.public_surface import imports

from gsfw.core.files.toml_text import parsed_toml

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "package" / "gsfw" / "__init__.py"


def package() -> ModuleType:
    """The module, which need not be the installed one."""
    spec = spec_from_file_location("gsfw_of_the_tree", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_name_is_that_of_the_public_interface():
    module = package()
    names = [name for name in dir(module) if name != "__version__"]
    assert {"train", "open", "load", "render", "Cameras", "Splats"} <= set(names)
    interface = import_module("gsfw.api")
    for name in names:
        assert getattr(module, name) is getattr(interface, name), name
    with pytest.raises(AttributeError, match="module 'gsfw' has no attribute 'trian'"):
        _ = module.trian


def test_the_help_of_the_package_has_every_name():
    module = package()
    described = set(re.findall(r"[\w.]+", module.__doc__))
    assert set(dir(module)) - {"__version__"} <= described


def test_type_checkers_see_every_name():
    groups = package()._GROUPS
    assert set(imports(SOURCE).values()) == {
        (f"gsfw.api.{group}", name) for group, names in groups.items() for name in names
    }
    assert (ROOT / ".typing" / "gsfw" / "__init__.pyi").read_text() == SOURCE.read_text()


def test_the_build_makes_the_package_from_it():
    settings = parsed_toml((ROOT / "pyproject.toml").read_text())["tool"]["scikit-build"]
    generated = {item["path"]: item for item in settings["generate"]}
    assert generated["gsfw/__init__.py"]["template-path"] == str(SOURCE.relative_to(ROOT))
    assert '__version__ = "${version}"' in SOURCE.read_text()


def test_importing_it_and_looking_up_train_import_no_torch():
    code = (
        "import runpy, sys\n"
        f"names = runpy.run_path({str(SOURCE)!r})\n"
        "assert names['__getattr__']('train') and names['__getattr__']('open')\n"
        "assert not {'torch', 'numpy', 'rich'} & set(sys.modules), 'heavy'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
