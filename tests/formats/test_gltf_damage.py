"""glTF files that are damaged, or hold something else: one clear error, and no large allocation."""

import json
import math
import tracemalloc

import pytest
from support.gltf_files import SPLATTING, put_together, quantised, refusal, small, write

from gsfw.formats.gltf.importer import GltfImporter

COPY = "It may have been cut short or changed in copying; get it again."


def changed(document, place, value):
    """A copy with one value replaced, or taken out by ``None``."""
    whole = json.loads(json.dumps(document))
    inner = whole
    for key in place[:-1]:
        inner = inner[key]
    if value is None:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    return whole


PRIMITIVE = ("meshes", 0, "primitives", 0)
ATTRIBUTES = (*PRIMITIVE, "attributes")
SCALE = (*ATTRIBUTES, f"{SPLATTING}:SCALE")
AT = "FILE: meshes[0].primitives[0]"
POSITION_AT, SCALE_AT = f"{AT}.attributes.POSITION", f"{AT}.attributes.{SPLATTING}:SCALE"


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ((*PRIMITIVE, "extensions"), None, "FILE contains no splats: none of its 1 meshes in the"),
        (("extensionsRequired",), ["EXT_meshopt_compression"], "FILE requires EXT_meshopt_compre"),
        (
            (*PRIMITIVE, "extensions", SPLATTING, "colorSpace"),
            "lin_rec709_display",
            f"{AT} has colours of 'lin_rec709_display', and those of a screen",
        ),
        (
            (*ATTRIBUTES, f"{SPLATTING}:SH_DEGREE_1_COEF_1"),
            4,
            f"{AT}.attributes has 2 SH coefficients, expected 1, 4, 9 or 16.",
        ),
        (SCALE, None, f"{SCALE_AT} of its JSON is missing; expected a whole number"),
        (SCALE, 1, f"{SCALE_AT}: expected VEC3 of bytes, shorts or floats, found VEC4 of comp"),
        (SCALE, 99, f"{SCALE_AT} is accessor 99, which there is not."),
        (("accessors", 2, "bufferView"), None, f"{SCALE_AT} is stored sparsely, or compressed"),
        (("accessors", 2, "count"), 29, f"{SCALE_AT} has 29 values, and there are 30 positions."),
        (("accessors", 0, "count"), 31, f"{POSITION_AT} has 31 values of 12 bytes, which do not"),
        (("accessors", 0, "count"), 2**50, "FILE announces 1125899906842624 splats, which its"),
        (("accessors", 0, "count"), 0, f"{POSITION_AT} has 0 values"),
        (("accessors", 0, "componentType"), 5125, f"{POSITION_AT}: expected VEC3 of bytes"),
        (("bufferViews", 0, "byteStride"), 4, f"{POSITION_AT} has 30 values of 12 bytes, which"),
        (
            ("bufferViews", 0, "buffer"),
            1,
            "FILE: bufferViews[0].buffer of its JSON: expected a number below 1",
        ),
        (
            ("bufferViews", 0, "byteLength"),
            1.5,
            "FILE: bufferViews[0].byteLength of its JSON: expected a whol",
        ),
        (("nodes", 0, "children"), [0], "FILE: nodes[0] is below two nodes, or below itself."),
        (
            ("nodes", 0, "children"),
            [7],
            "FILE: nodes[0].children of its JSON: expected numbers from 0 to 0",
        ),
        (
            ("nodes", 0, "mesh"),
            3,
            "FILE: nodes[0].mesh of its JSON: expected a number below 1, found 3.",
        ),
        (
            ("nodes", 0, "scale"),
            [1, 1],
            "FILE: nodes[0].scale of its JSON: expected 3 finite numbers, found [1, 1].",
        ),
        (
            ("nodes", 0, "scale"),
            [1, math.inf, 1],
            "FILE: nodes[0].scale[1] of its JSON: expected one finite number, found inf.",
        ),
        (("nodes",), 5, "FILE: nodes of its JSON: expected a list of objects, found 5."),
        (
            ("buffers", 0, "uri"),
            "data:;base64,!!",
            "FILE: buffers[0].uri of its JSON: expected base64 data",
        ),
        (("buffers", 0, "uri"), "missing.bin", "FILE: its buffer 'missing.bin' cannot be read: No"),
        (("buffers", 0, "uri"), "data:;base64,AAAA", "FILE: buffers[0] has 1200 bytes, and 3 are"),
    ],
)
def test_documents_that_no_tool_writes_are_refused_with_the_place(tmp_path, place, value, message):
    document, binary = quantised(small())
    path = put_together(tmp_path / "a.glb", changed(document, place, value), binary)
    assert refusal(path).startswith(message)


