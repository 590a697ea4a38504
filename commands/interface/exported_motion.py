"""Exported motion: what a file of splats at all times holds, and what of the model it lacks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.run_source import RunSource

RECOLORED = 0.05
"""Change of colours over time, of 1, above which a note warns."""


def about_motion(
    restored: Restored, source: RunSource, compare: bool = True
) -> tuple[str, dict[str, Any], list[str]]:
    """Describe the motion that an exporter has taken from a run: in words, as data, as warnings.

    Args:
        restored: the run.
        source: the same run, after the exporter has taken its motion.
        compare: true to render a few views of a moving model, which measure how near the closed
            form is to it.
    """
    from gsfw.formats.visible_splats import without_invisible
    from gsfw.plugins.motion_quality import motion_psnr

    if not source.fits:
        content = source.splat_file()
        count = len(without_invisible(content)[0].splats)
        document = {"num_gaussians": count, "num_dropped": content.num_dropped}
        return f"{count:,} static splats", document, list(content.notes())
    (fit,) = source.fits.values()
    near, pieces = None, len(fit.file.content.splats)
    if compare:
        near = motion_psnr(restored, fit.file)
    quality = "" if near is None else f", {near:.1f} dB from the model"
    in_pieces = "" if pieces == fit.num_rows else f" in {pieces:,} pieces"
    notes = [f"{fit.num_dropped} splats were left out: they are not finite."]
    notes *= bool(fit.num_dropped)
    if fit.recolored > RECOLORED:
        notes.append(
            f"colours of splats change by up to {fit.recolored:.2f} over time (of 1; 99 % of them "
            "change less): the file has the colour in the middle of each one's presence."
        )
    return (
        f"{fit.num_rows:,} moving splats{in_pieces}{quality}",
        {
            "num_gaussians": fit.num_rows,
            "num_pieces": pieces,
            "num_dropped": fit.num_dropped,
            "num_invisible": fit.num_unseen,
            "fit_psnr": near,
        },
        notes,
    )
