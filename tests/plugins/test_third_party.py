"""A package of someone else: found, listed, trained with; a broken one harms nobody."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.slow_stages import without_slow_stages

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

UNIMPORTABLE = "import a_library_that_nobody_has\n"
HEAD = REGISTRATION.split("@hookimpl", maxsplit=1)[0]
DUPLICATE = (
    HEAD + '@hookimpl\ndef gsfw_strategies():\n    return [Spec("adc", "mine", "nowhere:Adc")]\n'
)
MISSPELT = HEAD + "@hookimpl\ndef gsfw_method():\n    return []\n"
NEWER = HEAD + '@hookimpl\ndef gsfw_methods():\n    return [Spec("a", "", "b:C", api_version=3)]\n'
LOST = HEAD + '@hookimpl\ndef gsfw_methods():\n    return [Spec("lost", "", "lost_parts:Lost")]\n'
FAULTY = (
    HEAD + "@hookimpl\ndef gsfw_strategies():\n"
    '    return [Spec("plain", "", "faulty_parts:Plain")]\n'
)
FAULTY_PARTS = """
from gsfw.core.config import StrategyConfig

class Plain(StrategyConfig):
    size: int = 1

    def refiners(self, scene):
        raise NotImplementedError
"""
FAILING = """
from gsfw.plugins.specs import Spec, hookimpl

@hookimpl
def gsfw_callbacks():
    return [Spec("watch", "", "failing_parts:Watch")]

@hookimpl
def gsfw_metrics():
    return [Spec("weights", "", "failing_parts:Weights")]

@hookimpl
def gsfw_strategies():
    return [Spec("old", "", "failing_parts:Old"), Spec("raising", "", "failing_parts:Raising")]
"""
FAILING_PARTS = """
from dataclasses import dataclass

from gsfw.core.callback import Callback
from gsfw.core.config import StrategyConfig
from gsfw.core.metrics import Metric
from gsfw.core.refiner import Refiner

class Watch(Callback):
    def on_step(self, report, control):
        if report.step > 5:
            raise ConnectionError("no network")

class Weights(Metric):
    def __call__(self, rendered, target, valid):
        raise OSError("no weights")

class RaisingRefiner(Refiner):
    name = "raising"

    def observe(self, context, statistics, model):
        if context.step == 12:
            raise KeyError("gradients")

    def refine(self, context):
        return {}

class OldRefiner(RaisingRefiner):
    def refine(self, step, table):
        return {}

@dataclass
class Old(StrategyConfig):
    def refiners(self, scene):
        return (OldRefiner(),)

@dataclass
class Raising(StrategyConfig):
    def refiners(self, scene):
        return (RaisingRefiner(),)
