"""glTF files of splats: taken apart, put together, and as another writer makes them."""

import json
import struct
from dataclasses import replace

import numpy as np
import torch

from gsfw.core.exchange import SplatFile
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.formats.gltf.exporter import GltfExporter
from gsfw.formats.gltf.importer import GltfImporter
from support.refusals import refusal_of
from support.splat_files import trained_splats

SPLATTING = "KHR_gaussian_splatting"
FRAME = torch.diag(torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64))
"""Half a turn about z: from our frame to that of the format, and back."""


def write(path, content):
    content = content if isinstance(content, SplatFile) else SplatFile(content)
    GltfExporter().write(path, content)
    return path


def read(path):
    return GltfImporter().read(path)


refusal = refusal_of(read)


def taken_apart(path):
    """The JSON and the binary chunk of a file, with all rules of the container checked."""
    raw = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", raw)
    size, kind = struct.unpack_from("<I4s", raw, 12)
    bytes_, binary = struct.unpack_from("<I4s", raw, 20 + size)
    assert (magic, version, length, kind, binary) == (b"glTF", 2, len(raw), b"JSON", b"BIN\0")
    assert size % 4 == bytes_ % 4 == 0
    assert 28 + size + bytes_ == len(raw)
    return json.loads(raw[20 : 20 + size]), raw[28 + size :]


def put_together(path, document, binary):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def quantised(given):
    """The splats as the extension permits: bytes and shorts, interleaved, several sets."""
    count = len(given)
    means = (given.means @ FRAME).float()
    kinds = [
        ("POSITION", "<f4", 3, 5126, "VEC3", False),
        (f"{SPLATTING}:ROTATION", "<i2", 4, 5122, "VEC4", True),
        (f"{SPLATTING}:SCALE", "<u2", 3, 5123, "VEC3", True),
        (f"{SPLATTING}:OPACITY", "u1", 1, 5121, "SCALAR", True),
        (f"{SPLATTING}:SH_DEGREE_0_COEF_0", "<f4", 3, 5126, "VEC3", False),
    ]
    fields = [(name, number, (width,)) for name, number, width, *_ in kinds]
    rows = np.zeros(count, dtype=np.dtype(fields, align=True))
    turned = transform_splats(given, Similarity(rotation=FRAME))
    quats = torch.nn.functional.normalize(turned.quats, dim=1).roll(-1, dims=1)
    rows["POSITION"] = means.numpy()
    rows[f"{SPLATTING}:ROTATION"] = (quats * 32767).round().numpy()
    rows[f"{SPLATTING}:SCALE"] = (given.scales * 65535).round().numpy()
    rows[f"{SPLATTING}:OPACITY"][:, 0] = (given.opacities * 255).round().numpy()
    rows[f"{SPLATTING}:SH_DEGREE_0_COEF_0"] = given.colors.coefficients[:, 0].numpy()
    view = {"buffer": 0, "byteLength": rows.nbytes, "byteStride": rows.itemsize}
    accessors, attributes = [], {}
    for name, _, _, component, kind, normalized in kinds:
        attributes[name] = len(accessors)
        place = rows.dtype.fields[name][1]
        accessor = {"bufferView": 0, "byteOffset": place, "componentType": component}
        accessors.append({**accessor, "count": count, "type": kind, "normalized": normalized})
    primitive = {
        "attributes": attributes,
        "mode": 0,
        "extensions": {SPLATTING: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": [SPLATTING],
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": [view],
        "buffers": [{"byteLength": rows.nbytes}],
    }
    return document, rows.tobytes()


def small(count=30):
    """Splats of which 16 bits hold the scales."""
    given = trained_splats(count, 0)
    return replace(given, scales=given.scales.clamp(0.01, 1))
