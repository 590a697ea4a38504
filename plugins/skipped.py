"""Skipped: what of a plugin is left out, the cause, and the remedy."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import metadata

from gsfw.plugins.plugin_path import FROM, removal
from gsfw.plugins.specs import PROJECT
from gsfw.plugins.versions import RangeError

PLUGIN, HOOK = "plugin", "hook"
"""Kinds of what is skipped: a plugin, or one of its hooks; the other kinds are slots."""


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin of a third party that is skipped, completely or in part."""

    name: str
    distribution: str
    version: str
    reason: str
    """A phrase without a period."""
    advice: str
    """The remedy, a sentence."""
    kind: str = PLUGIN
    """Kind of the failed object: plugin, hook, or the slot of the part."""

    def __str__(self) -> str:
        return f"{self.skipped}. {self.advice}"

    @property
    def skipped(self) -> str:
        """The skipped part and the cause, as a phrase without a period."""
        return f"{self.kind} {self.name!r} ({self.package}) is skipped: {self.reason}"

    @property
    def package(self) -> str:
        """Package and version: "gsfw-dots 0.3"."""
        return f"{self.distribution} {self.version}".strip()

    def comes_from(self, package: str) -> bool:
        """True if a package such as "gsfw-dots 0.3", of any version, is that of this plugin."""
        return package == self.distribution or package.startswith(f"{self.distribution} ")


def other_version(distribution: str) -> str:
    """The remedy for a package and a gsfw that do not fit together."""
    this, remove = f"This is {PROJECT} {metadata.version(PROJECT)}", removal(distribution)
    if distribution.startswith(FROM):
        return f"{this}: change the plugin, or {remove}."
    return f"{this}: install the version of {distribution} that was made for it, or {remove}."


def other_range(distribution: str, error: RangeError) -> str:
    """The remedy for a package that asks for other versions of gsfw.api."""
    if error.needs_newer:
        return f"Install a newer {PROJECT} (pip install --upgrade {PROJECT}), or an older plugin."
    if distribution.startswith(FROM):
        return f"Adapt the plugin and the range, or {removal(distribution)}."
    return f"Install a newer version of it: pip install --upgrade {distribution}"


def import_advice(distribution: str, error: BaseException) -> str:
    """The remedy for a package whose module cannot be imported."""
    if not isinstance(error, ImportError):
        return other_version(distribution)
    if (error.name or "").partition(".")[0] == PROJECT:
        return f"{other_version(distribution)} Only gsfw.api stays the same between versions."
    return f"Install what it needs, or {removal(distribution)}."
