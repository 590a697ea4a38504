"""``python website [FOLDER]``: builds the site of docs/ and of the references into FOLDER (site/).

Warnings are errors, and so is whatever a page would load from elsewhere. The site is static files:
any web server can serve them, and a browser can open ``index.html`` from the disk.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from navigation import add_tables_of_contents
from offline import external_links, foreign_loads
from reference import write_reference

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "build" / "website"
"""The pages of docs/ with the generated ones beside them: the source of the site."""


def assemble(folder: Path) -> None:
    """Copy docs/ to a folder, and write the references and the navigation there."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs", folder)
    write_reference(folder / "reference")
    add_tables_of_contents(folder)


def build(pages: Path, site: Path) -> int:
    """Build the site, and look at what it loads; return 0, or the exit code of a failure."""
    from sphinx.cmd.build import build_main

    shutil.rmtree(site, ignore_errors=True)
    strict = ["--fail-on-warning", "--keep-going", "--nitpicky", "--quiet"]
    settings = ["-c", str(ROOT / "website"), "-d", str(pages.with_name("website-cache"))]
    code = build_main([*strict, *settings, "-b", "html", str(pages), str(site)])
    if code:
        return int(code)
    (site / ".buildinfo").unlink(missing_ok=True)
    for address in (loads := list(foreign_loads(site))):
        sys.stderr.write(f"{address}\n")
    for address in external_links(site):
        sys.stdout.write(f"links to {address}, which is not followed\n")
    return 1 if loads else 0


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "site"
    assemble(PAGES)
    sys.exit(build(PAGES, target))
