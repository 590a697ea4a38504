"""The generated pages of docs/reference: verbs, settings, and the public interface."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gsfw.plugins.discovery import Discovery
from gsfw.plugins.registry import Registry


def write_reference(folder: Path) -> None:
    """Write all generated pages below a folder."""
    for name, text in reference_pages():
        path = folder / f"{name}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def built_in() -> Registry:
    """The parts that gsfw itself brings, whatever else is installed."""
    discovery = Discovery()
    discovery.load_builtin()
    return Registry(discovery)


def reference_pages() -> Iterator[tuple[str, str]]:
    """Names within docs/reference, without the suffix, and texts of all generated pages."""
    from reference.interface import interface_pages
    from reference.settings import settings_pages
    from reference.verbs import verbs_page

    registry = built_in()
    yield "verbs", verbs_page(registry)
    for name, text in settings_pages(registry):
        yield f"settings/{name}", text
    for name, text in interface_pages():
        yield f"api/{name}", text
