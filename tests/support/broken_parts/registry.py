"""Broken parts by kind and promise, and the plugin that registers them."""

from gsfw.plugins.registry import SLOTS
from gsfw.plugins.specs import Spec, hookimpl

BROKEN: dict[tuple[str, str], type] = {}
"""Each broken part by its kind and the promise that it breaks."""


OTHERS: dict[str, type] = {}
"""Methods by name whose fault is seen by whichever promise is checked first."""


def breaks(slot: str, promise: str):
    def note(kind):
        BROKEN[slot, promise] = kind
        return kind

    return note


class Plugin:
    """Registers all broken parts, by the promises that they break."""


def _hook(slot: str):
    def specs(self):
        named = {f"breaks-{promise}": kind for (of, promise), kind in BROKEN.items() if of == slot}
        named |= OTHERS if slot == "method" else {}
        return [
            Spec(name, "Faulty", f"{kind.__module__}:{kind.__qualname__}")
            for name, kind in named.items()
        ]

    return hookimpl(specs)


for _slot, _name in SLOTS.items():
    setattr(Plugin, _name, _hook(_slot))
