"""`gsfw features`: writes feature maps of a folder of images, for slow extractors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.api import DataError, Options, read_options

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(kw_only=True)
class MapOptions(Options):
    """Write feature maps of all images of a folder, for datamanager.maps=features:FOLDER."""

    examples = ("gsfw features images=garden/images out=garden/features extractor=my_clip:Clip",)

    images: str = ""
    """Folder of images."""
    out: str = ""
    """Folder of the maps, one NAME.npy (float16) for each image."""
    extractor: str = "colors"
    """colors, or package.module:Name."""


def run(arguments: list[str]) -> int:
    options = read_options("features", MapOptions, arguments)
    import numpy as np
    import torch
    from PIL import Image

    from gsfw.api import Console
    from gsfw_feature_3dgs.extractors import find_extractor

    console, extractor = Console(options.json), find_extractor(options.extractor)()
    folder, out = Path(options.images), Path(options.out or "features")
    files = sorted(file for file in folder.glob("*") if file.suffix.lower() in SUFFIXES)
    if not options.images or not files:
        raise DataError(f"images={options.images}: there is no folder with images of that name.")
    out.mkdir(parents=True, exist_ok=True)
    for file in files:
        with Image.open(file) as image:
            pixels = np.asarray(image.convert("RGB"), np.float32) / 255
        with torch.no_grad():
            found = extractor.features(torch.from_numpy(pixels)[None])[0]
        np.save(out / f"{file.stem}.npy", found.cpu().numpy().astype(np.float16))
    console.say(f"{len(files)} feature maps in {out}: datamanager.maps=features:{out.resolve()}")
    console.result({"folder": str(out), "maps": len(files)})
    return 0
