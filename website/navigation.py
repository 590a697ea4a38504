"""Navigation: the groups of pages and their order, as tables of contents that Sphinx reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

GROUPS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "Start": (
            *("start/first-ten-minutes", "start/installation", "start/capture", "start/*"),
            "troubleshooting",
        ),
        "Train": (
            *("guides/data", "guides/prepare", "guides/settings", "guides/minutes"),
            *("guides/terminal", "guides/run-outputs", "guides/moving-scenes", "guides/cuda"),
            *("guides/dense-start", "guides/sky", "guides/growth", "guides/requirements"),
            "guides/studies",
            *("guides/remote-data", "guides/large-scenes", "guides/many-machines"),
            *("guides/production", "guides/benchmarks", "guides/*"),
        ),
        "Use the result": (
            *("guides/viewer", "guides/render", "guides/report", "guides/formats", "guides/web"),
            *("guides/edit", "guides/mesh", "guides/level-of-detail", "guides/model-file"),
        ),
        "Write code": (
            *("guides/python", "guides/existing-code", "plugins/index", "plugins/first-plugin"),
            *("plugins/slots", "plugins/recipes", "plugins/conformance"),
            *("plugins/versions-and-shipping", "plugins/*"),
        ),
        "Measurements": (
            *("results/expected-results", "results/performance", "guides/gpu"),
            *("results/what-accuracy-costs", "results/compression", "results/planned-runs"),
            *("results/cameras-from-photos", "results/moving-scenes-measured"),
            *("results/moving-scenes-settings", "results/stress", "results/reliability"),
            "results/*",
        ),
        "Explanations": (
            *("explain/how-splatting-works", "explain/one-step", "explain/architecture"),
            *("explain/numerics", "results/checking", "results/findings"),
            *("explain/threat-model", "explain/*"),
        ),
        "Other frameworks": ("from/nerfstudio", "from/gsplat", "from/inria", "from/*"),
        "Reference": (
            *("reference/verbs", "reference/settings", "reference/api", "reference/glossary"),
            *("reference/licences", "reference/*"),
        ),
    }
)
"""Pages of each group in order, relative to docs/. ``folder/*`` stands for its other pages."""

_NAMED = frozenset(entry for entries in GROUPS.values() for entry in entries)


def add_tables_of_contents(folder: Path) -> None:
    """Append the tables of contents of all groups to a folder's index page.

    The pages of a folder within a folder are below its own ``index.md``.
    """
    for title, entries in GROUPS.items():
        pages = [page for entry in entries for page in _pages(folder, entry)]
        _append_table(folder / "index.md", pages, title)


def _pages(root: Path, entry: str) -> Iterator[str]:
    """Names of the pages of an entry, relative to ``root``."""
    if entry.endswith("/*"):
        others = {path.relative_to(root).with_suffix("").as_posix() for path in root.glob(entry)}
        for other in sorted(others - _NAMED):
            yield from _pages(root, other)
    elif (root / f"{entry}.md").is_file():
        yield entry
    elif (index := root / entry / "index.md").is_file():
        below = sorted(page.stem for page in index.parent.glob("*.md") if page != index)
        _append_table(index, below)
        yield f"{entry}/index"


def _append_table(page: Path, entries: Sequence[str], title: str = "") -> None:
    if entries:
        caption = [f":caption: {title}"] if title else []
        table = ["", "```{toctree}", ":hidden:", *caption, "", *entries, "```", ""]
        page.write_text(page.read_text(encoding="utf-8") + "\n".join(table), encoding="utf-8")
