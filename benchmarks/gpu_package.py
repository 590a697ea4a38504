"""Package: makes gsfw importable from its source folders, without building or installing it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import tomllib

ROOT = Path(__file__).resolve().parents[1]


def make_package(parent: Path) -> Path:
    """A folder for ``PYTHONPATH``, with links to the source folders where they belong.

    It has what a build would generate (pyproject.toml says what), and metadata with the version;
    the native CPU module, which would have to be compiled, is missing.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    name, version = project["project"]["name"], project["project"]["version"]
    build = project["tool"]["scikit-build"]
    folder = parent / "package"
    shutil.rmtree(folder, ignore_errors=True)
    for place, source in build["wheel"]["packages"].items():
        link = folder / place
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(ROOT / source, target_is_directory=True)
    for generated in build["generate"]:
        path = generated.get("template-path")
        template = (ROOT / path).read_text(encoding="utf-8") if path else generated["template"]
        text = template.replace("${version}", version)
        (folder / generated["path"]).write_text(text, encoding="utf-8")
    metadata = folder / f"{name}-{version}.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    return folder


def install_wheels(wheels: list[Path], folder: Path) -> str:
    """Unpack wheels into a folder for ``PYTHONPATH``; why that failed, empty when it did not."""
    if folder.is_dir() or not wheels:
        return ""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    command += ["--no-compile", "--no-cache-dir", "--target", str(folder), *map(str, wheels)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode == 0:
        return ""
    shutil.rmtree(folder, ignore_errors=True)
    return ended.stderr.strip().partition("\n")[0]
