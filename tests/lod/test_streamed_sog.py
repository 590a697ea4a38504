"""A streamed SOG has each region in every level, and splat-transform reads it."""

import json
import shutil
from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from support.scenes import random_splats
from support.splat_transform import (
    WITH_LEVELS,
    needs_splat_transform_with_levels,
    splat_transform,
)
from support.tree_levels import nodes

from gsfw.core.errors import ConfigError, DataError, OutputError
from gsfw.core.exchange import SplatFile
from gsfw.core.files.reading import bytes_of
from gsfw.formats.ply import PlyImporter
from gsfw.formats.sog.importer import SogImporter
from gsfw.lod.streamed_sog import StreamedSogExporter
from gsfw.lod.streamed_sog_importer import StreamedSogImporter
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.registry import installed

SMALL = {"num_levels": 4, "region": 128, "chunk": 256, "sharing": 1}
"""Several files in each of the finer levels of a small scene."""
PLACE = 2e-3
"""Error of a position by the 16 bits of SOG, in scenes a few units wide."""


@pytest.fixture(scope="module")
def content():
    return SplatFile(random_splats(900, 1, dtype=torch.float64), antialiased=True)


@pytest.fixture(scope="module")
def written(content, tmp_path_factory):
    path = tmp_path_factory.mktemp("streamed") / "scene"
    StreamedSogExporter(**SMALL).write(path, content)
    return path


def index(path):
    return json.loads((path / "lod-meta.json").read_text())


def regions(node):
    return [node] if "lods" in node else [each for c in node["children"] for each in regions(c)]


def files(path):
    """The splats of each file, in the order of the index."""
    return [SogImporter().read(path / name) for name in index(path)["filenames"]]


def check_near(found, expected, place=PLACE):
    """All values within the rounding of SOG, row by row."""
    assert len(found) == len(expected)
    assert (found.means - expected.means).abs().max() < place
    assert (found.opacities - expected.opacities).abs().max() < 0.5 / 255 + 1e-5
    colors = [each.colors.coefficients[:, 0] for each in (found, expected)]
    assert (colors[0] - colors[1]).abs().max() < 0.02
    assert (found.scales.log() - expected.scales.log()).abs().max() < 0.05


def test_the_finest_level_of_all_regions_is_the_scene(content, written):
    meta, read = index(written), files(written)
    found = torch.cat(
        [
            read[part["file"]].splats.means[part["offset"] : part["offset"] + part["count"]]
            for part in (region["lods"]["0"] for region in regions(meta["tree"]))
        ]
    )
    assert len(found) == len(content.splats)
    order = torch.cdist(content.splats.means, found.double()).argmin(dim=1)
    assert len(order.unique()) == len(found)
    assert (content.splats.means - found[order]).abs().max() < PLACE


def test_the_finest_level_is_read_back_from_the_folder_or_its_index(content, written):
    for path in (written, written / "lod-meta.json"):
        assert find_importer(path, installed()).size(path) == bytes_of(written)
        found = find_importer(path, installed()).read(path)
        assert found.antialiased
        assert found.properties["generator"].startswith("gsfw ")
        check_near(found.splats.map(torch.Tensor.double), nodes(content, 0))


def test_a_region_without_finer_levels_and_an_environment_are_read_too(written, tmp_path):
    path = shutil.copytree(written, tmp_path / "scene")
    changed = index(path)
    region = regions(changed["tree"])[0]
    del region["lods"]["0"]
    (path / "lod-meta.json").write_text(json.dumps(changed | {"environment": "3_0/meta.json"}))
    assert len(StreamedSogImporter().read(path).splats) == 900 - 64 + 113


def removed(path):
    shutil.rmtree(path / "0_1")


def emptied(path):
    (path / "0_1" / "quats.webp").write_bytes(b"")


def renamed(path):
    names = index(path) | {"filenames": ["../0_0/meta.json"]}
    (path / "lod-meta.json").write_text(json.dumps(names))


def lengthened(path):
    text = (path / "lod-meta.json").read_text()
    (path / "lod-meta.json").write_text(text.replace('"offset": 128', '"offset": 999'))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (removed, "there is no 0_1/meta.json, which belongs to it"),
        (emptied, "its image quats.webp is damaged"),
        (renamed, "expected plain names of files below its folder, found '../0_0/meta.json'"),
        (lengthened, "a region ends at row 1127 of .*, which has 256"),
    ],
)
def test_a_damaged_folder_is_refused_in_words(written, tmp_path, damage, words):
    path = shutil.copytree(written, tmp_path / "scene")
    damage(path)
    with pytest.raises(DataError, match=words):
        StreamedSogImporter().read(path)


def test_each_level_is_that_of_the_tree(content, written):
    meta, read = index(written), files(written)
    assert meta["counts"] == [900, 450, 225, 113]
    assert meta["count"] == sum(meta["counts"])
    for level in range(meta["lodLevels"]):
        parts = [
            each.splats.map(torch.Tensor.double)
            for each, name in zip(read, meta["filenames"], strict=True)
            if name.startswith(f"{level}_")
        ]
        expected, start = nodes(content, level), 0
        for part in parts:
            check_near(part, expected.take(torch.arange(start, start + len(part))))
            start += len(part)
        assert start == meta["counts"][level]
    assert all(each.antialiased for each in read)


