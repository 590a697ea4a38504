"""Written packages as their authors use them: installed in a fresh environment, trained, tested."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
from dataclasses import dataclass
from pathlib import Path

import pytest
from PIL import Image
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.scaffold.kinds import BASES, KINDS

pytestmark = pytest.mark.slow

NAMES = {f"my-{slot}": (slot, "") for slot in KINDS}
NAMES |= {f"my-{like}": ("method", like) for like in BASES}
"""Every package that is written: its kind, and the base of a method."""

SHORT = ("steps=20", "report=false", *SMALL_SCENE)

COMMANDS = """
import json, sys
from gsfw.commands.main import main
for command in json.loads(sys.argv[1]):
    print("gsfw", *command, flush=True)
    if code := main(command):
        sys.exit(code)
"""
"""Program that runs several commands: each on its own would import torch anew."""


@dataclass(frozen=True)
class Environment:
    """A fresh virtual environment with all packages."""

    folder: Path
    """Place of the packages, and of runs."""
    python: Path

    def run(self, *arguments: str, **variables: str) -> str:
        """Run Python here; return the output, with errors."""
        result = subprocess.run(
            [str(self.python), *arguments],
            cwd=self.folder,
            env=os.environ | variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        assert result.returncode == 0, result.stdout
        return result.stdout

    def gsfw(self, *commands: tuple[str, ...], **variables: str) -> str:
        """Run commands of gsfw, one after the other."""
        return self.run("-c", COMMANDS, json.dumps(commands), **variables)


def fresh(folder: Path) -> Environment:
    """An environment without plugins, which shares the libraries of this one."""
    venv.create(folder / "venv")
    place = "Scripts" if os.name == "nt" else "bin"
    python = folder / "venv" / place / "python"
    paths = {"base": str(folder / "venv"), "platbase": str(folder / "venv")}
    libraries = Path(sysconfig.get_path("purelib", vars=paths))
    ours = sysconfig.get_path("purelib")
    (libraries / "libraries.pth").write_text(f"import site; site.addsitedir({ours!r})\n")
    return Environment(folder, python)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    found = fresh(tmp_path_factory.mktemp("authors"))
    folders = [str(found.folder / name) for name in NAMES]
    for name, (slot, like) in NAMES.items():
        given = [f"like={like}"] if like else []
        assert main(["new", slot, name, *given, f"out={found.folder / name}"]) == 0
    # Neither the network nor a build environment: setuptools is here.
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", found.python]
    offline = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "install", *offline, *folders], check=True)
    return found


def test_every_part_is_listed_and_none_is_broken(environment):
    document = json.loads(environment.run("-m", "gsfw", "plugins", "json=true"))
    assert document["broken"] == []
    found = {(item["slot"], item["name"]) for item in document["plugins"]}
    assert found >= {(slot, name) for name, (slot, _) in NAMES.items()}


def test_methods_train(environment):
    moving = ("datamanager.moving=true", "datamanager.times=3")
    output = environment.gsfw(
        ("train", "method=my-method", *SHORT, "out=runs/own"),
        ("train", "method=my-3dgs", *SHORT, "out=runs/like"),
        *(
            ("train", f"method=my-{like}", *SHORT, *moving, f"out=runs/{like}")
            for like in BASES
            if like != "3dgs"
        ),
    )
    assert "skipped" not in output
    log = (environment.folder / "runs" / "4dgs" / "metrics.jsonl").read_text().splitlines()
    assert "loss/brightness" in json.loads(log[0])


def test_parts_of_a_run_work_together(environment):
    parts = ("strategy=my-strategy", "strategy.every=5", "sampler=my-sampler")
    environment.gsfw(
        ("train", "method=3dgs", *parts, *SHORT, "out=runs/parts"),
        ("export", "runs/parts", "format=my-exporter", "out=splats.csv"),
        ("info", "splats.csv"),
        ("my-command", "runs/parts"),
    )
    run = environment.folder / "runs" / "parts"
    assert 0 < json.loads((run / "metrics.json").read_text())["my-metric"] < 1
    lines = (run / "losses.csv").read_text().splitlines()
    assert lines[0] == "step,gaussians,l1,dssim"
    assert [line.split(",")[0] for line in lines[1:]] == ["1", "10", "20"]


def test_the_rasterizer_trains(environment):
    given = ("rasterizer=my-rasterizer", *SHORT, "datamanager.points=50", "out=runs/own-renders")
    environment.gsfw(("train", "method=3dgs", *given))


def test_the_data_manager_is_recognised_and_trained_on(environment):
    folder = environment.folder / "capture"
    folder.mkdir()
    frames = []
    for i in range(4):
        Image.new("RGB", (32, 24), (60 * i, 100, 200)).save(folder / f"{i}.png")
        pose = [[1, 0, 0, 0.1 * i], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]
        lens = {"fx": 30, "fy": 30, "cx": 16, "cy": 12}
        frames.append({"image": f"{i}.png", **lens, "world_to_camera": pose})
    (folder / "poses.json").write_text(json.dumps({"frames": frames}))
    given = ("random_points=50", "steps=20", "report=false", "out=runs/data")
    environment.gsfw(("train", "method=3dgs", "data=capture", *given))
    config = (environment.folder / "runs" / "data" / "config.yaml").read_text()
    assert "datamanager: my-datamanager" in config


def test_their_own_tests_pass(environment):
    # Those of methods that derive from moving ones take minutes.
    folders = [f"{name}/tests" for name, (_, like) in NAMES.items() if like in ("", "3dgs")]
    environment.run("-m", "pytest", "-q", "-p", "no:cacheprovider", *folders)


def test_nothing_need_be_installed_with_a_plugin_path(tmp_path):
    found = fresh(tmp_path)
    assert main(["new", "method", "my-method", f"out={tmp_path / 'my-method'}"]) == 0
    given = ("train", "method=my-method", *SHORT, "out=run")
    found.gsfw(given, GSFW_PLUGIN_PATH="./my-method")
    assert (tmp_path / "run" / "metrics.json").is_file()
