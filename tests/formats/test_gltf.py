"""glTF: splats of any writer in the places of their nodes, and damage is one error."""

import base64
import json
import math
import struct
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.gltf_files import (
    FRAME,
    SPLATTING,
    put_together,
    quantised,
    read,
    refusal,
    small,
    taken_apart,
    write,
)
from support.splat_files import covariances, largest, shape_error, trained_splats
from support.splat_transform import needs_splat_transform, npm_install, splat_transform

from gsfw.core.exchange import SplatFile
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.formats.gltf.importer import GltfImporter
from gsfw.formats.ply import PlyExporter

COPY = "It may have been cut short or changed in copying; get it again."


def check_same(given, again):
    """Equal but for the rounding to float32."""
    assert torch.allclose(again.means, given.means, rtol=1e-6, atol=1e-6)
    assert largest(again.opacities, given.opacities) < 1e-6
    assert largest(again.scales / given.scales, torch.ones_like(given.scales)) < 2e-6
    assert shape_error(again, covariances(given)) < 1e-5
    assert largest(again.colors.coefficients, given.colors.coefficients) < 1e-6


@given(
    seed=st.integers(0, 2**31),
    degree=st.integers(0, 3),
    antialiased=st.booleans(),
    up=st.sampled_from(["", "-y", "z"]),
)
@settings(max_examples=20)
def test_what_is_read_back_differs_by_rounding_alone(
    tmp_path_factory, seed, degree, antialiased, up
):
    path = tmp_path_factory.getbasetemp() / "again.glb"
    content = SplatFile(trained_splats(40, degree, seed), antialiased=antialiased, up=up)
    again = read(write(path, content))
    check_same(content.splats, again.splats)
    assert again.antialiased is antialiased
    assert again.up == up
    assert again.properties["sets of splats"] == "1"
    assert again.properties["generator"].startswith("gsfw ")
    first = path.read_bytes()
    assert write(path, content).read_bytes() == first


def test_parts_are_written_to_their_places(tmp_path, monkeypatch):
    from gsfw.formats import stored_rows
    from gsfw.formats.gltf import exporter

    given = trained_splats(50, 1)
    whole = write(tmp_path / "a.glb", given).read_bytes()
    by_parts = lambda splats: stored_rows.stored_parts(splats, chunk=16)  # noqa: E731
    monkeypatch.setattr(exporter, "stored_parts", by_parts)
    assert write(tmp_path / "b.glb", given).read_bytes() == whole


def test_the_layout_is_that_of_the_extension(tmp_path):
    given = trained_splats(7, 1)
    document, binary = taken_apart(write(tmp_path / "a.glb", given))
    assert document["extensionsUsed"] == [SPLATTING]
    (primitive,) = document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    assert primitive["extensions"][SPLATTING] == {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    }
    kinds = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}

    def attribute(name):
        accessor = document["accessors"][primitive["attributes"][name]]
        view = document["bufferViews"][accessor["bufferView"]]
        number = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        width = kinds[accessor["type"]]
        values = np.frombuffer(binary, number, 7 * width, view["byteOffset"])
        assert view["byteLength"] == values.nbytes
        return torch.from_numpy(values.reshape(7, width).copy())

    names = [f"SH_DEGREE_1_COEF_{index}" for index in range(3)]
    own = ("ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0", *names)
    prefixed = [f"{SPLATTING}:{name}" for name in own]
    assert list(primitive["attributes"]) == ["POSITION", "COLOR_0", *prefixed]
    positions = attribute("POSITION")
    assert torch.equal(positions, (given.means @ FRAME).float())
    assert document["accessors"][0]["min"] == positions.amin(dim=0).tolist()
    assert document["accessors"][0]["max"] == positions.amax(dim=0).tolist()
    scales, opacities = attribute(f"{SPLATTING}:SCALE"), attribute(f"{SPLATTING}:OPACITY")
    assert torch.allclose(scales.double(), given.scales, rtol=1e-5)
    assert torch.allclose(opacities[:, 0].double(), given.opacities, rtol=1e-5)
    turned = transform_splats(given, Similarity(rotation=FRAME))
    rotations = attribute(f"{SPLATTING}:ROTATION").roll(1, dims=1)
    stored = replace(turned, quats=rotations, scales=scales)
    assert shape_error(stored, covariances(turned)) < 1e-5
    for index, name in enumerate(names):
        stored = attribute(f"{SPLATTING}:{name}")
        assert largest(stored, turned.colors.coefficients[:, 1 + index]) < 1e-6
    # The fallback is linear: the colour of a screen, decoded.
    shown = (given.colors.coefficients[:, 0] * C0 + 0.5).clamp(0, 1)
    linear = torch.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    fallback = attribute("COLOR_0").float() / 255
    assert largest(fallback[:, :3], linear) <= 0.5 / 255 + 1e-6
    assert largest(fallback[:, 3], given.opacities) <= 0.5 / 255 + 1e-6


