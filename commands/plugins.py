"""The verb ``plugins``: what can be chosen for each slot, who brings it, and what is broken."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from gsfw.commands.interface.arguments import Options, read
from gsfw.commands.interface.console import Console
from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import SLOTS, Registry, did_you_mean, installed
from gsfw.plugins.specs import Spec


@dataclass(kw_only=True)
class PluginsOptions(Options):
    """List what is installed, slot by slot, and which plugins are broken and skipped."""

    examples: ClassVar[tuple[str, ...]] = ("gsfw plugins", "gsfw plugins slot=strategy")

    slot: str = ""
    """Only this slot: method, rasterizer, strategy, ... Empty: all."""


def run(tokens: list[str]) -> int:
    """List what is installed."""
    options = read("plugins", PluginsOptions, tokens)
    if options.slot and options.slot not in SLOTS:
        raise ConfigError(
            f"slot={options.slot}: there is no such slot.{did_you_mean(options.slot, SLOTS)}",
            f"Slots: {', '.join(SLOTS)}.",
        )
    console, registry = Console(options.json), installed()
    slots = [options.slot] if options.slot else list(SLOTS)
    found = {slot: list(registry.slot(slot).values()) for slot in slots}
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
        "broken": [
            {"name": item.name, "distribution": item.distribution, "reason": item.reason}
            for item in registry.broken
        ],
    }
