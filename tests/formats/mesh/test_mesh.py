"""Meshes of known surfaces, seen by cameras all around: places, colours, orientation, files."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import torch
from plyfile import PlyData

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.exchange import DepthView, ExportSource
from gsfw.core.maths.camera_path import look_at
from gsfw.core.maths.rays import pixel_rays
from gsfw.formats.mesh import exporter
from gsfw.formats.mesh.blocks import Blocks, cells_of, keys_of
from gsfw.formats.mesh.components import large_parts
from gsfw.formats.mesh.exporter import MeshExporter
from gsfw.formats.mesh.files import write_mesh
from gsfw.formats.mesh.surface_nets import Mesh, surface_net
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.registry import installed

MIDDLE = torch.tensor([5.0, -2.0, 1.0], dtype=torch.float64)
"""The sphere is not at the origin: the world is that of some data."""


def view_of_sphere(place, radius=1.0, side=64):
    """A depth image of a sphere around MIDDLE whose colour is its normal."""
    place = torch.tensor(place, dtype=torch.float64) + MIDDLE
    up = torch.tensor([0.1, 0.2, 1.0], dtype=torch.float64)
    pose, half = look_at(place[None], MIDDLE, up), side / 2
    lens = torch.tensor([[1.2 * side, 0, half], [0, 1.2 * side, half], [0, 0, 1]])
    camera = Cameras(pose, lens[None].double(), side, side)
    directions = pixel_rays(camera)[0, ..., 3:]
    away = place - MIDDLE
    along = -(directions @ away)
    root = along**2 - away.square().sum() + radius**2
    distance = along - root.clamp_min(0).sqrt()
    normals = (away + distance[..., None] * directions) / radius
    depth = torch.where(root > 0, distance * (directions @ pose[0, 2, :3]), 0.0)
    color = (0.5 + 0.5 * normals) * (root > 0)[..., None]
    return DepthView(camera, color.float(), depth.float(), (root > 0).float(), up="z")


PLACES = [
    (3 * np.cos(angle), 3 * np.sin(angle), height)
    for height in (-2.0, 0.0, 2.0)
    for angle in np.linspace(0, 2 * np.pi, 5)[:-1]
] + [(0.3, 0.0, -3.5), (0.3, 0.0, 3.5)]


@pytest.fixture(scope="module")
def views():
    return [view_of_sphere(place) for place in PLACES]


@pytest.fixture(scope="module")
def sphere(views):
    return MeshExporter(resolution=32, min_views=1).mesh(views)


class Source(ExportSource):
    def __init__(self, views):
        self.views = views

    def depth_views(self):
        return self.views


def test_the_surface_is_where_it_is_seen(sphere):
    radii = np.linalg.norm(sphere.vertices - MIDDLE.numpy(), axis=1)
    voxel = 2 / 32
    assert len(sphere.vertices) > 2000
    assert np.median(np.abs(radii - 1)) < 0.1 * voxel
    assert np.quantile(np.abs(radii - 1), 0.99) < 0.5 * voxel


def test_a_sphere_that_is_seen_from_all_around_is_closed_and_looks_outwards(sphere):
    corners = sphere.vertices[sphere.triangles] - MIDDLE.numpy()
    volume = np.linalg.det(corners).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    edges = np.sort(sphere.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).mean() > 0.99


def test_vertices_have_the_colours_of_the_images(sphere):
    normals = sphere.vertices - MIDDLE.numpy()
    expected = 0.5 + 0.5 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.median(np.abs(sphere.colors - expected)) < 0.02


def test_small_parts_are_left_out_by_the_share_of_their_triangles(views):
    ring = np.arange(6).reshape(2, 3)
    mesh = Mesh(
        np.zeros((12, 3)), np.concatenate([ring, [[1, 2, 3]], ring[:1] + 9]), np.zeros((12, 3))
    )
    assert large_parts(mesh, 0.0).all()
    assert large_parts(mesh, 0.5).tolist() == [True, True, True, False]
    kept = mesh.take(large_parts(mesh, 1.0))
    assert len(kept.vertices) == 6
    assert kept.triangles.max() == 5


def test_depths_beyond_the_largest_do_not_count(views):
    near = MeshExporter(resolution=16, max_depth=2.3, min_views=1).mesh(views)
    distance = torch.cat([view.camera.centers for view in views])
    ends = torch.cdist(torch.from_numpy(near.vertices), distance).amin(1)
    assert float(ends.max()) < 2.8
    with pytest.raises(ValueError, match="no view shows a surface"):
        MeshExporter(max_depth=0.5).mesh(views)


def test_voxels_that_no_memory_holds_are_refused_before_they_are_made(views, monkeypatch):
    monkeypatch.setattr(exporter, "MOST_VOXELS", 1 << 15)
    with pytest.raises(ConfigError, match=r"format\.resolution=64: .* more than 32,768 voxels"):
        MeshExporter(resolution=64).mesh(views)


def test_a_surface_that_too_few_views_see_is_refused(views):
    nothing = view_of_sphere((3.0, 0, 0), radius=1e-3, side=8)
    with pytest.raises(ValueError, match="no surface is seen by 3 views"):
        MeshExporter(resolution=16, min_views=3).mesh([views[4], views[6], nothing])


def test_surfaces_smaller_than_a_pixel_are_none():
    dot = replace(view_of_sphere((3.0, 0, 0), side=8), alpha=torch.zeros(8, 8))
    dot.alpha[4, 4] = 1.0
    with pytest.raises(ValueError, match="no view shows a surface"):
        MeshExporter(resolution=16, min_views=1).mesh([dot])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resolution": 4}, "format.resolution=4: expected a number from 8 to 4096."),
        ({"voxel": -1.0}, "format.voxel=-1: expected a finite number of at least 0."),
        ({"least_alpha": 2.0}, "format.least_alpha=2: expected a number from 0 to 1."),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(ConfigError) as caught:
        make_exporter("mesh", installed(), options)
    assert str(caught.value) == message


def test_voxels_are_found_by_their_cells():
    cells = np.array([[-9, 3, 1_000_000], [0, 0, 0], [7, -8, 15]])
    assert np.array_equal(cells_of(keys_of(cells)), cells)
    blocks = Blocks.around([cells[1:] * 0.5], np.zeros(3), 0.5, 10**6)
    assert np.array_equal(blocks.index(blocks.cells(slice(None))), np.arange(2 * 512))
    assert blocks.index(np.array([[100, 0, 0]])).tolist() == [-1]


def test_there_is_no_surface_beside_unknown_voxels():
    axis = np.linspace(0, 7, 8)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    blocks = Blocks.around([points], np.zeros(3), 1.0, 10**6)
    heights = (points[:, 2] - 3.3).astype(np.float32)
    known = points[:, 0] < 4
    mesh = surface_net(blocks, heights, known, np.full((512, 3), np.nan, np.float32))
    assert np.allclose(mesh.vertices[:, 2], 3.3)
    assert mesh.vertices[:, 0].max() < 3
    assert (mesh.colors == 0.5).all()
    normals = np.cross(*(np.diff(mesh.vertices[mesh.triangles], axis=1).transpose(1, 0, 2)))
    assert (normals[:, 2] > 0).all()


def test_ply_and_obj_have_the_same_triangles(views, sphere, tmp_path):
    MeshExporter(resolution=32, min_views=1).write(tmp_path / "a.ply", Source(views))
    write_mesh(tmp_path / "a.obj", sphere, "z")
    ply = PlyData.read(tmp_path / "a.ply")
    places = np.stack([ply["vertex"][axis] for axis in "xyz"], axis=1)
    assert np.allclose(places, sphere.vertices, atol=1e-5)
    assert np.array_equal(np.stack(ply["face"]["vertex_indices"]), sphere.triangles)
    lines = (tmp_path / "a.obj").read_text().splitlines()
    values = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    faces = np.array([line.split()[1:] for line in lines if line.startswith("f ")], dtype=int)
    assert np.allclose(values[:, :3], sphere.vertices, atol=1e-5)
    assert np.allclose(values[:, 3:], sphere.colors, atol=0.003)
    assert np.array_equal(faces - 1, sphere.triangles)


def test_gltf_turns_upwards_to_y(sphere, tmp_path):
    write_mesh(tmp_path / "a.glb", sphere, "z")
    content = (tmp_path / "a.glb").read_bytes()
    magic, _, total, length = struct.unpack("<4sIII", content[:16])
    assert (magic, total) == (b"glTF", len(content))
    document = json.loads(content[20 : 20 + length])
    start = 28 + length
    view = document["bufferViews"][0]
    places = np.frombuffer(content, "<f4", view["byteLength"] // 4, start).reshape(-1, 3)
    assert np.allclose(places, sphere.vertices, atol=1e-5)
    matrix = np.array(document["nodes"][0]["matrix"]).reshape(4, 4).T
    assert np.allclose(matrix @ [0, 0, 1, 0], [0, 1, 0, 0])
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_other_suffixes_are_refused(views, tmp_path):
    with pytest.raises(ConfigError, match=r"format=mesh writes \.ply, \.obj, \.glb"):
        MeshExporter().write(tmp_path / "a.stl", Source(views))
