"""Package: the files that ``gsfw new`` writes.

Templates are the files of a package for a part "my-part", which is also spelt my_part and MyPart;
words in capitals, such as SUMMARY, stand for texts of its kind.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from gsfw.core.errors import ConfigError
from gsfw.core.files.atomic import readable_write_errors
from gsfw.plugins.registry import SLOTS
from gsfw.scaffold.kinds import BASES, KINDS, Base, Kind
from gsfw.scaffold.names import PartName

TEMPLATES = Path(__file__).parent / "templates"

COMMON = {
    "pyproject.toml": "project.toml",
    "README.md": "README.txt",
    "CHANGELOG.md": "CHANGELOG.txt",
    ".gitignore": "gitignore.txt",
    ".github/workflows/tests.yml": "workflow.yml",
}
"""Files of every package, and their templates, which tools must not take for our own."""


def package_files(slot: str, name: PartName, like: str = "") -> dict[str, str]:
    """The texts of all files of a package, by relative path.

    Args:
        slot: kind of the part.
        name: its name.
        like: method that a new method derives from, one of ``BASES``; empty for none.

    Raises:
        ConfigError: classes of the part would have the name of a class that they use.
    """
    base = BASES.get(like)
    kind = KINDS[slot] if base is None else base.kind
    template, tests = (slot, slot) if base is None else (base.template, base.tests)
    words = _words(slot, name, kind, like, base)
    sources = {path: f"common/{source}" for path, source in COMMON.items()} | {
        f"{name.module}/__init__.py": "common/registration.py",
        f"{name.module}/{kind.module}.py": f"parts/{template}.py",
        f"tests/test_{name.module}.py": f"tests/{tests}.py",
    }
    files = {path: _filled(source, name, words) for path, source in sources.items()}
    if base is not None:
        module = f"{name.module}/{kind.module}.py"
        files[module] = _with_sorted_names(files[module])
    return files


def write_package(folder: Path, files: Mapping[str, str]) -> None:
    """Write the files into a new folder.

    Raises:
        ConfigError: the folder exists.
        OutputError: it cannot be written.
    """
    if folder.exists():
        raise ConfigError(
            f"gsfw new: {folder} exists already.", "Remove it, or choose another place: out=DIR."
        )
    for relative, text in files.items():
        path = folder / relative
        with readable_write_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text.encode())


def kind_with_name(kind: Kind, name: PartName) -> Kind:
    """The same kind with the spellings of a name in its texts."""
    spelt = _spellings(name)
    return replace(kind, command=_replaced(kind.command, spelt), hint=_replaced(kind.hint, spelt))


def _spellings(name: PartName) -> dict[str, str]:
    return {"my-part": name.dashed, "my_part": name.module, "MyPart": name.camel}


def _words(slot: str, name: PartName, kind: Kind, like: str, base: Base | None) -> dict[str, str]:
    """The text of each word of the templates."""
    named = kind_with_name(kind, name)
    of_base = {} if base is None else {"BaseConfig": base.config, "BaseMethod": base.method}
    tags = "" if base is None else f'            tags=frozenset({{"{base.tag}"}}),\n'
    return {
        **_spellings(name),
        **of_base,
        "A_PART": f"{'An' if kind.title[0] in 'aeio' else 'A'} {kind.title}",
        "BASE": like,
        "EDIT_HINT": named.hint,
        "EDIT_THIS": kind.module,
        "KIND": kind.title,
        "SUMMARY": kind.summary.replace("BASE", like),
        "TARGET": _replaced(kind.target, _spellings(name)),
        "USE_IT": named.command,
        "gsfw_parts": SLOTS[slot],
        "            # TAGS\n": tags,
    }


def _filled(source: str, name: PartName, words: Mapping[str, str]) -> str:
    """A template with its words replaced.

    Raises:
        ConfigError: it uses a class whose name a class of the part would have.
    """
    text = (TEMPLATES / source).read_text(encoding="utf-8")
    own = {word.replace("MyPart", name.camel) for word in re.findall(r"\bMyPart\w*", text)}
    others = {words.get(word, word) for word in re.findall(r"\b(?!MyPart)\w+", text)}
    for hidden in sorted(own & others):
        raise ConfigError(
            f"gsfw new: {name.dashed!r} would hide {hidden}, a class that its code uses.",
            f"Choose another name: my-{name.dashed}.",
        )
    return _replaced(text, words)


def _replaced(text: str, words: Mapping[str, str]) -> str:
    pattern = "|".join(map(re.escape, words))
    return re.sub(pattern, lambda found: words[found[0]], text)


def _with_sorted_names(text: str) -> str:
    """The names of the long import in order, as linters ask for."""
    before, start, rest = text.partition("from gsfw.api import (\n")
    names, end, after = rest.partition(")\n")
    lines = sorted(names.splitlines(), key=lambda line: (line.strip()[0].islower(), line))
    return f"{before}{start}" + "".join(f"{line}\n" for line in lines) + end + after
