"""The names and signatures of gsfw.api as text, read from the sources without importing them.

Run ``python tests/support/public_surface.py`` to write them to ``tests/api/surface.txt``.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SURFACE = ROOT / "tests" / "api" / "surface.txt"

SPECIAL = ("__init__", "__call__", "__len__", "__and__", "__or__", "__iter__", "__getitem__")
"""Methods with underscores that are part of an interface."""
KINDS = ("property", "cached_property", "classmethod", "staticmethod", "abstractmethod", "final")
"""Decorators that are part of an interface; ``dataclass`` is, too."""

HEADER = """\
# All names and signatures of gsfw.api, group by group; defaults of fields are left out.
# A change of this file is a change of the public interface:
#   1. Raise API_VERSION in plugins/versions.py: its second number where something was added, its
#      first where something was removed, renamed or changed, so that a plugin may have to change.
#   2. A renamed name stays for a while, in DEPRECATED of api/deprecation.py.
#   3. Write this file anew: python tests/support/public_surface.py
"""


@dataclass(frozen=True)
class Place:
    """A top-level definition: its file, and its node there."""

    path: Path
    node: ast.stmt


@cache
def tree(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def file_of(module: str) -> Path:
    """The file of a module of gsfw."""
    path = ROOT.joinpath(*module.split(".")[1:])
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@cache
def imports(path: Path) -> dict[str, tuple[str, str]]:
    """Module and name of everything that a file imports from gsfw, anywhere in it."""
    return {
        alias.asname or alias.name: (str(node.module), alias.name)
        for node in ast.walk(tree(path))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gsfw")
        for alias in node.names
    }


@cache
def find(path: Path, name: str) -> Place | None:
    """The definition of a name that a file defines or imports from gsfw; ``None`` for others."""
    if name in imports(path):
        module, original = imports(path)[name]
        return find(file_of(module), original)
    for statement in tree(path).body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            names = [statement.name]
        elif isinstance(statement, ast.Assign):
            names = [target.id for target in statement.targets if isinstance(target, ast.Name)]
        else:
            names = []
        if name in names:
            return Place(path, statement)
    return None


def groups() -> dict[str, tuple[str, ...]]:
    """The public names of each module of the folder api."""
    found = {}
    for path in sorted((ROOT / "api").glob("*.py")):
        for node in tree(path).body:
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                found[path.stem] = tuple(ast.literal_eval(node.value))
    return found


@cache
def public_names() -> frozenset[str]:
    """All public names."""
    return frozenset(name for names in groups().values() for name in names)


def definition(group: str, name: str) -> Place:
    """The definition of a public name."""
    found = find(ROOT / "api" / f"{group}.py", name)
    assert found is not None, f"gsfw.api.{group}: {name} is defined nowhere"
    return found


def described() -> str:
    """The whole interface."""
    version = ast.unparse(definition("registration", "API_VERSION").node)
    parts = [HEADER, f"{version}\n"]
    for group, names in groups().items():
        parts.append(f"\n## {group}\n")
        for name in names:
            parts += [f"\n{line}\n" if first else f"{line}\n" for first, line in lines(group, name)]
    return "".join(parts)


def lines(group: str, name: str) -> Iterator[tuple[bool, str]]:
    """The lines of a public name; the first one is marked."""
    place = definition(group, name)
    node = place.node
    if isinstance(node, ast.FunctionDef):
        yield True, signature(node)
    elif not isinstance(node, ast.ClassDef):
        yield True, ast.unparse(node)
    else:
        bases = f"({', '.join(map(ast.unparse, node.bases))})" if node.bases else ""
        dataclasses = [f"@{text} " for text in decorators(node) if text.startswith("dataclass")]
        yield True, f"{''.join(dataclasses)}class {name}{bases}"
        for text in members(place):
            yield False, f"    {text}"


def members(place: Place) -> Iterator[str]:
    """Members of a class, and of those of its base classes that are not public themselves."""
    node = place.node
    assert isinstance(node, ast.ClassDef)
    is_enum = "Enum" in map(ast.unparse, node.bases)
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and not ast.unparse(item.target).startswith("_"):
            default = "" if item.value is None else " = ..."
            yield f"{ast.unparse(item.target)}: {ast.unparse(item.annotation)}{default}"
        elif isinstance(item, ast.Assign) and is_enum:
            yield ast.unparse(item)
        elif isinstance(item, ast.FunctionDef) and is_public(item):
            yield signature(item)
    for base in map(ast.unparse, node.bases):
        found = None if base in public_names() else find(place.path, base)
        if found is not None and isinstance(found.node, ast.ClassDef):
            yield from members(found)


def is_public(node: ast.FunctionDef) -> bool:
    """True for methods that plugins call or implement."""
    abstract = "abstractmethod" in decorators(node)
    return abstract or node.name in SPECIAL or not node.name.startswith("_")


def decorators(node: ast.FunctionDef | ast.ClassDef) -> list[str]:
    """The decorators of a function or class, as written."""
    return [ast.unparse(item) for item in node.decorator_list]


def signature(node: ast.FunctionDef) -> str:
    """A function's line: kinds, name, parameters, result."""
    kinds = "".join(f"@{text} " for text in decorators(node) if text in KINDS)
    result = "" if node.returns is None else f" -> {ast.unparse(node.returns)}"
    return f"{kinds}def {node.name}({ast.unparse(node.args)}){result}"


def named_types(group: str, name: str) -> frozenset[str]:
    """Classes of gsfw that the signatures and fields of a public name mention."""
    place = definition(group, name)
    if not isinstance(place.node, ast.ClassDef | ast.FunctionDef):
        return frozenset()
    found = set()
    for text in (text for _, text in lines(group, name)):
        for word in ast.walk(ast.parse(_annotations(text))):
            if isinstance(word, ast.Name):
                known = find(place.path, word.id)
                if known is not None and isinstance(known.node, ast.ClassDef):
                    found.add(word.id)
    return frozenset(found)


def _annotations(text: str) -> str:
    """The types of a line, as an expression."""
    text = text.strip()
    while text.startswith("@"):
        text = text.partition(" ")[2]
    if text.startswith("class "):
        return "()"
    if not text.startswith("def "):
        return f"({text.partition(': ')[2].removesuffix(' = ...') or None},)"
    (function,) = ast.parse(f"{text}: ...").body
    assert isinstance(function, ast.FunctionDef)
    arguments = [*function.args.args, *function.args.kwonlyargs]
    given = [item.annotation for item in arguments] + [function.returns]
    return f"({', '.join(ast.unparse(item) for item in given if item is not None)},)"


if __name__ == "__main__":
    SURFACE.write_text(described(), encoding="utf-8")
