"""The folder list is the architecture: who may import whom, how long things may be."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

SPECS = "gsfw.plugins.specs"
"""Records and hook markers, which every folder of implementations needs to register itself."""

MAY_IMPORT = {
    "core": {"gsfw.core"},
    "plugins": {"gsfw.core", "gsfw.plugins"},
    "kernels": {"gsfw.core", "gsfw.kernels", SPECS},
    "rasterizers": {"gsfw.core", "gsfw.kernels", "gsfw.rasterizers", SPECS},
    "datamanagers": {"gsfw.core", "gsfw.datamanagers", SPECS},
    "jobs": {"gsfw.core", "gsfw.jobs"},
    "methods": {"gsfw.core", "gsfw.methods", SPECS},
    "strategies": {"gsfw.core", "gsfw.strategies", SPECS},
    "samplers": {"gsfw.core", "gsfw.samplers", SPECS},
    "callbacks": {"gsfw.core", "gsfw.callbacks", "gsfw.charts", SPECS},
    "charts": {"gsfw.core", "gsfw.charts"},
    "partition": {
        *("gsfw.core", "gsfw.datamanagers", "gsfw.formats", "gsfw.jobs", "gsfw.partition"),
        *("gsfw.planning", "gsfw.plugins"),
    },
    "editing": {"gsfw.core", "gsfw.editing"},
    "formats": {"gsfw.core", "gsfw.formats", SPECS},
    "parallel": {"gsfw.core", "gsfw.parallel"},
    "lod": {"gsfw.core", "gsfw.formats", "gsfw.lod", SPECS},
    "planning": {"gsfw.core", "gsfw.planning", "gsfw.plugins"},
    "preparation": {
        *("gsfw.core", "gsfw.datamanagers", "gsfw.jobs", "gsfw.preparation"),
        "gsfw.kernels.cpu.native_module",  # What is said where COLMAP aborts the process.
    },
    "rendering": {"gsfw.core", "gsfw.plugins", "gsfw.rendering"},
    "reports": {"gsfw.charts", "gsfw.core", "gsfw.plugins", "gsfw.rendering", "gsfw.reports"},
    "viewer": {"gsfw.core", "gsfw.formats", "gsfw.plugins", "gsfw.rendering", "gsfw.viewer"},
    "studies": {
        *("gsfw.charts", "gsfw.core", "gsfw.formats", "gsfw.jobs", "gsfw.kernels"),
        *("gsfw.methods", "gsfw.planning", "gsfw.plugins", "gsfw.rasterizers", "gsfw.studies"),
    },
    "commands": {"gsfw"},
    "api": {"gsfw"},
    "compat": {"gsfw.api", "gsfw.compat"},
    "testing": {"gsfw"},
    "scaffold": {"gsfw.core", "gsfw.plugins", "gsfw.scaffold", "gsfw.api", "gsfw.testing"},
}

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 50

FILES = sorted(path for folder in MAY_IMPORT for path in (ROOT / folder).rglob("*.py"))


@dataclass(frozen=True)
class Source:
    """Contents of a file that rules are about."""

    imports: frozenset[str]
    """Every gsfw module it imports, anywhere in it; relative imports begin with a dot."""
    too_long: tuple[str, ...]
    """Sentences about the file and its functions that are longer than they may be."""


@cache
def source(path: Path) -> Source:
    """Read a file; its syntax tree, which is large, is not kept."""
    text = path.read_text()
    imports, lines = set[str](), len(text.splitlines())
    too_long = [f"{lines} lines, at most {MAX_FILE_LINES}"] if lines > MAX_FILE_LINES else []
    for node in statements(ast.parse(text).body):
        if isinstance(node, ast.Import):
            imports.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            imports.update(f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or 0) - node.lineno + 1
            if length > MAX_FUNCTION_LINES:
                too_long.append(f"{node.name} has {length} lines, at most {MAX_FUNCTION_LINES}")
    own = {name for name in imports if name.split(".")[0] in {"", "gsfw"}}
    return Source(frozenset(own), tuple(too_long))


def statements(body: Sequence[ast.AST]) -> Iterator[ast.AST]:
    """All statements of a block and of the blocks within it; expressions are left out."""
    for node in body:
        yield node
        for block in ("body", "handlers", "orelse", "finalbody", "cases"):
            yield from statements(getattr(node, block, ()))


def test_every_top_level_package_has_its_rule():
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert packages == set(MAY_IMPORT)


def test_files_import_only_what_their_folders_may():
    offenders = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in FILES
        for name in sorted(source(path).imports)
        if not may_import(path.relative_to(ROOT).parts[0], name)
    ]
    assert not offenders, f"see MAY_IMPORT for what each folder may import: {offenders}"


def test_the_architecture_page_lists_the_folders_and_their_rules():
    page = (ROOT / "docs" / "explain" / "architecture.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)/` \|.*\| ([^|]*) \|$", page, re.MULTILINE))
    assert rows.keys() == MAY_IMPORT.keys()
    for folder, rule in rows.items():
        if rule != "everything":
            allowed = {name.split(".")[1] for name in MAY_IMPORT[folder] - {SPECS}} - {folder}
            assert set(re.findall(r"\w+", rule)) & MAY_IMPORT.keys() == allowed, folder


def may_import(folder: str, name: str) -> bool:
    allowed = MAY_IMPORT[folder]
    return any(name == prefix or name.startswith(f"{prefix}.") for prefix in allowed)


def test_files_and_functions_fit_their_limits():
    offenders = [
        f"{path.relative_to(ROOT)}: {what}" for path in FILES for what in source(path).too_long
    ]
    assert not offenders, "one concept, one file"


def test_rules_hold_for_statements_in_every_block(tmp_path):
    blocks = "try: import gsfw.a\nexcept E: import gsfw.b\nelse: import gsfw.c\n"
    blocks += "finally: import gsfw.d\nmatch x:\n    case 1: from gsfw import e\n"
    file = tmp_path / "a.py"
    file.write_text(blocks + "class A:\n    def long():\n" + 50 * "        pass\n")
    found = source(file)
    assert found.imports == {f"gsfw.{name}" for name in "abcde"}
    assert found.too_long == ("long has 51 lines, at most 50",)


def modules_after(*steps: str) -> list[set[str]]:
    """Names of all modules loaded once a fresh interpreter has run the statements of each step."""
    code = "import sys\n" + "".join(f"{step}\nprint(*sys.modules)\n" for step in steps)
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return [set(line.split()) for line in result.stdout.splitlines()[-len(steps) :]]


@pytest.mark.slow
def test_core_imports_no_implementation_a_run_no_scipy_and_charts_no_matplotlib():
    charts = (
        *("charts.census", "charts.dots", "charts.fronts", "charts.heat_map", "charts.time_plot"),
        *("commands.main", "commands.interface.training"),
        *("callbacks.results", "callbacks.tensorboard"),
        *("studies.report", "studies.stress.heat_map", "studies.tradeoff.pareto_plot"),
        *("studies.tradeoff.training.plot", "preparation.check.contact_sheet"),
    )
    # One process for all: it takes two seconds to import torch.
    core, run, drawn = modules_after(
        "import gsfw.core.loop.trainer",
        "import gsfw.datamanagers.image_cache, gsfw.api.models",
        f"import {', '.join(f'gsfw.{name}' for name in charts)}",
    )
    assert {name.split(".")[1] for name in core if name.startswith("gsfw.")} == {"core"}
    assert not run & {"scipy.linalg", "scipy.sparse", "scipy.spatial"}
    assert not [name for name in drawn if name.startswith("matplotlib")]


def test_listing_what_is_installed_imports_no_torch():
    (loaded,) = modules_after(
        "from gsfw.plugins.registry import SLOTS, installed\n"
        "for slot in SLOTS: installed().slot(slot)"
    )
    assert "torch" not in loaded
    assert "numpy" not in loaded


def test_training_says_its_first_line_before_torch_is_imported():
    (loaded,) = modules_after(
        "from gsfw.commands import main\n"
        "from gsfw.commands.interface import console\n"
        "def stop(self, text): raise KeyboardInterrupt\n"
        "console.Console.say = stop\n"
        "assert main.main(['train', 'method=3dgs']) == 130"
    )
    assert "torch" not in loaded
    assert "rich" not in loaded


def test_every_registered_name_can_be_loaded():
    from gsfw.plugins.registry import SLOTS, installed

    for slot in SLOTS:
        for spec in installed().slot(slot).values():
            assert callable(spec.load()), f"{slot} {spec.name}"
