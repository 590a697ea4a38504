"""Docstrings name things: none begins with a clause in place of a noun."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

FOLDERS = sorted(path.parent.name for path in ROOT.glob("*/__init__.py"))

CLAUSES = frozenset({"Of", "Where", "Whether", "What", "Why", "Who", "Which", "When", "How"})
"""First words of clauses that stand for nouns, as in "Where bars begin"."""


BEGUN = re.compile(rf"[\"']\s*({'|'.join(CLAUSES)})\b")
"""Beginnings of strings that tell the few files which have to be parsed."""


def texts(path: Path) -> list[tuple[int, str]]:
    """Strings of a file that stand alone, by line; none where no string begins with a clause."""
    content = path.read_text()
    return [
        (node.lineno, node.value.value)
        for node in (ast.walk(ast.parse(content)) if BEGUN.search(content) else ())
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ]


def test_no_docstring_begins_with_a_clause():
    found = [
        f"{path.relative_to(ROOT)}:{line}: {text.splitlines()[0]}"
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line, text in texts(path)
        if text.split()[:1] and text.split()[0] in CLAUSES
    ]
    assert found == []


@pytest.mark.parametrize(
    "docstring", ['"""Where\n"""', "'''What it is'''", '"How."', 'r"""\n Of"""']
)
def test_a_docstring_that_begins_with_a_clause_is_found(tmp_path, docstring):
    (tmp_path / "a.py").write_text(f"x = 1\n{docstring}\n")
    assert [line for line, _ in texts(tmp_path / "a.py")] == [2]
