"""Files: one module or folder per format."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl

EXPORTERS = (
    Spec("ply", "3DGS PLY, as Kerbl et al. 2023 write it", "gsfw.formats.ply:PlyExporter"),
    Spec(
        "compressed-ply",
        "compressed PLY of SuperSplat and PlayCanvas, a quarter to a tenth of the bytes",
        "gsfw.formats.compressed_ply:CompressedPlyExporter",
    ),
    Spec(
        "spz",
        "quantised splats (Niantic), a tenth of a PLY",
        "gsfw.formats.spz.exporter:SpzExporter",
    ),
    Spec(
        "sog",
        "SOG of PlayCanvas: images with codebooks, for the web",
        "gsfw.formats.sog.exporter:SogExporter",
    ),
    Spec("splat", ".splat of antimatter15, without SH", "gsfw.formats.splat:SplatExporter"),
    Spec(
        "ksplat",
        "GaussianSplats3D (mkkellogg), level 0 or 1, SH to degree 2",
        "gsfw.formats.ksplat.exporter:KsplatExporter",
    ),
    Spec(
        "gltf",
        "glTF 2.0 with KHR_gaussian_splatting, SH to degree 3",
        "gsfw.formats.gltf.exporter:GltfExporter",
    ),
    Spec(
        "usd",
        "OpenUSD (.usdc, .usda, .usd, .usdz), at rest or moving, SH to degree 3",
        "gsfw.formats.usd.exporter:UsdExporter",
    ),
    Spec(
        "splatv",
        "moving splats for the player splaTV, without view dependence",
        "gsfw.formats.splatv:SplatvExporter",
    ),
    Spec(
        "html",
        "one page that plays the scene in a browser, without a network",
        "gsfw.formats.web.html:HtmlExporter",
    ),
    Spec(
        "web",
        "a folder for any web host: page, scene, preview images, and snippets to embed it",
        "gsfw.formats.web.folder:WebExporter",
    ),
    Spec(
        "gsfw",
        "the whole model at all times, to be rendered without its data set",
        "gsfw.formats.model_file:ModelFileExporter",
    ),
    Spec(
        "mesh",
        "the surface as triangles with colours (.ply, .obj, .glb), from rendered depth",
        "gsfw.formats.mesh.exporter:MeshExporter",
    ),
    Spec(
        "points",
        "PLY of coloured points, for programs that know no splats",
        "gsfw.formats.points:PointsExporter",
    ),
    Spec(
        "tracks",
        "the paths of all Gaussians over time, for NumPy",
        "gsfw.formats.tracks:TracksExporter",
    ),
)

IMPORTERS = (
    Spec("ply", "3DGS PLY, any SH degree", "gsfw.formats.ply:PlyImporter"),
    Spec(
        "compressed-ply",
        "compressed PLY of SuperSplat and PlayCanvas",
        "gsfw.formats.compressed_ply:CompressedPlyImporter",
    ),
    Spec("spz", "SPZ, versions 1 to 4", "gsfw.formats.spz.importer:SpzImporter"),
    Spec(
        "sog",
        "SOG of PlayCanvas, version 1 and 2: .sog, or meta.json beside its images",
        "gsfw.formats.sog.importer:SogImporter",
    ),
    Spec("splat", ".splat of antimatter15", "gsfw.formats.splat:SplatImporter"),
    Spec("ksplat", "KSPLAT, levels 0 to 2", "gsfw.formats.ksplat.importer:KsplatImporter"),
    Spec(
        "gltf",
        ".glb or .gltf with KHR_gaussian_splatting",
        "gsfw.formats.gltf.importer:GltfImporter",
    ),
    Spec(
        "usd",
        "OpenUSD: .usdc, .usda, .usd or .usdz with ParticleField3DGaussianSplat",
        "gsfw.formats.usd.importer:UsdImporter",
    ),
    Spec("splatv", "splaTV's moving splats", "gsfw.formats.splatv:SplatvImporter"),
)


@hookimpl
def gsfw_exporters() -> list[Spec]:
    """The built-in exporters."""
    return list(EXPORTERS)


@hookimpl
def gsfw_importers() -> list[Spec]:
    """The built-in importers."""
    return list(IMPORTERS)
