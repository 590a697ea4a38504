"""Links of README, CONTRIBUTING and docs/ lead somewhere."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ +(.*?) *$", re.MULTILINE)


def anchors(document: Path) -> set[str]:
    """What links within a document may name: its headings, as GitHub spells them."""
    headings = HEADING.findall(document.read_text(encoding="utf-8"))
    words = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in words}


def leads_nowhere(document: Path, link: str) -> bool:
    """Whether a link to a file or a heading of this repository has no such thing."""
    if "://" in link or link.startswith("mailto:"):
        return False
    name, _, anchor = link.partition("#")
    path = document.parent / name if name else document
    return not path.exists() or bool(anchor and anchor not in anchors(path))


def test_every_link_within_the_documents_leads_somewhere():
    broken = [
        f"{document.relative_to(ROOT)}: {link}"
        for document in DOCUMENTS
        for link in LINK.findall(document.read_text(encoding="utf-8"))
        if leads_nowhere(document, link)
    ]
    assert not broken


def test_every_document_can_be_reached_from_the_readme():
    found, pending = set(), [ROOT / "README.md"]
    while pending:
        document = pending.pop()
        found.add(document)
        for link in LINK.findall(document.read_text(encoding="utf-8")):
            path = (document.parent / link.partition("#")[0]).resolve()
            if path.suffix == ".md" and path.is_file() and path not in found:
                pending.append(path)
    assert set((ROOT / "docs").rglob("*.md")) <= found
