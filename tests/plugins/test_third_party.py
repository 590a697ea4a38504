"""A package of someone else: found, listed, trained with; a broken one harms nobody."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT_FILE = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"

[project]
name = "{name}"
version = "0.3"

[project.entry-points.gsfw]
{module} = "{module}"

[tool.setuptools]
py-modules = {modules}
"""

REGISTRATION = """
from gsfw.plugins.specs import Spec, hookimpl

@hookimpl
def gsfw_methods():
    return [Spec("dots", "splats of one colour each", "dots_parts:Dots", paper="Dot 2030")]

@hookimpl
def gsfw_strategies():
    return [Spec("still", "no rows come or go", "dots_parts:Still")]

@hookimpl
def gsfw_rasterizers():
    return [Spec("mirror", "the reference under another name", "dots_parts:Mirror")]
"""

PARTS = '''
from dataclasses import dataclass

from gsfw.core.config import StrategyConfig
from gsfw.core.refiner import Refiner
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.rasterizers.reference.config import ReferenceConfig

@dataclass
class Dots(StaticGaussiansConfig):
    sh_degree: int = 0
    """Always 0: dots have one colour."""
    size: float = 1.0
    """Size of a dot."""

@dataclass
class Still(StrategyConfig):
    patience: int = 3
    """Steps it waits before doing nothing."""

    def refiners(self, scene):
        return (StillRefiner(self.patience),)

class StillRefiner(Refiner):
    name = "still"

    def __init__(self, patience):
        self.left = patience

    def observe(self, context, statistics, model):
        self.left -= 1

    def refine(self, context):
        return {}

    def state_dict(self):
        return {"left": self.left}

    def load_state_dict(self, state):
        self.left = state["left"]

@dataclass
class Mirror(ReferenceConfig):
    tint: float = 0.0
    """Unused."""
'''

BROKEN = "import a_library_that_nobody_has\n"
DUPLICATE = REGISTRATION.split("@hookimpl", maxsplit=1)[0] + (
    '@hookimpl\ndef gsfw_strategies():\n    return [Spec("adc", "mine", "nowhere:Adc")]\n'
)
MISSPELT = (
    REGISTRATION.split("@hookimpl", maxsplit=1)[0]
    + "@hookimpl\ndef gsfw_method():\n    return []\n"
)

SMALL = (
    "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "steps=20",
)  # fmt: skip


def package(folder: Path, name: str, **modules: str) -> Path:
    """Write a package whose first module is the entry point."""
    folder.mkdir()
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text)
    first = next(iter(modules))
    project = PROJECT_FILE.format(name=name, module=first, modules=json.dumps(list(modules)))
    (folder / "pyproject.toml").write_text(project)
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder with all of the packages, installed as users install them."""
    sources, target = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("site")
    packages = [
        package(sources / "dots", "gsfw-dots", dots=REGISTRATION, dots_parts=PARTS),
        package(sources / "broken", "gsfw-broken", broken_plugin=BROKEN),
        package(sources / "duplicate", "gsfw-duplicate", duplicate_plugin=DUPLICATE),
        package(sources / "misspelt", "gsfw-misspelt", misspelt_plugin=MISSPELT),
    ]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    pip += ["--no-build-isolation", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([*pip, *map(str, packages)], check=True)
    return target


def gsfw(site: Path, plugins: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {
        "PYTHONPATH": str(site),
        "GSFW_PLUGINS": plugins,
        "OMP_NUM_THREADS": "1",  # The scenes are tiny.
    }
    return subprocess.run(
        [sys.executable, "-m", "gsfw", *arguments],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip


@pytest.mark.slow
def test_what_it_brings_is_listed_with_its_name_and_version(site):
    result = gsfw(site, "dots", "plugins", "json=true")
    assert result.returncode == 0, result.stderr
    found = {
        (item["slot"], item["name"]): (item["distribution"], item["version"], item["paper"])
        for item in json.loads(result.stdout)["plugins"]
    }
    assert found["method", "dots"] == ("gsfw-dots", "0.3", "Dot 2030")
    assert found["strategy", "still"] == ("gsfw-dots", "0.3", "")
    assert found["rasterizer", "mirror"] == ("gsfw-dots", "0.3", "")
    assert found["method", "3dgs"][0] == "gsfw"


@pytest.mark.slow
def test_its_parts_train_together_and_with_built_in_ones(site, tmp_path):
    out = tmp_path / "run"
    chosen = ("method=dots", "strategy=still", "strategy.patience=5", "rasterizer=mirror")
    result = gsfw(site, "dots", "train", *chosen, *SMALL, f"out={out}", "json=true")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert (summary["steps"], summary["num_gaussians"]) == (20, 150)
    assert "- gsfw-dots 0.3" in (out / "config.yaml").read_text()

    result = gsfw(site, "dots", "train", "method=3dgs", "strategy=still", *SMALL, "--dry-run")
    assert result.returncode == 0, result.stderr
    assert "method 3dgs, strategy still" in result.stdout


@pytest.mark.slow
def test_its_settings_are_in_the_help_and_have_did_you_mean(site):
    result = gsfw(site, "dots", "train", "method=dots", "strategy=still", "--help")
    assert "Steps it waits before doing nothing." in result.stdout
    result = gsfw(site, "dots", "train", "method=dots", "siz=2")
    assert "unknown key 'siz'. Did you mean 'size'?" in result.stderr


@pytest.mark.slow
def test_a_run_whose_plugin_is_gone_says_what_is_missing(site, tmp_path):
    out = tmp_path / "run"
    gsfw(site, "dots", "train", "method=dots", *SMALL, "steps=1", f"out={out}")
    result = gsfw(site, "", "resume", str(out), "steps=2")
    assert result.returncode == 2
    assert result.stderr.startswith("error: no method 'dots'.")


@pytest.mark.slow
def test_one_that_does_not_import_is_skipped_with_a_line_and_the_rest_works(site):
    result = gsfw(site, "broken_plugin,dots", "train", "method=dots", *SMALL, "--dry-run")
    assert result.returncode == 0, result.stderr
    reason = (
        "plugin 'broken_plugin' (gsfw-broken) is skipped: "
        "ModuleNotFoundError: No module named 'a_library_that_nobody_has'"
    )
    assert result.stderr.splitlines()[0] == f"warning: {reason}"
    assert result.stderr.count("broken_plugin") == 1
    assert reason in gsfw(site, "broken_plugin", "plugins").stdout


@pytest.mark.slow
def test_a_name_that_is_taken_is_an_error_that_names_both_packages(site):
    result = gsfw(site, "duplicate_plugin", "train", "method=3dgs", "strategy=adc")
    assert result.returncode == 2
    assert result.stderr == (
        "error: strategy 'adc' is registered by both 'gsfw' and 'gsfw-duplicate'.\n"
        "Uninstall one of them, or load only some with GSFW_PLUGINS=name,name.\n"
    )


@pytest.mark.slow
def test_a_hook_that_does_not_exist_is_an_error_with_a_suggestion(site):
    result = gsfw(site, "misspelt_plugin", "train", "method=3dgs")
    assert result.returncode == 2
    assert result.stderr == (
        "error: plugin 'misspelt_plugin' (gsfw-misspelt): there is no hook 'gsfw_method'. "
        "Did you mean 'gsfw_methods'?\n"
    )
