"""The folder list is the architecture: who may import whom, how long things may be."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

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
        *("gsfw.charts", "gsfw.core", "gsfw.datamanagers", "gsfw.formats", "gsfw.partition"),
        *("gsfw.jobs", "gsfw.planning", "gsfw.plugins"),
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
    "rendering": {"gsfw.core", "gsfw.plugins", "gsfw.rasterizers", "gsfw.rendering"},
    "reports": {
        *("gsfw.charts", "gsfw.core", "gsfw.formats", "gsfw.plugins", "gsfw.rendering"),
        "gsfw.reports",
    },
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


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All of a file's syntax tree."""
    return tuple(ast.walk(ast.parse(path.read_text())))


def imported_modules(path: Path) -> set[str]:
    """Every gsfw module a file imports, anywhere in it; relative imports begin with a dot."""
    found: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            found.update(f"{module}.{alias.name}" for alias in node.names)
    return {name for name in found if name.split(".")[0] in {"", "gsfw"}}


def test_every_top_level_package_has_its_rule():
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert packages == set(MAY_IMPORT)


def test_files_import_only_what_their_folders_may():
    offenders = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in FILES
        for name in sorted(imported_modules(path))
        if not may_import(path.relative_to(ROOT).parts[0], name)
    ]
    assert not offenders, f"see MAY_IMPORT for what each folder may import: {offenders}"


def may_import(folder: str, name: str) -> bool:
    allowed = MAY_IMPORT[folder]
    return any(name == prefix or name.startswith(f"{prefix}.") for prefix in allowed)


def test_files_and_functions_fit_their_limits():
    offenders = [
        f"{path.relative_to(ROOT)}: {what}" for path in FILES for what in beyond_limits(path)
    ]
    assert not offenders, "one concept, one file"


def beyond_limits(path: Path) -> list[str]:
    """Everything in a file that is longer than it may be."""
    lines = len(path.read_text().splitlines())
    found = [f"{lines} lines, at most {MAX_FILE_LINES}"] if lines > MAX_FILE_LINES else []
    for node in nodes(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or 0) - node.lineno + 1
            if length > MAX_FUNCTION_LINES:
                found.append(f"{node.name} has {length} lines, at most {MAX_FUNCTION_LINES}")
    return found


def modules_after(statement: str) -> set[str]:
    """Names of all modules loaded once a fresh interpreter has run ``statement``."""
    code = f"import sys\n{statement}\nprint(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return set(result.stdout.splitlines()[-1].split())


def test_importing_core_brings_in_no_implementation():
    loaded = modules_after("import gsfw.core.loop.trainer")
    folders = {name.split(".")[1] for name in loaded if name.startswith("gsfw.")}
    assert folders == {"core"}


def test_listing_what_is_installed_imports_no_torch():
    loaded = modules_after(
        "from gsfw.plugins.registry import SLOTS, installed\n"
        "for slot in SLOTS: installed().slot(slot)"
    )
    assert "torch" not in loaded
    assert "numpy" not in loaded


def test_opening_a_run_imports_no_part_of_scipy():
    loaded = modules_after(
        "import gsfw.core.loop.trainer, gsfw.datamanagers.image_cache, gsfw.api.models"
    )
    assert not loaded & {"scipy.linalg", "scipy.sparse", "scipy.spatial"}


def test_training_says_its_first_line_before_torch_is_imported():
    loaded = modules_after(
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