def check_quantised(given, again):
    assert torch.allclose(again.means, given.means, rtol=1e-6, atol=1e-6)
    assert largest(again.opacities, given.opacities) <= 0.5 / 255 + 1e-6
    assert largest(again.scales, given.scales) <= 0.5 / 65535 + 1e-6
    # Scales of 0.01 at least are off by 1/1300 of themselves, rotations by 1/30,000.
    assert shape_error(again, covariances(given)) < 4 / 1300


def test_interleaved_bytes_and_shorts_are_read(tmp_path):
    given = small()
    again = read(put_together(tmp_path / "a.glb", *quantised(given)))
    check_quantised(given, again.splats)
    # The format says that y is up; in our frame that is -y.
    assert again.up == "-y"
    assert not again.antialiased


def test_buffers_beside_the_file_and_inside_of_it_are_read(tmp_path):
    given = small()
    document, binary = quantised(given)
    path = tmp_path / "a.gltf"
    (tmp_path / "the data").mkdir()
    (tmp_path / "the data" / "b.bin").write_bytes(binary)
    inline = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    for uri in ("the%20data/b.bin", inline):
        document["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(document))
        assert GltfImporter.recognises(path)
        check_quantised(given, read(path).splats)


def test_the_size_counts_each_file_beside_it_once_and_none_that_is_missing(tmp_path):
    document, binary = quantised(small())
    path, inline = tmp_path / "a.gltf", "data:application/octet-stream;base64,"
    (tmp_path / "b c.bin").write_bytes(binary)
    linked = [{"byteLength": 9, "uri": "b%20c.bin"}] * 2
    unread = [
        {"uri": uri}
        for uri in ("none.bin", "../b.bin", "n" * 300, ".", 3, inline + "AAAA", "a.gltf")
    ]
    document["buffers"] = [*linked, *unread]
    path.write_text(json.dumps(document))
    assert GltfImporter().size(path) == path.stat().st_size + len(binary)
    put_together(
        tmp_path / "a.glb", {**document, "buffers": [{"byteLength": 8}, *linked]}, b"x" * 8
    )
    assert GltfImporter().size(tmp_path / "a.glb") == (
        (tmp_path / "a.glb").stat().st_size + len(binary)
    )
    alone = write(tmp_path / "alone.glb", small())
    assert GltfImporter().size(alone) == alone.stat().st_size


def placed(document, **node):
    """The document with its mesh below a node."""
    return {**document, "nodes": [{"children": [1], **node}, {"mesh": 0}]}


def test_splats_and_their_colours_turn_with_their_nodes(tmp_path):
    given = trained_splats(40, 3)
    document, binary = taken_apart(write(tmp_path / "a.glb", given))
    turn = torch.nn.functional.normalize(torch.tensor([0.3, -0.5, 0.7, 0.2]).double(), dim=0)
    inner, outer = 2.0, 0.5
    document["nodes"] = [
        {"rotation": turn.roll(-1).tolist(), "translation": [1, 2, 3], "children": [1]},
        {"scale": [inner] * 3, "children": [2]},
        {"mesh": 0, "matrix": [outer, 0, 0, 0, 0, outer, 0, 0, 0, 0, outer, 0, 4, 5, 6, 1]},
    ]
    again = read(put_together(tmp_path / "b.glb", document, binary)).splats
    matrix = rotation_matrices(turn[None])[0]
    # In the frame of the file: rotation, then places; our frame is half a turn from it.
    local = Similarity(rotation=FRAME)
    moved = Similarity(inner * outer, matrix, matrix @ (inner * torch.tensor([4.0, 5, 6])).double())
    shifted = Similarity(translation=torch.tensor([1.0, 2, 3]).double())
    expected = given
    for step in (local, moved, shifted, local):
        expected = transform_splats(expected, step)
    assert torch.allclose(again.means, expected.means, atol=1e-5)
    assert largest(again.scales / expected.scales, torch.ones_like(again.scales)) < 1e-5
    assert shape_error(again, covariances(expected)) < 1e-5
    assert largest(again.colors.coefficients, expected.colors.coefficients) < 1e-5


def test_splats_below_a_node_that_stretches_are_stretched(tmp_path):
    given = trained_splats(40, 1)
    document, binary = taken_apart(write(tmp_path / "a.glb", given))
    scale = torch.tensor([2.0, 1.0, 0.5]).double()
    document = placed(document, scale=scale.tolist())
    again = read(put_together(tmp_path / "b.glb", document, binary)).splats

    # Stretches along the axes are the same in both frames, and turn no colours.
    assert torch.allclose(again.means, given.means * scale, atol=1e-5)
    stretch = torch.diag(scale)
    assert shape_error(again, stretch @ covariances(given) @ stretch) < 1e-5
    assert largest(again.colors.coefficients, given.colors.coefficients) < 1e-5


def test_files_of_the_review_draft_have_logarithms_of_scales(tmp_path):
    """So splat-transform wrote them until June 2026."""
    given = trained_splats(40, 1)
    document, binary = taken_apart(write(tmp_path / "a.glb", given))
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    accessor = document["accessors"][attributes["KHR_gaussian_splatting:SCALE"]]
    first = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    drafted = bytearray(binary)
    stored = np.ndarray((40, 3), "<f4", drafted, first)
    stored[:] = np.log(stored)
    found = read(put_together(tmp_path / "b.glb", document, bytes(drafted)))
    assert found.num_dropped == 0
    assert torch.allclose(found.splats.scales, given.scales, rtol=1e-5)


def test_splats_that_their_nodes_move_beyond_float32_are_dropped_and_counted(tmp_path):
    document, binary = quantised(small())
    for scale in ([1e38, 1e38, 1e38], [1e38, 1, 1]):
        path = put_together(tmp_path / "a.glb", placed(document, scale=scale), binary)
        found = read(path)
        assert 0 < found.num_dropped < 30
        assert found.num_dropped + len(found.splats) == 30
        for name, values in found.splats.tensors().items():
            assert values.float().isfinite().all(), name
    for node in ({"scale": [1e160, 1, 1]}, {"translation": [0, 1e300, 0]}):
        said = refusal(put_together(tmp_path / "a.glb", placed(document, **node), binary))
        assert "its transforms are beyond 3.4e+38, where float32 ends." in said
    far = placed(document, scale=[3e38] * 3, translation=[3e38] * 3)
    said = refusal(put_together(tmp_path / "a.glb", far, binary))
    assert "the transforms of meshes[0].primitives[0] move all of its rows" in said


@pytest.mark.parametrize(
    "node", [{"scale": [-1, 1, 1]}, {"scale": [0, 1, 1]}, {"matrix": [0] * 16}]
)
def test_nodes_that_mirror_or_flatten_are_refused(tmp_path, node):
    document, binary = quantised(small())
    said = refusal(put_together(tmp_path / "a.glb", placed(document, **node), binary))
    assert said == (
        "FILE: meshes[0].primitives[0]: its transform mirrors it, or makes it flat, which no "
        "splats can be drawn with.\nApply the transform in the tool that made the file."
    )


def test_all_sets_of_the_scene_are_joined(tmp_path):
    first, second = small(20), trained_splats(10, 1)
    document, binary = quantised(first)
    other, further = taken_apart(write(tmp_path / "b.glb", second))
    padding = bytes(-len(binary) % 4)
    for view in other["bufferViews"]:
        view["byteOffset"] += len(binary + padding)
        document["bufferViews"].append(view)
    attributes = other["meshes"][0]["primitives"][0]["attributes"]
    offset = len(document["accessors"])
    for accessor in other["accessors"]:
        accessor["bufferView"] += 1
        document["accessors"].append(accessor)
    shifted = {name: index + offset for name, index in attributes.items()}
    splatting = {SPLATTING: {"kernel": "custom", "colorSpace": "srgb_rec709_display"}}
    document["meshes"].append({"primitives": [{"attributes": shifted, "extensions": splatting}]})
    document["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}}]})
    document["nodes"] = [
        {"children": [1, 2, 3]},
        {"mesh": 0},
        {"mesh": 1, "translation": [0, 0, 5]},
        {"mesh": 2},
        {"mesh": 0},
    ]
    document["buffers"][0]["byteLength"] = len(binary + padding + further)
    path = put_together(tmp_path / "a.glb", document, binary + padding + further)
    content = read(path)
    assert content.properties["sets of splats"] == "2"
    assert len(content.splats) == 30
    check_quantised(first, content.splats.take(torch.arange(20)))
    up = torch.tensor([0.0, 0.0, 5.0]).double()
    check_same(replace(second, means=second.means + up), content.splats.take(torch.arange(20, 30)))
    assert not content.splats.colors.coefficients[:20, 1:].any()
    # Without a scene all nodes are shown, and without nodes all meshes.
    del document["scenes"]
    assert len(read(put_together(path, document, binary + padding + further)).splats) == 50
    del document["nodes"]
    assert len(read(put_together(path, document, binary + padding + further)).splats) == 30


def test_values_that_are_not_finite_are_dropped_and_counted(tmp_path):
    document, binary = taken_apart(write(tmp_path / "a.glb", trained_splats(9, 0)))
    view = document["bufferViews"][3]["byteOffset"]  # Scales; a negative one is none.
    changed = bytearray(binary)
    changed[view : view + 4] = struct.pack("<f", -1)
    changed[12:16] = struct.pack("<f", math.nan)
    content = read(put_together(tmp_path / "a.glb", document, bytes(changed)))
    assert content.num_dropped == 2
    assert len(content.splats) == 7


def test_bands_above_the_third_are_left_out(tmp_path):
    assert read(write(tmp_path / "a.glb", trained_splats(9, 4))).splats.colors.degree == 3


def test_splats_that_no_file_holds_are_refused_and_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.formats.gltf.exporter.MOST_BYTES", 2000)
    with pytest.raises(ValueError, match=r"^5 splats take \d+ bytes, and a .glb holds 2000;"):
        write(tmp_path / "a.glb", trained_splats(5, 1))
    assert list(tmp_path.iterdir()) == []


VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
const data = new Uint8Array(fs.readFileSync(process.argv[2]));
validator.validateBytes(data, {maxIssues: 0}).then(report => console.log(JSON.stringify(report)));
"""


@pytest.mark.slow
@needs_splat_transform
@pytest.mark.parametrize("degree", [0, 3])
def test_the_validator_of_khronos_accepts_what_is_written(tmp_path, degree):
    import subprocess

    folder = Path(tempfile.gettempdir()) / "gsfw-gltf-validator-2.0.0-dev.3.10"
    npm_install(folder, "gltf-validator@2.0.0-dev.3.10")
    path = write(tmp_path / "a.glb", trained_splats(2000, degree))
    (folder / "validate.cjs").write_text(VALIDATE)
    command = ["node", "validate.cjs", str(path)]
    said = subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=120)
    report = json.loads(said.stdout)
    # It does not know the extension yet, and takes its attributes for misspelt ones.
    unknown = {"MESH_PRIMITIVE_INVALID_ATTRIBUTE", "UNSUPPORTED_EXTENSION"}
    other = [
        message
        for message in report["issues"]["messages"]
        if message["code"] not in unknown
        or (SPLATTING not in message["pointer"] and message["code"] != "UNSUPPORTED_EXTENSION")
    ]
    assert other == []
    assert report["info"]["totalVertexCount"] == 2000
    assert report["info"]["hasDefaultScene"] is True


@pytest.mark.slow
@needs_splat_transform
def test_what_another_tool_writes_is_read(tmp_path):
    given = trained_splats(3000, 3)
    PlyExporter().write(tmp_path / "a.ply", SplatFile(given))
    splat_transform(tmp_path / "a.ply", tmp_path / "a.glb")
    content = read(tmp_path / "a.glb")
    assert content.up == "-y"
    # It sorts the splats: they are told apart by their places.
    order = torch.cdist(content.splats.means, given.means).argmin(dim=1)
    assert torch.equal(order.sort().values, torch.arange(3000))
    check_same(given.take(order), content.splats)


def test_files_of_the_first_draft_have_colours_and_opacities_in_color_0(tmp_path):
    """CesiumJS has such a file: Specs/Data/Cesium3DTiles/GaussianSplats/synthetic (2025)."""
    document, binary = taken_apart(write(tmp_path / "a.glb", trained_splats(40, 0)))
    (primitive,) = document["meshes"][0]["primitives"]
    names = {"POSITION": "POSITION", "COLOR_0": "COLOR_0"}
    names |= {"_ROTATION": f"{SPLATTING}:ROTATION", "_SCALE": f"{SPLATTING}:SCALE"}
    attributes = primitive["attributes"]
    primitive["attributes"] = {new: attributes[old] for new, old in names.items()}
    primitive["extensions"] = {SPLATTING: {}}
    found = read(put_together(tmp_path / "draft.glb", document, binary)).splats
    whole = read(tmp_path / "a.glb").splats
    for field in ("means", "quats", "scales"):
        assert torch.equal(getattr(found, field), getattr(whole, field))
    assert largest(found.opacities, whole.opacities) < 0.003
    stored = np.frombuffer(binary, "u1", 4 * 40, document["bufferViews"][1]["byteOffset"])
    wanted = torch.tensor(stored.reshape(40, 4)[:, :3] / 255)
    assert largest(C0 * found.colors.coefficients[:, 0] + 0.5, wanted) < 1e-6
