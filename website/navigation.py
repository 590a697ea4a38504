"""Navigation: the order of sections and pages, as tables of contents that Sphinx reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

SECTIONS: Mapping[str, tuple[str, Sequence[str]]] = MappingProxyType(
    {
        "start": ("Start", ("first-ten-minutes", "installation", "capture")),
        "guides": (
            "Guides",
            (
                *(
                    "data",
                    "remote-data",
                    "prepare",
                    "settings",
                    "minutes",
                    "run-outputs",
                    "production",
                ),
                *("viewer", "render", "report", "terminal", "moving-scenes", "dense-start"),
                *("growth", "requirements", "formats", "level-of-detail", "web", "edit", "mesh"),
                *("model-file", "python", "existing-code", "studies", "many-machines"),
                *("large-scenes", "very-large-scenes", "benchmarks", "cuda", "gpu"),
            ),
        ),
        "explain": (
            "Explanations",
            ("how-splatting-works", "numerics", "one-step", "architecture", "threat-model"),
        ),
        "plugins": (
            "Plugins",
            ("index", "first-plugin", "slots", "recipes", "conformance", "versions-and-shipping"),
        ),
        "from": ("Coming from", ("nerfstudio", "gsplat", "inria")),
        "results": (
            "Results",
            (
                *("expected-results", "performance", "what-accuracy-costs", "compression"),
                *("moving-scenes-measured", "moving-scenes-settings", "planned-runs"),
                *("cameras-from-photos", "checking"),
                *("stress", "reliability", "findings"),
            ),
        ),
        "reference": ("Reference", ("verbs", "settings", "api", "glossary", "licences")),
        "": ("Help", ("troubleshooting",)),
    }
)
"""Title of each folder, and its pages in order; other pages follow by name."""


def add_tables_of_contents(folder: Path) -> None:
    """Append the tables of contents of all sections to a folder's index page.

    The pages of a folder within a section are below its own ``index.md``, where it has one.
    """
    blocks = [
        _table(title, list(_entries(folder, section, order)))
        for section, (title, order) in SECTIONS.items()
    ]
    _append(folder / "index.md", "".join(blocks))


def _entries(root: Path, section: str, order: Sequence[str]) -> Iterator[str]:
    """Names of the pages and folders of a section, in order, relative to ``root``."""
    found = [path for path in (root / section).glob("*") if _is_entry(path, root, section)]
    places = {name: place for place, name in enumerate(order)}
    for path in sorted(found, key=lambda item: (places.get(item.stem, len(places)), item.stem)):
        if path.is_file():
            yield path.relative_to(root).with_suffix("").as_posix()
        elif (path / "index.md").is_file():
            pages = sorted(page.stem for page in path.glob("*.md") if page.stem != "index")
            _append(path / "index.md", _table("", pages))
            yield (path / "index").relative_to(root).as_posix()
        else:
            pages = sorted(path.glob("*.md"))
            yield from (page.relative_to(root).with_suffix("").as_posix() for page in pages)


def _is_entry(path: Path, root: Path, section: str) -> bool:
    """True for a page, and for a folder with pages, that belongs to the section itself."""
    if not section:  # The pages beside the folders of the other sections.
        return path.suffix == ".md" and path != root / "index.md"
    return path.suffix == ".md" or (path.is_dir() and any(path.glob("*.md")))


def _table(title: str, pages: Sequence[str]) -> str:
    caption = [f":caption: {title}"] if title else []
    if not pages:
        return ""
    return "\n".join(["", "```{toctree}", ":hidden:", *caption, "", *pages, "```", ""])


def _append(page: Path, text: str) -> None:
    page.write_text(page.read_text(encoding="utf-8") + text, encoding="utf-8")
