"""Columns: what the figures of results are called, and how they are written."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A figure of a table."""

    name: str
    """Among a result's figures."""
    heading: str
    digits: int | None = None
    """After the point; ``None`` for three significant ones."""
    best: str = ""
    """high or low: which is the most accurate. Empty: it is a cost, or says nothing of that."""
    unit: str = ""

    def text(self, value: float) -> str:
        """A value as it is shown."""
        if self.digits is None:
            return f"{value:.3g}"
        return f"{value:,.{self.digits}f}"

    def better(self, value: float, than: float) -> bool:
        """Whether one value is more accurate than another."""
        return value < than if self.best == "low" else value > than


KNOWN = {
    column.name: column
    for column in (
        Column("psnr", "PSNR", 2, "high", "dB"),
        Column("moving_psnr", "moving PSNR", 2, "high", "dB"),
        Column("ssim", "SSIM", 4, "high"),
        Column("moving_ssim", "moving SSIM", 4, "high"),
        Column("lpips", "LPIPS", 4, "low"),
        Column("flip", "FLIP", 4, "low"),
        Column("flicker_static", "static flicker", 5, "low"),
        Column("flicker_moving", "moving flicker", 5, "low"),
        Column("num_gaussians", "Gaussians", 0),
        Column("total_floats", "floats", 0),
        Column("sh_floats", "colour floats", 0),
        Column("sh_share", "of all bands", 2),
        Column("steps", "steps", 0),
        Column("skipped_steps", "skipped steps", 0),
        Column("train_seconds", "training", 0, unit="s"),
        Column("wall_seconds", "wall clock", 0, unit="s"),
        Column("render_ms", "render", 1, unit="ms"),
        Column("megabytes", "model", 2, unit="MB"),
        Column("checkpoint_megabytes", "checkpoint", 1, unit="MB"),
        Column("splats_megabytes", "splats.ply", 1, unit="MB"),
    )
}


def find_column(name: str) -> Column:
    """The column of a figure; one with the figure's own name where nothing is known of it."""
    return KNOWN.get(name) or Column(name, name.replace("_", " "))
