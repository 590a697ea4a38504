"""The verb ``plugins``: the parts of each slot with their packages, and the skipped plugins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from gsfw.commands.interface.arguments import Options, read_options
from gsfw.commands.interface.console import Console
from gsfw.core.errors import ConfigError
from gsfw.plugins.loading import load_third_parties
from gsfw.plugins.registry import SLOTS, Registry, did_you_mean, installed, package
from gsfw.plugins.skipped import HOOK, PLUGIN
from gsfw.plugins.specs import PROJECT, Spec
from gsfw.plugins.versions import API_VERSION


@dataclass(kw_only=True)
class PluginsOptions(Options):
    """List the installed parts, slot by slot, and the plugins that do not load, which are skipped.

    The list says only that parts load. ``gsfw plugins check NAME`` checks what a part does, or all
    parts of a plugin.

    GSFW_PLUGIN_PATH=PLACE:PLACE adds plugins that are not installed: a file, the folder of a
    package, or a source tree with pyproject.toml. GSFW_PLUGINS=NAME,NAME loads only these of the
    installed ones, GSFW_DISABLE_PLUGINS=1 none at all.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw plugins",
        "gsfw plugins slot=strategy",
        "gsfw plugins check NAME",
    )

    slot: str = ""
    """Only this slot: method, rasterizer, strategy, ... Empty: all."""


def run(tokens: list[str]) -> int:
    """List the installed parts, or check some: ``gsfw plugins check NAME``."""
    if tokens[:1] == ["check"]:
        from gsfw.commands.plugin_check import run as check

        return check(tokens[1:])
    options = read_options("plugins", PluginsOptions, tokens)
    if options.slot and options.slot not in SLOTS:
        raise ConfigError(
            f"slot={options.slot}: there is no such slot.{did_you_mean(options.slot, SLOTS)}",
            f"Slots: {', '.join(SLOTS)}.",
        )
    console, registry = Console(options.json), installed()
    load_third_parties(registry)
    parts = _parts(registry, [options.slot] if options.slot else list(SLOTS))
    console.table(
        ["slot", "name", "from", "API", "state", "description"],
        [[*_cells(part)] for part in parts],
    )
    for broken in registry.broken:
        console.say(str(broken))
    console.result(
        {
            "api_version": API_VERSION,
            "plugins": [_document(part) for part in parts if not part.skipped],
            "broken": [asdict(item) for item in registry.broken],
        }
    )
    return 0


@dataclass(frozen=True)
class Part:
    """A registered part, or a plugin or a hook that is skipped as a whole."""

    slot: str
    spec: Spec
    skipped: bool


def _parts(registry: Registry, slots: Sequence[str]) -> list[Part]:
    """The parts of the slots, then the skipped plugins."""
    skipped = {(item.kind, item.name, item.distribution): item for item in registry.broken}
    found = []
    for slot in slots:
        for spec in registry.slot(slot).values():
            is_skipped = skipped.pop((slot, spec.name, spec.distribution), None) is not None
            found.append(Part(slot, spec, is_skipped))
    left = [item for item in skipped.values() if item.kind in (*slots, PLUGIN, HOOK)]
    for item in left:  # Without a registered part: a taken name, a plugin, a hook.
        spec = Spec(item.name, "", "", distribution=item.distribution, version=item.version)
        found.append(Part(item.kind, spec, True))
    return found


def _cells(part: Part) -> tuple[str, ...]:
    spec = part.spec
    paper = f" ({spec.paper})" if spec.paper else ""
    return (
        *(part.slot, spec.name, package(spec), _asked_range(part)),
        "skipped" if part.skipped else "ok",
        f"{spec.description}{paper}",
    )


def _asked_range(part: Part) -> str:
    """The range of API versions that a package asks for; gsfw's own parts need none."""
    if part.spec.distribution == PROJECT or not part.spec.target:
        return ""
    return part.spec.requires_api or "not stated"


def _document(part: Part) -> dict[str, Any]:
    spec = part.spec
    return {
        "slot": part.slot,
        "name": spec.name,
        "distribution": spec.distribution,
        "version": spec.version,
        "requires_api": spec.requires_api,
        "description": spec.description,
        "paper": spec.paper,
        "tags": sorted(spec.tags),
    }
