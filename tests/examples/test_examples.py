"""The packages of examples/ are registered, import the public interface alone, and train.

Their own tests, which need them installed, run in .ci/examples.
"""

import ast
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

from gsfw.core.config import MethodConfig
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import compose
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.registry import SLOTS, Registry
from gsfw.plugins.settings import Layer, resolve

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FOLDERS = sorted(path.parent for path in EXAMPLES.glob("*/pyproject.toml"))
PUBLIC = ("gsfw.api", "gsfw.testing")
OTHERS = {"numpy", "PIL", "pytest", "torch", "wandb"}
"""Packages that examples may import, besides the standard library and those of examples."""
SCENE = {
    "datamanager": "synthetic", "datamanager.views": "4", "datamanager.eval_views": "1",
    "datamanager.width": "32", "datamanager.height": "24", "datamanager.points": "100",
    "device": "cpu", "eval_every": "0", "steps": "12", "rescale": "false",
    "strategy.refine_start": "4", "strategy.refine_every": "4",
}  # fmt: skip


def module_of(folder: Path) -> str:
    """The module of the only entry point, which is also the only package."""
    text = (folder / "pyproject.toml").read_text()  # Python 3.10 cannot read TOML.
    (module,) = re.findall(r'^packages = \["(\w+)"\]$', text, re.MULTILINE)
    assert re.search(rf'entry-points.gsfw\]\n[\w-]+ = "{module}"\n', text)
    assert f'name = "{module.replace("_", "-")}"\n' in text
    return module


@pytest.fixture
def registry(monkeypatch):
    """The registry of the built-in parts and of all examples."""
    discovery = Discovery()
    discovery.load_builtin()
    for folder in FOLDERS:
        monkeypatch.syspath_prepend(str(folder))
        name = module_of(folder)
        discovery.add(import_module(name), PluginSource(name, name, "1.0.0", name))
    return Registry(discovery)


def test_every_example_registers_parts_whose_targets_load(registry):
    names = {module_of(folder) for folder in FOLDERS}
    specs = [(slot, spec) for slot in SLOTS for spec in registry.slot(slot).values()]
    own = [(slot, spec) for slot, spec in specs if spec.distribution in names]
    assert not registry.broken
    assert {spec.distribution for _, spec in own} == names
    for slot, spec in own:
        target = spec.load()
        assert callable(target)
        if slot == "method":
            assert issubclass(target, MethodConfig)
            resolve(registry, [Layer("the test", {"method": spec.name})])


def imported(file: Path) -> set[str]:
    """Every module that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: a relative import"
            found.add(node.module)
    return found


def test_examples_import_the_public_interface_alone():
    own = {module_of(folder) for folder in FOLDERS}
    for file in EXAMPLES.rglob("*.py"):
        for name in imported(file):
            top = name.partition(".")[0]
            allowed = name in PUBLIC or top in own | OTHERS or top in sys.stdlib_module_names
            assert allowed, f"{file.relative_to(EXAMPLES)} imports {name}"


def test_the_table_lists_every_example_and_each_tells_its_command_and_figures():
    table = (EXAMPLES / "README.md").read_text()
    for folder in FOLDERS:
        text = (folder / "README.md").read_text()
        assert f"[{folder.name}]({folder.name}/README.md)" in table
        assert "pip install" in text
        assert "gsfw train" in text
        assert "\n## Results\n" in text
        assert "RESULT" not in text
    assert "RESULT" not in table


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", ["2dgs", "3dgs-appearance", "3dgs-depth", "feature-3dgs", "mip-splatting"]
)
def test_every_method_of_the_examples_trains_through_density_control(registry, method, tmp_path):
    if method == "3dgs-depth":
        import_module("gsfw_rgbd.room").write_room(tmp_path / "room", 6, 32, 0.0)
        keep = {key: SCENE[key] for key in SCENE if not key.startswith("datamanager")}
        settings = {**keep, "data": str(tmp_path / "room"), "datamanager": "tum-rgbd"}
    else:
        settings = SCENE
    layer = Layer("the test", {**settings, "method": method})
    summary = compose(resolve(registry, [layer]), registry).trainer(RunFolder(tmp_path / "r")).fit()
    assert summary["psnr"] > 5
