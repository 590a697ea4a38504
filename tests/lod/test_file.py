"""A tree in a file is read by chunks, within a bound of memory, and damage is named."""

from dataclasses import replace

import pytest
import torch
from support.scenes import random_splats

from gsfw.core.cameras import Cameras
from gsfw.core.errors import DataError
from gsfw.core.exchange import SplatFile
from gsfw.lod import file as files
from gsfw.lod.build import build
from gsfw.lod.cut import Limits, select
from gsfw.lod.exporter import LodExporter
from gsfw.lod.file import TreeFile
from gsfw.lod.importer import LodImporter

FAR = torch.tensor([4.5e5, 5.2e6, 120.0], dtype=torch.float64)
"""Map coordinates."""


NAN = b"\0\0\xc0\x7f"


@pytest.fixture(scope="module")
def splats():
    return random_splats(5000, 1, dtype=torch.float64)


@pytest.fixture(scope="module")
def written(splats, tmp_path_factory):
    path = tmp_path_factory.mktemp("tree") / "model.lod"
    LodExporter().write(path, SplatFile(splats, antialiased=True, up="z"))
    return path


def test_the_model_comes_back_from_map_coordinates(splats, tmp_path):
    path = tmp_path / "model.lod"
    placed = replace(splats, means=splats.means + FAR)
    LodExporter().write(path, SplatFile(placed, antialiased=True, up="z"))
    back = LodImporter().read(path)
    assert (back.antialiased, back.up, len(back.splats)) == (True, "z", 5000)
    order = placed.means[:, 0].argsort(), back.splats.means[:, 0].argsort()
    assert torch.allclose(placed.means[order[0]], back.splats.means[order[1]], rtol=0, atol=1e-5)
    colors = [
        each.colors.dense()[rows] for each, rows in zip((placed, back.splats), order, strict=True)
    ]
    assert torch.allclose(colors[0].float(), colors[1], atol=2e-3)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_model_of_one_splat_comes_back(degree, tmp_path):
    path, one = tmp_path / "model.lod", random_splats(1, degree)
    LodExporter().write(path, SplatFile(one))
    back = LodImporter().read(path).splats
    assert torch.allclose(back.means.double(), one.means.double(), rtol=0, atol=1e-6)
    assert torch.allclose(back.colors.dense(), one.colors.dense().float(), rtol=0, atol=2e-3)


def test_a_cut_of_the_file_is_that_of_the_tree_in_memory(splats, written):
    origin = splats.means.median(dim=0).values
    tree = build(replace(splats, means=splats.means - origin))
    camera = Cameras.look_at([0.0, 0.0, -2.0], width=64, height=48)
    in_file = TreeFile(written, 1 << 20)
    cut = select(tree, camera, Limits(700))
    assert torch.equal(select(in_file, camera, Limits(700)), cut)
    assert torch.equal(in_file.nodes(cut).values, tree.nodes(cut).values)
    assert torch.equal(in_file.nodes(cut).rest, tree.nodes(cut).rest)


def test_a_view_reads_only_what_it_needs_and_holds_no_more_than_its_bound(written, monkeypatch):
    monkeypatch.setattr(files, "CHUNK", 64)
    bound = 40_000
    tree = TreeFile(written, bound)
    assert written.stat().st_size > 20 * bound
    # From near, only a corner is seen.
    camera = Cameras.look_at([0.9, 0.9, 0.9], [2.0, 2.0, 2.0], width=64, height=48)
    cut = select(tree, camera, Limits(300))
    assert 0 < len(tree.nodes(cut)) <= 300
    assert 0 < tree.most_held <= bound
    assert tree.bytes_read < written.stat().st_size / 3


def test_a_file_that_is_cut_off_or_damaged_is_named(written, tmp_path):
    content = written.read_bytes()
    for name, damaged, words in (
        ("short.lod", content[:-9], "cut off"),
        ("header.lod", content[:12] + b"[" + content[13:], "header"),
        ("length.lod", content[:8] + b"\xff\xff\xff\xff" + content[12:], "damaged"),
        ("axis.lod", content.replace(b'"up": "z"', b'"up": 512'), "up of its header"),
        ("degree.lod", content.replace(b'"sh_degree": 1', b'"sh_degree": 5'), "at most 4"),
        ("value.lod", content[:-200] + NAN * 50, "node 10,002 has values"),
    ):
        path = tmp_path / name
        path.write_bytes(damaged)
        with pytest.raises(DataError, match=words):
            LodImporter().read(path)


def test_a_view_of_damaged_nodes_is_refused_too(written, tmp_path):
    content = written.read_bytes()
    path = tmp_path / "view.lod"
    path.write_bytes(content[:200] + NAN + content[204:-200] + NAN * 50)
    tree = TreeFile(path, 1 << 20)
    with pytest.raises(DataError, match="node 0 has values"):
        select(tree, None, Limits(10))
    tree.nodes(torch.arange(10))
    with pytest.raises(DataError, match="node 10,002 has values"):
        tree.nodes(torch.tensor([tree.num_nodes - 2]))


def test_opacities_out_of_range_are_not_written(splats, tmp_path):
    damaged = replace(splats, opacities=splats.opacities + 1)
    with pytest.raises(ValueError, match="opacities out of"):
        LodExporter().write(tmp_path / "x.lod", SplatFile(damaged))


def test_splats_that_are_not_finite_are_refused(splats, tmp_path):
    means = splats.means.clone()
    means[17, 1] = float("nan")
    with pytest.raises(ValueError, match="row 17"):
        LodExporter().write(tmp_path / "x.lod", SplatFile(replace(splats, means=means)))