def test_few_splats_that_are_used_very_often_are_refused(tmp_path):
    document, binary = quantised(small(2000))
    document["nodes"] = [{"mesh": 0}] * 600
    document["scenes"] = [{"nodes": list(range(600))}]
    path = put_together(tmp_path / "a.glb", document, binary)
    assert "announces 1200000 splats, which its size does not justify" in refusal(path)
    document["nodes"] = [{}] * 20_001
    path = put_together(tmp_path / "a.glb", document, binary)
    assert "FILE has 20001 nodes, and 20000 are read." in refusal(path)


def test_containers_that_are_damaged_are_refused(tmp_path):
    path = write(tmp_path / "a.glb", small(5))
    raw = path.read_bytes()
    deep = b"[" * 100_000
    tracemalloc.start()
    for content, message in (
        (b"", "FILE is no glTF file: it begins neither with 'glTF' nor with '{'."),
        (b"ply\n", "FILE is no glTF file"),
        (raw[:15], f"FILE is cut short: it has 15 bytes.\n{COPY}"),
        (raw[:-1], f"FILE is cut short: its header announces {len(raw)} bytes, and it has"),
        (raw[:4] + b"\1" + raw[5:], "FILE is glTF of version 1; version 2 is read."),
        (raw[:12] + b"\xff\xff\xff\x7f" + raw[16:], "FILE is cut short: its header announces 214"),
        (raw[:16] + b"BIN\0" + raw[20:], "FILE is a damaged .glb file: it does not begin with JS"),
        (raw[:20] + b"x" + raw[21:], "FILE has damaged JSON: Expecting value"),
        (b'{"a":' + deep, "FILE has damaged JSON: it is nested too deeply."),
        (b'{"meshes":[]}', "FILE contains no splats: none of its 0 meshes"),
    ):
        path.write_bytes(content)
        assert refusal(path).startswith(message)
    path.write_bytes(b"{" + bytes(17 << 20))
    assert ": its JSON has 167772" in refusal(path)
    assert tracemalloc.get_traced_memory()[1] < 60_000_000
    tracemalloc.stop()
    path.unlink()
    assert refusal(path) == "FILE cannot be read: No such file or directory."
    assert not GltfImporter.recognises(path)


@pytest.mark.parametrize(
    "uri", ["../b.bin", "/etc/passwd", "file:///etc/passwd", "..\\b.bin", "%2e%2e/b.bin", "c:b.bin"]
)
def test_buffers_outside_of_the_folder_are_refused(tmp_path, uri):
    (tmp_path / "b.bin").write_bytes(bytes(9999))
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "b.bin")
    document, _ = quantised(small())
    for name in (uri, "link.bin"):
        document["buffers"][0]["uri"] = name
        (folder / "a.gltf").write_text(json.dumps(document))
        said = refusal(folder / "a.gltf")
        assert "is not in the folder of the file.\nPut both files into one folder" in said


def test_a_file_that_many_buffers_name_counts_once_and_is_read_once(tmp_path):
    (tmp_path / "b.bin").write_bytes(bytes(100_000))
    document, _ = quantised(small())
    document["buffers"] = [{"uri": "b.bin", "byteLength": 100_000}] * 100
    document["accessors"][0]["count"] = 2_000_000
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(document))
    tracemalloc.start()
    assert "announces 2000000 splats, which its size does not justify" in refusal(path)
    # An own buffer for each attribute, all in the one file.
    document["accessors"][0]["count"] = 30
    view = document["bufferViews"][0]
    document["bufferViews"] = [{**view, "buffer": index} for index in range(5)]
    for index, accessor in enumerate(document["accessors"]):
        accessor["bufferView"] = index
    path.write_text(json.dumps(document))
    content = GltfImporter().read(path)
    assert len(content.splats) + content.num_dropped == 30
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 600_000
