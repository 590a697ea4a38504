"""Licences: docs/reference/licences.md, from the metadata of the packages that are installed.

``python website/licences.py`` writes it, in an environment with all extras.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "licences.md"
PROJECT = "gsfw"
EXTRAS = ("cloud", "flip", "heic", "ray", "spz", "usd", "video", "viewer")
"""Extras for users; gsplat is left out, which needs a GPU's compiler to be installed."""
UNKNOWN = "not stated"
COPYLEFT = re.compile(r"(?<![A-Za-z])A?GPL|GNU (Affero )?General Public")
EXCEPTION = re.compile(r"exception", re.I)
LONGEST = 80
"""Characters of a licence's name; what is longer is its text."""

INTRODUCTION = """# Licences

gsfw is licensed under Apache-2.0. These are the packages that it needs, and what their metadata
say of their licences. `python website/licences.py` writes this page. None is under the GPL (a test
reads the metadata of what is installed). `.ci/sbom FILE.json` writes an SBOM (CycloneDX) of an
environment, with versions.

Wheels bundle native libraries under licences of their own: NumPy, SciPy and torch the runtime of
GCC (GPL with its exception for linked programs), PyAV the libraries of FFmpeg, pi-heif libheif and
libde265 (LGPL). Read the licence files in the wheels before you ship them to others. GPUs need
libraries of NVIDIA, which have NVIDIA's licence and come with torch.
"""


def needed(extras: Sequence[str] = ()) -> dict[str, Distribution]:
    """Installed packages that gsfw needs, and those that these need, by name.

    Args:
        extras: of gsfw.
    """
    found: dict[str, Distribution] = {}
    _gather(PROJECT, extras, found, set())
    found.pop(PROJECT, None)
    return dict(sorted(found.items()))


def licence(package: Distribution) -> str:
    """Name of a package's licence, as its metadata state it."""
    metadata: Mapping[str, str] = package.metadata  # type: ignore[assignment]
    classifiers = package.metadata.get_all("Classifier") or []
    names = [line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License ::")]
    stated = metadata.get("License-Expression") or ""
    short = (metadata.get("License") or "").strip().partition("\n")[0]
    written = short if 0 < len(short) <= LONGEST and short.upper() != "UNKNOWN" else ""
    return (
        stated or ", ".join(name for name in names if name != "OSI Approved") or written or UNKNOWN
    )


def is_copyleft(name: str) -> bool:
    """True for the GPL and the AGPL, without an exception for programs that are linked."""
    alternatives = re.split(r"\s+OR\s+", name)
    return all(COPYLEFT.search(part) and not EXCEPTION.search(part) for part in alternatives)


def page() -> str:
    """The page in Markdown."""
    core = needed()
    lines = [INTRODUCTION, *_table("gsfw", core)]
    for extra in EXTRAS:
        more = {name: found for name, found in needed((extra,)).items() if name not in core}
        lines += ["", *_table(f"gsfw[{extra}]", more)]
    return "\n".join(lines) + "\n"


def _table(title: str, packages: Mapping[str, Distribution]) -> Iterator[str]:
    yield f"## {title}\n"
    yield "| package | licence |"
    yield "|---|---|"
    for name, package in packages.items():
        if not name.startswith(("nvidia-", "cuda-")):
            yield f"| {name} | {licence(package)} |"


def _gather(
    name: str, extras: Sequence[str], found: dict[str, Distribution], seen: set[tuple[str, str]]
) -> None:
    """Add a package and what it needs, if it is installed."""
    try:
        package = distribution(name)
    except PackageNotFoundError:
        return
    found.setdefault(canonicalize_name(name), package)
    for line in package.requires or []:
        requirement = Requirement(line)
        for extra in ("", *extras):
            marker, key = requirement.marker, (requirement.name, ",".join(requirement.extras))
            if key not in seen and (marker is None or marker.evaluate({"extra": extra})):
                seen.add(key)
                _gather(requirement.name, tuple(requirement.extras), found, seen)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"{PAGE}\n")