"""

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
        package(sources / "broken", "gsfw-broken", broken_plugin=UNIMPORTABLE),
        package(sources / "duplicate", "gsfw-duplicate", duplicate_plugin=DUPLICATE),
        package(sources / "misspelt", "gsfw-misspelt", misspelt_plugin=MISSPELT),
        package(sources / "newer", "gsfw-newer", newer_plugin=NEWER),
        package(sources / "lost", "gsfw-lost", lost_plugin=LOST,
                lost_parts="import nothing_like_this\n"),
        package(sources / "faulty", "gsfw-faulty", faulty_plugin=FAULTY,
                faulty_parts=FAULTY_PARTS),
        package(sources / "failing", "gsfw-failing", failing_plugin=FAILING,
                failing_parts=FAILING_PARTS),
    ]  # fmt: skip
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
    ended = subprocess.run(
        [sys.executable, "-m", "gsfw", *arguments],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    ended.stderr = without_slow_stages(ended.stderr)
    return ended


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
    assert "method 3dgs, growth by still" in result.stdout


@pytest.mark.slow
def test_its_settings_are_in_the_help_and_have_did_you_mean(site):
    result = gsfw(site, "dots", "train", "method=dots", "strategy=still", "--help")
    assert "Steps it waits before doing nothing." in result.stdout
    result = gsfw(site, "dots", "train", "method=dots", "siz=2")
    assert "unknown key 'siz'. Did you mean 'size'?" in result.stderr


@pytest.mark.slow
def test_a_run_whose_plugin_is_gone_says_which_package_had_it(site, tmp_path):
    out = tmp_path / "run"
    gsfw(site, "dots", "train", "method=dots", *SMALL, "steps=1", f"out={out}")
    for arguments in (["resume", str(out), "steps=2"], ["train", f"config={out / 'config.yaml'}"]):
        result = gsfw(site, "", *arguments)
        assert result.returncode == 2
        assert result.stderr == (
            "error: no method 'dots' is installed here. The run was made with gsfw-dots 0.3.\n"
            "Install it, if you trust it: pip install gsfw-dots==0.3\n"
        )


@pytest.mark.slow
def test_one_that_does_not_import_is_skipped_with_a_line_and_the_rest_works(site):
    result = gsfw(site, "broken_plugin,dots", "train", "method=dots", *SMALL, "--dry-run")
    assert result.returncode == 0, result.stderr
    reason = (
        "plugin 'broken_plugin' (gsfw-broken 0.3) is skipped: "
        "ModuleNotFoundError: No module named 'a_library_that_nobody_has'. "
        "Install what it needs, or uninstall gsfw-broken."
    )
    assert result.stderr.splitlines()[0] == f"warning: {reason}"
    assert result.stderr.count("'broken_plugin'") == 1
    assert reason in gsfw(site, "broken_plugin", "plugins").stdout


BROKEN = {
    "broken_plugin": "No module named 'a_library_that_nobody_has'",
    "duplicate_plugin": "strategy 'adc' (gsfw-duplicate 0.3) is skipped: this name is taken",
    "misspelt_plugin": "there is no such hook (did you mean 'gsfw_methods'?)",
    "newer_plugin": "registers a Spec with the field 'api_version'",
    "faulty_plugin": "strategy 'plain' (gsfw-faulty 0.3) is skipped: Plain is no dataclass",
    "lost_plugin": "No module named 'nothing_like_this'",
}
"""One fault each."""


@pytest.mark.slow
def test_broken_plugins_are_named_and_stop_no_verb(site, tmp_path):
    plugins = ",".join(BROKEN)
    listed = gsfw(site, plugins, "plugins")
    assert listed.returncode == 0, listed.stderr
    assert all(reason in listed.stdout for reason in BROKEN.values())
    assert listed.stdout.count("is skipped: ") == len(BROKEN)
    found = gsfw(site, plugins, "doctor", "json=true")
    assert found.returncode == 0, found.stderr
    details = [item["details"] for item in json.loads(found.stdout)["findings"]]
    for reason in BROKEN.values():
        assert any(reason.rpartition("skipped: ")[2] in item for item in details)
    trained = gsfw(site, plugins, "train", "method=3dgs", *SMALL, f"out={tmp_path / 'run'}")
    assert trained.returncode == 0, trained.stderr
    misspelt = gsfw(site, plugins, "train", "method=3dgs", "strategy.refine_evry=3")
    assert "Did you mean 'strategy.refine_every'?" in misspelt.stderr


@pytest.mark.slow
def test_parts_that_fail_while_a_run_trains_are_named_and_the_run_goes_on(site, tmp_path):
    out = tmp_path / "run"
    result = gsfw(site, "failing_plugin", "train", "method=3dgs", *SMALL, f"out={out}", "json=true")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert (summary["steps"], summary["weights"]) == (20, None)
    assert summary["psnr"] > 10
    for warning in (
        "callback 'watch' (gsfw-failing 0.3) failed in on_step and is switched off; the run "
        "continues: ConnectionError: no network",
        "metric 'weights' (gsfw-failing 0.3) failed; its figures are NaN: OSError: no weights",
    ):
        assert result.stderr.count(f"warning: {warning}") == 1
        assert (out / "log.txt").read_text().count(warning) == 1
    off = gsfw(site, "failing_plugin", "train", "method=3dgs", *SMALL, f"out={tmp_path / 'off'}",
               "callbacks.watch.enabled=false")  # fmt: skip
    assert "watch" not in off.stderr


@pytest.mark.slow
def test_a_strategy_for_another_gsfw_and_one_that_raises_are_named_with_their_package(
    site, tmp_path
):
    old = gsfw(site, "failing_plugin", "train", "method=3dgs", "strategy=old", *SMALL)
    assert old.returncode == 2
    assert "strategy 'old' (gsfw-failing 0.3) cannot be used: OldRefiner.refine(" in old.stderr
    out = tmp_path / "run"
    raising = ("method=3dgs", "strategy=raising", *SMALL, f"out={out}")
    result = gsfw(site, "failing_plugin", "train", *raising)
    assert result.returncode == 1
    assert "observe of gsfw-failing 0.3 (failing_parts.py, line " in result.stderr
    assert "KeyError: 'gradients'" in result.stderr
    assert "This is a bug of gsfw-failing, or it was made for another gsfw." in result.stderr
    assert "KeyError: 'gradients'" in (out / "log.txt").read_text(), "it has trained: it stays"
