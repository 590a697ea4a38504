"""Splat files of other tools: one module per format."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_exporters() -> list[Spec]:
    """The built-in exporters."""
    return [
        Spec("ply", "3DGS PLY, as Kerbl et al. 2023 write it", "gsfw.formats.ply:PlyExporter"),
        Spec(
            "gsfw",
            "the whole model at all times, to be rendered without its data set",
            "gsfw.formats.model_file:ModelFileExporter",
        ),
        Spec(
            "tracks",
            "the paths of all Gaussians over time, for NumPy",
            "gsfw.formats.tracks:TracksExporter",
        ),
    ]


@hookimpl
def gsfw_importers() -> list[Spec]:
    """The built-in importers."""
    return [
        Spec("ply", "3DGS PLY, any SH degree", "gsfw.formats.ply:PlyImporter"),
    ]
