"""Figures of a run, as HTML for the page."""

from __future__ import annotations

import html
import math

from gsfw.core.words import clock
from gsfw.viewer.live_run import LiveRun

TABLE = (
    '<div style="padding:4px 10px 4px 8px;font-size:13px;line-height:1.6">{note}'
    '<table style="width:100%;border-collapse:collapse">{rows}</table></div>'
)
ROW = (
    '<tr><td style="opacity:.65">{name}</td>'
    '<td style="text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums">'
    "{text}</td></tr>"
)


def figures_html(rows: list[tuple[str, str]], note: str = "") -> str:
    """A table of names and figures, below a line; both must be safe as HTML."""
    line = f'<div style="font-weight:600;padding-bottom:2px">{note}</div>' if note else ""
    return TABLE.format(
        note=line, rows="".join(ROW.format(name=name, text=text) for name, text in rows)
    )


def status_html(live: LiveRun) -> str:
    """The figures of a run that trains."""
    status, info = live.status, live.info
    rows = [("step", f"{live.step:,} of {info.steps:,}")]
    if math.isfinite(status.loss):
        rows += [("loss", f"{status.loss:.4f}"), ("PSNR, training views", f"{status.psnr:.2f} dB")]
    if status.held_out_psnr is not None:
        rows.append(("PSNR, held out", f"{status.held_out_psnr:.2f} dB"))
    if status.gaussians:
        rows.append(("Gaussians", f"{status.gaussians:,}"))
        rows.append(("speed", f"{status.steps_per_second:.1f} steps/s"))
    left = live.seconds_left
    if left is not None:
        rows.append(("time left", clock(left)))
    if status.memory_mb:
        rows.append(("memory", f"{status.memory_mb / 1e3:.1f} GB"))
    rows.append(("time for frames", f"{100 * live.share:.0f} %"))
    if live.checkpointed is not None:
        rows.append(("last checkpoint", f"step {live.checkpointed:,}"))
    return figures_html(rows, f"{html.escape(info.method)}: {live.state}")
