"""Links of README, CONTRIBUTING and docs/ lead somewhere, and every page is on the site."""

import re
import shutil
from pathlib import Path

from navigation import GROUPS, add_tables_of_contents
from support.links import anchors, is_external, links

from gsfw.core.loop.run_folder import RunFolder

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"

DOCUMENTS = [
    *sorted(ROOT.glob("*.md")),
    *sorted(DOCS.rglob("*.md")),
    *sorted((ROOT / "benchmarks").rglob("*.md")),
]

GENERATED = ("verbs.md", "settings/", "api/")
"""Generated pages below docs/reference; tests/docs/test_reference.py follows links to them."""


def leads_nowhere(document: Path, link: str) -> bool:
    """Whether a link to a file or a heading of this repository has no such thing."""
    name, _, anchor = link.partition("#")
    path = (document.parent / name).resolve() if name else document
    if path.is_relative_to(DOCS / "reference"):
        generated = path.relative_to(DOCS / "reference").as_posix().startswith(GENERATED)
        if generated and document.is_relative_to(DOCS):
            return False
    return not path.exists() or bool(anchor and anchor not in anchors(path.read_text("utf-8")))


def test_every_link_within_the_documents_leads_somewhere():
    broken = [
        f"{document.relative_to(ROOT)}: {link}"
        for document in DOCUMENTS
        for link in links(document.read_text(encoding="utf-8"))
        if not is_external(link) and leads_nowhere(document, link)
    ]
    assert not broken


def test_checkpoints_in_the_documents_are_named_as_runs_name_them():
    named = [
        (document.name, Path(name).name)
        for document in DOCUMENTS
        for name in re.findall(r"checkpoints/step_\d+\.pt", document.read_text(encoding="utf-8"))
    ]
    assert named
    for document, name in named:
        step = int(name.removeprefix("step_").removesuffix(".pt"))
        assert name == RunFolder(Path("run")).checkpoint(step).name, document


def test_pages_of_the_site_link_to_nothing_outside_of_docs():
    outside = [
        f"{document.relative_to(ROOT)}: {link}"
        for document in DOCS.rglob("*.md")
        for link in links(document.read_text(encoding="utf-8"))
        if not is_external(link)
        and not (document.parent / link.partition("#")[0]).resolve().is_relative_to(DOCS)
    ]
    assert not outside


def test_the_readme_leads_to_the_front_page_and_to_every_section():
    targets = {link.partition("#")[0] for link in links((ROOT / "README.md").read_text("utf-8"))}
    assert "docs/index.md" in targets
    folders = {Path(target).parts[1] for target in targets if target.startswith("docs/")}
    assert {"start", "guides", "explain", "plugins", "results"} <= folders


def test_every_page_is_in_the_navigation_of_the_site_once(tmp_path):
    pages = tmp_path / "docs"
    shutil.copytree(DOCS, pages, ignore=shutil.ignore_patterns("images"))
    add_tables_of_contents(pages)
    entries = []
    for page in pages.rglob("*.md"):
        for table in re.findall(r"^```{toctree}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S):
            names = [line for line in table.splitlines() if line and not line.startswith(":")]
            entries += [(page.parent / f"{name}.md").relative_to(pages) for name in names]
    found = {page.relative_to(pages) for page in pages.rglob("*.md")} - {Path("index.md")}
    assert sorted(entries) == sorted(found)


def test_new_pages_of_every_folder_have_a_group():
    folders = {page.relative_to(DOCS).parts[0] for page in DOCS.glob("*/**/*.md")}
    assert {f"{folder}/*" for folder in folders} <= {e for each in GROUPS.values() for e in each}


def test_every_page_of_the_navigation_exists():
    named = {entry for entries in GROUPS.values() for entry in entries if "*" not in entry}
    generated = {"reference/verbs", "reference/settings", "reference/api"}
    pages = {page.relative_to(DOCS).with_suffix("").as_posix() for page in DOCS.rglob("*.md")}
    assert named - generated <= pages | {"plugins/slots"}


def test_the_front_page_and_the_readme_have_the_groups_of_the_navigation():
    for page in (DOCS / "index.md", ROOT / "README.md"):
        found = re.findall(r"^\* \*\*(.+?)\*\*: \[", page.read_text("utf-8"), re.M)
        assert found == list(GROUPS), page.name
