"""The verb ``plugins``: the names of each slot, and the skipped plugins."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from gsfw.commands.interface.arguments import Options, read
from gsfw.commands.interface.console import Console
from gsfw.core.errors import ConfigError
from gsfw.plugins.loading import load_third_parties
from gsfw.plugins.registry import SLOTS, Registry, did_you_mean, installed
from gsfw.plugins.specs import Spec


@dataclass(kw_only=True)
class PluginsOptions(Options):
    """List the installed parts, slot by slot, and the broken plugins, which are skipped.

    ``gsfw plugins check NAME`` checks a part, or all parts of a plugin.
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
    options = read("plugins", PluginsOptions, tokens)
    if options.slot and options.slot not in SLOTS:
        raise ConfigError(
            f"slot={options.slot}: there is no such slot.{did_you_mean(options.slot, SLOTS)}",
            f"Slots: {', '.join(SLOTS)}.",
        )
    console, registry = Console(options.json), installed()
    load_third_parties(registry)
    slots = [options.slot] if options.slot else list(SLOTS)
    left_out = {(item.kind, item.name, item.distribution) for item in registry.broken}
    found = {
        slot: [
            spec
            for spec in registry.slot(slot).values()
            if (slot, spec.name, spec.distribution) not in left_out
        ]
        for slot in slots
    }
    console.table(
        ["slot", "name", "from", "description"],
        [[slot, *_cells(spec)] for slot, specs in found.items() for spec in specs],
    )
    for broken in registry.broken:
        console.say(str(broken))
    console.result(_document(found, registry))
    return 0


def _cells(spec: Spec) -> tuple[str, str, str]:
    paper = f" ({spec.paper})" if spec.paper else ""
    return spec.name, f"{spec.distribution} {spec.version}", f"{spec.description}{paper}"


def _document(found: dict[str, list[Spec]], registry: Registry) -> dict[str, Any]:
    return {
        "plugins": [
            {
                "slot": slot,
                "name": spec.name,
                "distribution": spec.distribution,
                "version": spec.version,
                "description": spec.description,
                "paper": spec.paper,
                "tags": sorted(spec.tags),
            }
            for slot, specs in found.items()
            for spec in specs
        ],
        "broken": [asdict(item) for item in registry.broken],
    }
