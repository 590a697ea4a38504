"""Docstrings name things: none begins with a clause in place of a noun."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

FOLDERS = sorted(path.parent.name for path in ROOT.glob("*/__init__.py"))

CLAUSES = frozenset({"Of", "Where", "Whether", "What", "Why", "Who", "Which", "When", "How"})
"""First words of clauses that stand for nouns, as in "Where bars begin"."""


def texts(path: Path) -> list[tuple[int, str]]:
    """All strings of a file that stand alone, which document what is above them, by line."""
    return [
        (node.lineno, node.value.value)
        for node in ast.walk(ast.parse(path.read_text()))
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
