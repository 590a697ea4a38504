"""The Python blocks of a page, each as the module of a plugin."""

import re
import sys
from pathlib import Path
from types import ModuleType

from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.discovery import HOOKS, Discovery, PluginSource
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Layer, resolve
from gsfw.plugins.specs import Spec

PLUGINS = Path(__file__).resolve().parents[2] / "docs" / "plugins"

SCENE = {
    "datamanager.views": "4", "datamanager.eval_views": "1", "datamanager.width": "32",
    "datamanager.height": "24", "datamanager.points": "120", "datamanager.times": "4",
}  # fmt: skip
"""A small built-in scene, still or moving."""

RUN = {"device": "cpu", "eval_every": "0", "steps": "6", "report": "false", "log_every": "1"}
"""A run of a moment."""


def blocks(page: Path) -> dict[str, str]:
    """The first Python block below each heading of the second level, by heading."""
    text = page.read_text("utf-8")
    parts = re.split(r"^## +(.+?) *$", text, flags=re.M)[1:]
    found = {
        title: re.search(r"^```python\n(.+?)^```", body, re.M | re.S)
        for title, body in zip(parts[::2], parts[1::2], strict=True)
    }
    return {title: block[1] for title, block in found.items() if block}


def module_of(code: str) -> ModuleType:
    """A module of the code; it stays imported, as settings are loaded by its name."""
    module = ModuleType(f"page_plugin_{abs(hash(code))}")
    sys.modules[module.__name__] = module
    exec(compile(code, module.__name__, "exec"), vars(module))
    return module


def registry_with(*modules: ModuleType) -> Registry:
    """The built-in parts, and those of the modules."""
    discovery = Discovery()
    discovery.load_builtin()
    for module in modules:
        discovery.add(module, PluginSource("page", "page", "1.0"))
    return Registry(discovery)


def specs_of(module: ModuleType) -> dict[str, Spec]:
    """What the module registers, by hook."""
    discovery = Discovery()
    discovery.add(module, PluginSource("page", "page", "1.0"))
    found = {hook: spec for hook in HOOKS for spec in _specs(discovery, hook)}
    assert not discovery.broken
    return found


def _specs(discovery: Discovery, hook: str) -> list[Spec]:
    # A range of versions is a hook too, and no list.
    return list(discovery.specs(hook)) if hook.endswith("s") else []


def composed(registry: Registry, wrap: type | None = None, **settings: str) -> Composition:
    """A run of a moment, on the built-in scene, or on what ``wrap`` makes of it."""
    values = {"method": "3dgs", **RUN, **({} if "datamanager" in settings else SCENE), **settings}
    chosen = resolve(registry, [Layer("the test", values)])
    data = None if wrap is None else wrap(open_data(chosen))
    run = compose(chosen, registry, data=data)
    assert not registry.broken
    return run
