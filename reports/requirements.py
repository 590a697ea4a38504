"""Requirements: what the scene took of the model, from requirements.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsfw.core.words import capitalized
from gsfw.reports.markup import NOTHING, Markup, bullet_list, element, folded, join, section, table
from gsfw.reports.run_record import RunRecord, listed, number

LISTS = (
    ("could_go", "Parts that could be left out"),
    ("left_out", "Parts left out"),
    ("not_measured", "Not measured"),
)
"""Keys of lists of sentences, and their headings."""


def requirements_section(record: RunRecord) -> Markup:
    """Floats and PSNR gain of each part of the model; nothing if they were not measured."""
    found = record.requirements
    if not found:
        return NOTHING
    content = [_groups(found), _motion(found)]
    for key, heading in LISTS:
        items = found.get(key)
        if isinstance(items, list) and items:
            content += [element("h3", heading), bullet_list(map(str, items))]
    content.append(_least_useful(found))
    measured = found.get("measured")
    if isinstance(measured, Mapping) and measured.get("how"):
        how = f"{measured['how']} A dash: not measured."
        content.append(folded("How this was measured", element("p", how)))
    headline = str(found.get("headline", ""))
    lead = capitalized(headline) + ("." if headline else "")
    return section("requirements", "Requirements of the scene", content, lead)


def _groups(found: Mapping[str, Any]) -> Markup:
    """Parameters by purpose: their number, their share, and what they gain."""
    rows = []
    for group in listed(found, "groups"):
        floats, share = number(group.get("floats")), number(group.get("share"))
        gain = number(group.get("bought_db"))
        bar = NOTHING
        if share is not None:
            filled = element("i", NOTHING, {"style": f"width:{100 * min(max(share, 0), 1):.1f}%"})
            bar = element("span", filled, {"class": "bar"})
        rows.append(
            [
                str(group.get("name", "")),
                "-" if floats is None else f"{floats:,.0f}",
                join(["-" if share is None else f"{100 * share:.1f} %", bar]),
                "-" if gain is None else f"{gain:+.2f} dB",
            ]
        )
    return table(["part of the model", "numbers", "share", "PSNR gain"], rows) if rows else NOTHING


def _motion(found: Mapping[str, Any]) -> Markup:
    """The gain of motion, of a moving scene."""
    motion = found.get("motion")
    gain = number(motion.get("bought_db")) if isinstance(motion, Mapping) else None
    if gain is None:
        return NOTHING
    text = f"Drawn as it is at one time, without motion, it has {gain:.2f} dB less PSNR."
    return element("p", text)


def _least_useful(found: Mapping[str, Any]) -> Markup:
    """The loss without the Gaussians that contribute least."""
    rows = []
    for item in listed(found, "least_useful"):
        part, loss = number(item.get("part")), number(item.get("bought_db"))
        if part is not None and loss is not None:
            rows.append([f"{100 * part:g} %", f"{loss:+.2f} dB"])
    if not rows:
        return NOTHING
    losses = table(["least useful Gaussians", "PSNR gain"], rows)
    return folded("The least useful Gaussians", losses)
