"""Provenance: settings, the command that reproduces a run, its machine and its warnings."""

from __future__ import annotations

from collections.abc import Mapping

from gsfw.reports.figures import definition_list
from gsfw.reports.markup import NOTHING, Markup, bullet_list, element, folded, section, table
from gsfw.reports.plain_text import setting_text
from gsfw.reports.run_record import RunRecord

COMMAND = "command line"
"""Key of the command in the header of config.yaml."""

GROUPS = ("method", "strategy", "rasterizer", "datamanager", "sampler")
"""The choices, which are always shown."""


def settings_section(record: RunRecord) -> Markup:
    """The user's settings, those of a plan, all others; folded, with the command for them."""
    chosen = {
        key: value for key, value in record.settings.items() if key in record.given or key in GROUPS
    }
    planned = {
        key: value
        for key, value in record.settings.items()
        if key in record.planned and key not in chosen
    }
    others = {
        key: value
        for key, value in record.settings.items()
        if key not in chosen and key not in planned
    }
    content = []
    command = record.header.get(COMMAND)
    if command:
        content += [element("h3", "The command"), element("pre", str(command))]
    again = f"gsfw train config={record.folder.config.name} out=again"
    content.append(
        element(
            "p",
            ["The same run again, from the run's folder: ", element("code", again), "."],
        )
    )
    if chosen:
        content.append(folded(f"{len(chosen)} chosen settings", _settings(chosen)))
    if planned:
        title = f"{len(planned)} settings planned for the given time"
        content.append(folded(title, _settings(planned)))
    if others:
        content.append(folded(f"{len(others)} settings that follow from them", _settings(others)))
    return section("settings", "Settings, and how to reproduce", content)


def _settings(values: Mapping[str, object]) -> Markup:
    rows = [
        [element("code", key), element("code", setting_text(value))]
        for key, value in values.items()
    ]
    return table(["setting", "value"], rows, "text")


def environment_section(record: RunRecord) -> Markup:
    """Versions, device and threads."""
    versions = {key: value for key, value in record.header.items() if key not in (COMMAND, "given")}
    rows = {**versions, **record.environment}
    if "device" not in rows and record.settings.get("device"):
        rows["device"] = record.settings["device"]
    if not rows:
        return NOTHING
    readable = {str(key).replace("_", " "): value for key, value in rows.items()}
    return section("environment", "Environment", definition_list(readable))


def messages_section(record: RunRecord) -> Markup:
    """Warnings of the log, and the notes that the run began with."""
    content = []
    if record.messages.warnings:
        content.append(bullet_list(record.messages.warnings))
    if record.messages.notes:
        listed = bullet_list(record.messages.notes)
        plural = "s" if len(record.messages.notes) > 1 else ""
        content.append(folded(f"{len(record.messages.notes)} note{plural} at the start", listed))
    if not content:
        return NOTHING
    title = "Warnings and notes" if record.messages.warnings else "Notes"
    return section("messages", title, content)