def test_regions_tile_each_file_and_have_all_levels(written):
    meta, read = index(written), files(written)
    ranges = {}
    for region in regions(meta["tree"]):
        assert region["lods"].keys() == {"0", "1", "2", "3"}
        assert region["lods"]["0"]["count"] <= SMALL["region"]
        for part in region["lods"].values():
            ranges.setdefault(part["file"], []).append((part["offset"], part["count"]))
    assert len(ranges) == len(read) == 4 + 2 + 1 + 1
    for file, parts in ranges.items():
        assert parts[0][0] == 0
        assert all(a + count == b for (a, count), (b, _) in pairwise(parts))
        assert sum(count for _, count in parts) == len(read[file].splats) <= SMALL["chunk"]


def test_boxes_hold_the_splats_below_them(written):
    meta, read = index(written), files(written)

    def check(node):
        low, high = (torch.tensor(node["bound"][side]) for side in ("min", "max"))
        for part in node.get("lods", {}).values():
            rows = slice(part["offset"], part["offset"] + part["count"])
            means = read[part["file"]].splats.means[rows]
            assert (means > low).all()
            assert (means < high).all()
        for child in node.get("children", []):
            assert (torch.tensor(child["bound"]["min"]) >= low).all()
            assert (torch.tensor(child["bound"]["max"]) <= high).all()
            check(child)

    check(meta["tree"])


def test_map_coordinates_are_kept(content, tmp_path):
    far = torch.tensor([4.5e5, 5.2e6, 120.0], dtype=torch.float64)
    placed = replace(content, splats=replace(content.splats, means=content.splats.means + far))
    StreamedSogExporter(num_levels=2).write(tmp_path, placed)
    check_near(files(tmp_path)[-1].splats, nodes(placed, 1), place=0.6)  # float32 at 5,200 km.


def test_levels_are_added_until_few_are_left(tmp_path):
    StreamedSogExporter().write(tmp_path, SplatFile(random_splats(17_000, 0)))
    assert index(tmp_path)["counts"] == [17_000, 8_500]


def test_a_scene_of_one_splat_has_one_level(tmp_path):
    StreamedSogExporter().write(tmp_path, SplatFile(random_splats(1, 3)))
    assert index(tmp_path)["tree"]["lods"] == {"0": {"file": 0, "offset": 0, "count": 1}}


def test_the_same_splats_give_the_same_bytes_with_any_number_of_threads(content, tmp_path):
    before = torch.get_num_threads()
    try:
        for name, threads in ("a", 1), ("b", 3):
            torch.set_num_threads(threads)
            StreamedSogExporter(**SMALL).write(tmp_path / name, content)
            assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
    for path in (tmp_path / "a").rglob("*.*"):
        assert (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes() == path.read_bytes()


def test_an_earlier_export_is_replaced_whole(content, tmp_path):
    StreamedSogExporter(num_levels=3).write(tmp_path, content)
    (tmp_path / "._0_0").write_text("of the system")
    StreamedSogExporter(num_levels=2).write(tmp_path, content)
    assert {item.name for item in tmp_path.iterdir()} == {"lod-meta.json", "0_0", "1_0", "._0_0"}


@pytest.mark.parametrize("name", ["notes.txt", "0_0/photo.jpg", "env/meta.json"])
def test_a_folder_with_other_files_is_left_as_it_is(content, tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match=f"has files of other kinds, such as {name[:3]}"):
        StreamedSogExporter(**SMALL).write(tmp_path, content)
    assert [item for item in tmp_path.rglob("*.*") if item.is_file()] == [tmp_path / name]


def test_the_index_in_place_of_its_folder_is_refused(content, tmp_path):
    with pytest.raises(ConfigError, match="is the index of a folder"):
        StreamedSogExporter().write(tmp_path / "lod-meta.json", content)


@pytest.mark.parametrize(
    ("options", "cause", "advice"),
    [
        (
            {"num_levels": 12},
            "format.num_levels=12: a scene of 900 Gaussians cannot be halved so often.",
            "Give format.num_levels=11 or fewer.",
        ),
        (
            {"num_levels": 6, "region": 20},
            "format.num_levels=6: regions of 20 Gaussians cannot be halved so often.",
            "Give format.num_levels=5 or fewer, or format.region=32 or more.",
        ),
    ],
)
def test_too_few_splats_for_the_levels_are_refused(content, tmp_path, options, cause, advice):
    with pytest.raises(ConfigError) as refused:
        StreamedSogExporter(**options).write(tmp_path / "scene", content)
    assert (refused.value.message, refused.value.advice) == (cause, advice)
    assert not (tmp_path / "scene").exists()


@pytest.mark.slow
@needs_splat_transform_with_levels
def test_splat_transform_reads_every_level(content, written, tmp_path):
    for level in range(SMALL["num_levels"]):
        back = tmp_path / f"{level}.ply"
        splat_transform(written / "lod-meta.json", back, version=WITH_LEVELS, level=level)
        check_near(PlyImporter().read(back).splats, nodes(content, level))
