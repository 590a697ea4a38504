"""Level of detail: a tree over the Gaussians of a static model, and cuts through it for a view.

After the hierarchies of Kerbl et al. 2024 (A Hierarchical 3D Gaussian Representation for Real-Time
Rendering of Very Large Datasets), Ren et al. 2024 (Octree-GS) and Liu et al. 2024 (CityGaussian).
"""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_exporters() -> list[Spec]:
    """The writers of trees."""
    return [
        Spec(
            "lod",
            "a tree of levels of detail, drawn within a budget and a bound of memory",
            "gsfw.lod.exporter:LodExporter",
        ),
        Spec(
            "streamed-sog",
            "levels of detail for PlayCanvas and SuperSplat: a folder that browsers load in parts",
            "gsfw.lod.streamed_sog:StreamedSogExporter",
        ),
    ]


@hookimpl
def gsfw_importers() -> list[Spec]:
    """The readers of levels of detail: their finest level."""
    return [
        Spec("lod", "tree of levels of detail (.lod)", "gsfw.lod.importer:LodImporter"),
        Spec(
            "streamed-sog",
            "streamed SOG of PlayCanvas: lod-meta.json, or its folder",
            "gsfw.lod.streamed_sog_importer:StreamedSogImporter",
        ),
    ]
