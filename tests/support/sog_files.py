"""SOG as other writers make it: a folder, and version 1."""

import json
import zipfile

import numpy as np
from PIL import Image


def entries(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def unpacked(path, folder, change=lambda meta: None):
    """The files of an archive in a folder, with another description."""
    folder.mkdir()
    for name, content in entries(path).items():
        (folder / name).write_bytes(content)
    meta = json.loads(entries(path)["meta.json"])
    change(meta)
    (folder / "meta.json").write_text(json.dumps(meta))
    return folder


def legacy(folder, given):
    """A folder of version 1, written from its definition; returns the values that it holds."""
    n = len(given)
    random = np.random.default_rng(0)
    folder.mkdir()
    ends = {"mins": [-1.0, -2.0, -3.0], "maxs": [1.0, 2.0, 4.0]}
    meta = {
        "means": {"shape": [n, 3], **ends, "files": ["means_l.webp", "means_u.webp"]},
        "scales": {**ends, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"mins": [0.0, 0.0, 0.0, -5.0], "maxs": [1.0, 1.0, 1.0, 5.0], "files": ["sh0.webp"]},
        "shN": {"mins": -0.5, "maxs": 0.5, "files": ["shN_centroids.webp", "shN_labels.webp"]},
    }
    (folder / "meta.json").write_text(json.dumps(meta))
    side = int(np.ceil(np.sqrt(n)))
    images = {}
    for name in ("means_l", "means_u", "scales", "quats", "sh0", "shN_labels"):
        images[name] = random.integers(256, size=(side, side, 4), dtype=np.uint8)
    images["quats"][..., 3] |= 252
    images["shN_labels"][..., 0] %= 64
    images["shN_labels"][..., 1] = 0
    images["shN_centroids"] = random.integers(256, size=(1, 64 * 3, 4), dtype=np.uint8)
    for name, image in images.items():
        Image.fromarray(image).save(folder / f"{name}.webp", lossless=True, exact=True)
    return meta, {name: image.reshape(-1, 4).astype(float) for name, image in images.items()}
