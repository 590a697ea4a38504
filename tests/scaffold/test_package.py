"""Tests of gsfw.scaffold.package: what the written packages consist of."""

import ast
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import torch
from support.scenes import front_camera

from gsfw.core.batch import Batch
from gsfw.core.context import ViewContext
from gsfw.core.errors import ConfigError
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.plugins.registry import SLOTS
from gsfw.scaffold.kinds import BASES, KINDS
from gsfw.scaffold.names import MOST_LETTERS, PartName
from gsfw.scaffold.package import TEMPLATES, package_files, write_package

PLACEHOLDERS = re.compile(
    r"my[-_]part|MyPart|A_PART|SUMMARY|USE_IT|EDIT_|KIND|TAGS|TARGET|gsfw_parts|BaseConfig|BaseMethod|BASE"
)
"""Words of the templates."""
LONGEST = "a" + "-name-of-the-most-letters-there"[: MOST_LETTERS - 1]

EACH = [(slot, "") for slot in KINDS] + [("method", like) for like in BASES]
"""Every kind of package that can be written: slot, and base of a method."""

IMPORTABLE = "gsfw.api", "gsfw.testing"
"""Modules of gsfw for plugins."""


def imported(text: str) -> set[str]:
    """Modules that a file imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {item.name for item in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
    return found


def test_every_kind_of_part_but_operators_can_be_begun():
    assert set(KINDS) == set(SLOTS) - {"operators"}


@pytest.mark.parametrize(("slot", "like"), EACH)
def test_no_placeholder_is_left(slot, like):
    for path, text in package_files(slot, PartName("some-thing"), like).items():
        assert not PLACEHOLDERS.search(path + text), path


@pytest.mark.parametrize(("slot", "like"), EACH)
def test_plugins_import_the_public_interface_alone(slot, like):
    files = package_files(slot, PartName("some-thing"), like)
    found = set().union(*(imported(text) for path, text in files.items() if path.endswith(".py")))
    assert {name for name in found if name.split(".")[0] == "gsfw"} <= set(IMPORTABLE)
    registration = imported(files["some_thing/__init__.py"])
    assert registration == {"__future__", "gsfw.api"}


@pytest.mark.parametrize("like", [like for like in BASES if like != "moving"])
def test_what_is_transparent_has_no_brightness(like, monkeypatch):
    written = ModuleType("written_method")
    monkeypatch.setitem(sys.modules, written.__name__, written)
    exec(
        package_files("method", PartName("some-thing"), like)["some_thing/method.py"], vars(written)
    )
    nothing = torch.zeros(1, 4, 4, 1)
    batch = Batch(torch.ones(1, 4, 4, 3), front_camera().resized(4, 4), (0,), alpha=nothing)
    statistics = RenderStatistics.zeros(torch.zeros(1, 3), 1, frozenset())
    rendered = RenderOutput(torch.ones(1, 4, 4, 3), nothing, statistics, extra=nothing)
    context = ViewContext(batch, rendered, batch.images, extent=1.0)
    assert written._error(context).max() == 0


def test_linters_have_nothing_to_say(tmp_path):
    for slot, like in EACH:
        for name in (PartName(f"my-{like or slot}"), PartName(LONGEST)):
            folder = tmp_path / f"{name.dashed}-{slot}-{like}"
            write_package(folder, package_files(slot, name, like))
    for command in (["check"], ["format", "--check"]):
        ruff = [sys.executable, "-m", "ruff", *command, "--no-cache", "--quiet", str(tmp_path)]
        result = subprocess.run(ruff, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.slow
def test_types_are_right(tmp_path):
    # One configuration for all: that of the packages.
    options = [
        "--follow-imports=silent",
        "--strict",
        "--allow-subclassing-any",
        "--allow-untyped-calls",
    ]
    for slot, like in EACH:
        name = PartName(f"my-{like or slot}")
        write_package(tmp_path / name.dashed, package_files(slot, name, like))
        text = (tmp_path / name.dashed / "pyproject.toml").read_text()
        assert "strict = true" in text
        options.append(str(tmp_path / name.dashed / name.module))
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-m", "mypy", "--no-incremental", *options]
    environment = {"MYPYPATH": str(root / ".typing"), "PATH": ""}
    result = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_name_that_would_hide_a_class_is_refused():
    with pytest.raises(ConfigError, match="'sampler' would hide Sampler"):
        package_files("sampler", PartName("sampler"))
    with pytest.raises(ConfigError, match="'static' would hide StaticGaussians"):
        package_files("method", PartName("static"), "3dgs")


def test_an_existing_folder_is_not_touched(tmp_path):
    with pytest.raises(ConfigError, match="exists already"):
        write_package(tmp_path, {"README.md": "mine"})
    assert list(tmp_path.iterdir()) == []


def test_every_template_is_used():
    used = {f"parts/{slot}.py" for slot in KINDS} | {f"tests/{slot}.py" for slot in KINDS}
    for base in BASES.values():
        used |= {f"parts/{base.template}.py", f"tests/{base.tests}.py"}
    there = {str(path.relative_to(TEMPLATES).as_posix()) for path in TEMPLATES.rglob("*.py")}
    assert there == used | {"common/registration.py"}


@pytest.mark.parametrize("like", BASES)
def test_a_method_like_another_is_registered_with_its_tag(like):
    registration = package_files("method", PartName("some-thing"), like)["some_thing/__init__.py"]
    assert f'tags=frozenset({{"{"static" if like == "3dgs" else "dynamic"}"}})' in registration


def test_a_method_without_a_base_has_no_tag():
    assert "tags" not in package_files("method", PartName("some-thing"))["some_thing/__init__.py"]
