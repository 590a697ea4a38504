"""The pages of the public interface: every name of ``gsfw.api``, from signatures and docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import is_dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from gsfw import api
from reference.markdown import code, docstring, prose, table
from reference.members import attributes, constant, methods, own_bases
from reference.signatures import signature


def interface_pages() -> Iterator[tuple[str, str]]:
    """Names and texts of all pages: one of each group of names, and their index."""
    groups = {group: import_module(f"{api.__name__}.{group}") for group in api.GROUPS}
    yield "index", _index(groups)
    for group, module in groups.items():
        yield group, _group(group, module)


def _index(groups: dict[str, ModuleType]) -> str:
    lines = [
        "# Python interface",
        "",
        "`from gsfw.api import NAME` works for every name here; other modules of gsfw may change",
        f"in any release. This is version {api.API_VERSION} of the interface.",
    ]
    for group, module in groups.items():
        names = [f"[`{name}`]({group}.md#{name.lower()})" for name in module.__all__]
        lines += ["", f"## [{_title(group)}]({group}.md)", "", docstring(module.__doc__ or "")]
        lines += ["", " · ".join(names)]
    return "\n".join([*lines, ""])


def _title(group: str) -> str:
    return f"gsfw.api.{group}"


def _group(group: str, module: ModuleType) -> str:
    parts = [f"# {_title(group)}", docstring(module.__doc__ or "")]
    for name in module.__all__:
        parts += [f"## {name}", *_described(name, getattr(module, name), module)]
    return "\n\n".join([*parts, ""])


def _described(name: str, found: Any, module: ModuleType) -> Iterator[str]:  # noqa: ANN401 - any public name
    if inspect.isclass(found):
        yield from _class(name, found)
    elif inspect.isfunction(found):
        yield from _function(name, found)
    else:
        assignment, meaning = constant(name, module)
        yield _python(assignment)
        yield prose(meaning)


def _class(name: str, found: type[Any]) -> Iterator[str]:
    """Header, docstring, attributes and methods of a class."""
    bases = ", ".join(base.__name__ for base in found.__bases__ if base is not object)
    lines = [f"class {name}({bases})" if bases else f"class {name}"]
    if not is_dataclass(found) and any("__init__" in vars(base) for base in own_bases(found)):
        lines.append(signature(name, found.__init__).removesuffix(" -> None"))
    yield _python("\n".join(lines))
    if found.__doc__ and not found.__doc__.startswith(f"{found.__name__}("):
        yield docstring(found.__doc__)
    rows = [
        [code(item.name), code(item.kind), code(item.default), prose(item.meaning)]
        for item in attributes(found)
    ]
    if rows:
        yield table(["attribute", "type", "default", "meaning"], rows)
    for method in methods(found):
        yield f"### {name}.{method.name}"
        yield from _function(method.name, method.function, method.decorators)


def _function(name: str, found: Any, decorators: tuple[str, ...] = ()) -> Iterator[str]:  # noqa: ANN401 - a function
    marks = "".join(f"@{decorator}\n" for decorator in decorators)
    yield _python(f"{marks}def {signature(name, found)}")
    if text := inspect.getdoc(found):
        yield docstring(text)


def _python(text: str) -> str:
    return f"```python\n{text}\n```"
