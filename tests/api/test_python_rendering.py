"""Tests of gsfw.api.models: render of one's own splats, and models of files."""

import math
import pickle
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.api import Cameras, ConfigError, DataError, Sh, SplatFile, Splats, load, render
from gsfw.formats.compressed_ply import CompressedPlyExporter
from gsfw.formats.ply import PlyExporter


def few_splats() -> dict[str, torch.Tensor]:
    """Two large splats, float64: every pixel of a small image is above all cut-offs."""
    generator = torch.Generator().manual_seed(3)

    def drawn(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    return {
        "means": drawn(2, 3) - 0.5,
        "opacities": 0.4 + 0.2 * drawn(2),
        "colors": drawn(2, 3),
        "quats": drawn(2, 4) - 0.5,
        "scales": 0.6 + 0.2 * drawn(2, 3),
    }


@pytest.mark.slow
@pytest.mark.unchecked
def test_gradients_of_a_render_are_its_finite_differences():
    camera = Cameras.look_at(torch.tensor([0.3, -0.4, -3.0]).double(), width=3, height=2)

    def rendered(pose: torch.Tensor, *tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        splats = Splats(**dict(zip(few_splats(), tensors, strict=True)))
        output = render(
            splats, replace(camera, world_to_camera=pose), background=(0.2, 0.5, 0.9),
            depth=True,
        )  # fmt: skip
        assert output.depth is not None
        return output.color, output.alpha, output.depth

    inputs = [camera.world_to_camera, *few_splats().values()]
    assert torch.autograd.gradcheck(rendered, [it.requires_grad_() for it in inputs])


@pytest.mark.unchecked
def test_splats_of_one_colour_fit_an_image_by_gradients():
    camera = Cameras.look_at([0, 0, -3], width=16, height=16)
    photo = torch.zeros(16, 16, 3)
    photo[:, :8, 0] = 1.0
    generator = torch.Generator().manual_seed(0)
    means = torch.rand(60, 3, generator=generator) * 2 - 1
    colors, shape = torch.full((60, 3), 0.5), torch.full((60, 4), -1.5)
    parameters = [tensor.requires_grad_() for tensor in (means, colors, shape)]
    errors = []
    for _ in range(15):
        splats = Splats(means, shape[:, 0].sigmoid(), colors, torch.ones(60, 4), shape[:, 1:].exp())
        error = (render(splats, camera).color[0] - photo).square().mean()
        gradients = torch.autograd.grad(error, parameters)
        with torch.no_grad():  # Importing torch's optimizers takes seconds.
            for parameter, gradient in zip(parameters, gradients, strict=True):
                parameter.sub_(0.05 * gradient.sign())
        errors.append(error.item())
    assert errors[-1] < 0.3 * errors[0]


def test_cameras_of_any_precision_render_splats_of_theirs():
    splats, camera = random_splats(5), front_camera()
    expected = render(splats, camera).color
    assert expected.dtype == torch.float32
    assert torch.equal(render(splats, camera.to(dtype=torch.float64)).color, expected)
    assert torch.equal(render(splats, [camera]).color, expected)


def test_a_background_is_a_name_a_text_or_a_value_for_each_channel():
    splats, camera = random_splats(2), front_camera()
    for background in ("white", "1,1,1", (1.0, 1.0, 1.0), torch.ones(3)):
        assert render(splats, camera, background=background).color[0, 0, 0].tolist() == [1, 1, 1]
    features = replace(splats, colors=torch.ones(2, 5))
    corner = render(features, camera, background=[0.5] * 5).color[0, 0, 0]
    assert corner.tolist() == [0.5] * 5
    double = splats.map(lambda tensor: tensor.double())
    fine = torch.full((3,), 0.1, dtype=torch.float64)
    corner = render(double, camera, background=fine).color[0, 0, 0]
    assert corner.tolist() == [0.1] * 3, "a background has the precision of the splats"
    with pytest.raises(ConfigError, match=r"background=pink: expected white, black"):
        render(splats, camera, background="pink")


def test_what_does_not_fit_is_refused_with_the_remedy():
    splats, camera = random_splats(2), front_camera()
    with pytest.raises(ConfigError, match=r"no rasterizer 'cup'. Did you mean 'cpu'"):
        render(splats, camera, rasterizer="cup")
    with pytest.raises(ConfigError, match=r"cameras of different sizes .* cannot share a batch"):
        render(splats, [camera, camera.resized(7, 5)])
    with pytest.raises(ConfigError, match="expected at least one camera"):
        render(splats, [])
    with pytest.raises(ConfigError, match="splats belong to one time already"):
        render(splats, camera, time=0.5)
    with pytest.raises(ValueError, match=r"splats.opacities: expected values in \[0, 1\]; 2 of 2"):
        render(replace(splats, opacities=torch.full((2,), 1.5)), camera)


@pytest.mark.slow
def test_matrices_of_any_kind_make_cameras():
    pose, lens = front_camera().world_to_camera[0], front_camera().intrinsics[0]
    expected = front_camera()
    for kind in (lambda tensor: tensor, np.asarray, lambda tensor: tensor.tolist()):
        made = Cameras.from_matrices(kind(pose), kind(lens), expected.width, expected.height)
        torch.testing.assert_close(made.world_to_camera, expected.world_to_camera)
        torch.testing.assert_close(made.intrinsics, expected.intrinsics)
    short = Cameras.from_matrices(pose[:3].expand(2, 3, 4), lens, 8, 6, time=[0.0, 1.0])
    assert short.world_to_camera.shape == (2, 4, 4)
    assert short.intrinsics.shape == (2, 3, 3)
    assert short.world_to_camera[1, 3].tolist() == [0, 0, 0, 1]
    assert short.time is not None
    assert short.time.tolist() == [0, 1]
    with pytest.raises(ValueError, match=r"world_to_camera: expected shape .*, found \[1, 3, 3\]"):
        Cameras.from_matrices(lens, lens, 8, 6)
    with pytest.raises(ValueError, match=r"intrinsics: expected shape \[3, 3\] or \[1, 3, 3\]"):
        Cameras.from_matrices(pose, pose, 8, 6)


def test_what_is_not_rigid_makes_no_camera():
    lens = [[8.0, 0, 4], [0, 8, 3], [0, 0, 1]]
    turned = Cameras.look_at([[0.3, -0.4, -3.0]], width=8, height=6).world_to_camera[0]
    column_major = turned.T
    for pose, problem in (
        (2 * torch.eye(4), r"matrix 0 has the last row \[0.0, 0.0, 0.0, 2.0\]"),
        (2 * torch.eye(4)[:3], r"matrix 0 scales or shears: .* lengths 2, 2, 2$"),
        (torch.eye(4)[[0, 1, 0, 3]], "matrix 0 scales or shears"),
        (torch.diag(torch.tensor([1.0, -1, 1, 1])), r"matrix 0 mirrors\. .*diag\(\[1, -1, -1, 1\]"),
        (column_major, "matrix 0 has the last row .*; transpose it if it is column-major"),
        (torch.full((4, 4), torch.nan), "matrix 0 is not finite"),
        (torch.stack([turned, -turned]), "matrix 1 "),
    ):
        with pytest.raises(ValueError, match=problem):
            Cameras.from_matrices(pose, lens, 8, 6)


def test_rounded_matrices_are_rigid():
    lens = [[8.0, 0, 4], [0, 8, 3], [0, 0, 1]]
    generator = torch.Generator().manual_seed(0)
    places = torch.randn(200, 3, generator=generator, dtype=torch.float64) * 3
    exact = Cameras.look_at(places, width=8, height=6).world_to_camera
    for rounded in ((exact * 1000).round() / 1000, exact.float(), exact.half(), exact.bfloat16()):
        assert len(Cameras.from_matrices(rounded, lens, 8, 6)) == 200


@pytest.mark.unchecked
def test_arguments_of_another_kind_are_refused_with_the_remedy(splat_file):
    splats, camera, model = random_splats(2), front_camera(), load(splat_file)
    for call, problem in (
        (lambda: render(model, "orbit"), "cameras: expected Cameras, found str"),
        (lambda: render(splats, 3), "cameras: expected Cameras, found int"),
        (lambda: render(splats, [camera, "orbit"]), "cameras: expected Cameras, found str"),
        (lambda: render("splats.ply", camera), "source: expected a Model or Splats, found str"),
        (lambda: render(camera, splats), "source: expected a Model or Splats, found Cameras"),
        (lambda: model.camera_path("circle"), "camera_path: no 'circle'"),
        (lambda: model.camera_path("orbits"), "camera_path: no 'orbits'. Did you mean 'orbit'"),
        (lambda: model.cameras("test"), "cameras: no 'test'"),
    ):
        with pytest.raises(ConfigError, match=problem) as caught:
            call()
        assert caught.value.advice
    for field in ("means", "opacities", "quats"):
        wrong = replace(splats, **{field: getattr(splats, field).numpy()})
        with pytest.raises(ValueError, match=f"splats.{field}: expected a torch tensor, found nd"):
            render(wrong, camera)


def test_a_camera_looks_at_its_target_with_the_given_angle():
    cameras = Cameras.look_at([[3, 0, 0], [0, 0, 4]], (1, 0, 0), width=40, height=20)
    torch.testing.assert_close(cameras.centers, torch.tensor([[3.0, 0, 0], [0, 0, 4]]))
    middle = cameras.world_to_camera @ torch.tensor([1.0, 0, 0, 1])
    torch.testing.assert_close(middle[:, :2], torch.zeros(2, 2), rtol=0, atol=1e-6)
    assert bool((middle[:, 2] > 0).all())
    angle = 2 * math.degrees(math.atan(20 / float(cameras.intrinsics[0, 0, 0])))
    assert angle == pytest.approx(50, abs=1e-3)
    up = cameras.world_to_camera[:, :3, :3] @ torch.tensor([0.0, -1, 0])
    assert bool((up[:, 1] < 0).all()), "up in the world is up in the image"
    with pytest.raises(ValueError, match="straight along up"):
        Cameras.look_at([0, -3, 0], width=4, height=4)
    with pytest.raises(ValueError, match="field_of_view: expected 0 to 180 degrees, found 180"):
        Cameras.look_at([0, 0, -3], width=4, height=4, field_of_view=180.0)


@pytest.fixture
def splat_file(tmp_path) -> Path:
    """A PLY far from the origin, of a unit of its own, as georeferenced captures are."""

    splats = random_splats(40, degree=1, seed=2).map(torch.Tensor.double)
    moved = replace(splats, means=100 * splats.means + torch.tensor([3e4, -2e4, 1e3]).double())
    assert moved.scales is not None
    path = tmp_path / "splats.ply"
    PlyExporter().write(path, SplatFile(replace(moved, scales=100 * moved.scales)))
    return path


@pytest.mark.unchecked
def test_a_splat_file_is_loaded_and_saved_in_its_own_world(splat_file, tmp_path):
    model = load(splat_file)
    assert model.num_gaussians == 40
    assert model.splats().means.mean(0).tolist() == pytest.approx([3e4, -2e4, 1e3], abs=300)
    low, high = model.bounds
    assert bool((model.splats().means.double() > low).any())
    assert bool((high > low).all())
    for name in ("again.ply", "again.gsfw"):
        again = load(model.save(tmp_path / name))
        torch.testing.assert_close(again.splats().means, model.splats().means)
        assert isinstance(again.splats().colors, Sh)
        camera = model.cameras()[3]
        torch.testing.assert_close(
            again.render(camera, background="white", depth=True).depth,
            model.render(camera, background="white", depth=True).depth,
            rtol=1e-3, atol=1e-3,
        )  # fmt: skip


@pytest.mark.unchecked
def test_a_model_and_its_splats_render_the_same_image_and_depth(tmp_path):

    path = tmp_path / "splats.ply"
    splats = random_splats(40, degree=1, seed=2).map(torch.Tensor.double)
    assert splats.scales is not None
    PlyExporter().write(path, SplatFile(replace(splats, scales=5 * splats.scales)))
    model = load(path)
    cameras = model.camera_path("orbit", frames=3, width=32)
    assert (len(cameras), cameras.width) == (3, 32)
    own = render(model, cameras, depth=True)
    other = render(model.splats(), cameras, depth=True)
    torch.testing.assert_close(own.color, other.color, rtol=0, atol=1e-3)
    torch.testing.assert_close(own.depth, other.depth, rtol=1e-3, atol=1e-3)
    assert own.statistics.visible.shape == (3, 40)
    assert not own.color.requires_grad


def test_each_camera_of_a_render_has_splats_of_its_own(splat_file, monkeypatch):
    model = load(splat_file)
    trained, seen = model._composition.parts.model, []

    def splats(time=None, cameras=None):
        seen.append(cameras.centers[0])
        return type(trained).splats(trained, time, cameras)

    monkeypatch.setattr(trained, "splats", splats)
    model.render(model.cameras()[:3])
    assert len({tuple(center.tolist()) for center in seen}) == 3


def test_wrong_files_are_refused_with_the_remedy(splat_file, tmp_path):
    with pytest.raises(DataError, match=r"no run or splat file .*splats.pyl. Did you mean 'splats"):
        load(tmp_path / "splats.pyl")
    with pytest.raises(ConfigError, match=r"no exporter writes files that end in '.stl'"):
        load(splat_file).save(tmp_path / "mesh.stl")
    with pytest.raises(ConfigError, match="Paths need a moving model"):
        load(splat_file).save(tmp_path / "paths.npz")
    for time, cause in ((0.5, "holds splats at all times"), (2.0, r"expected a time in")):
        with pytest.raises(ConfigError, match=cause):
            load(splat_file).save(tmp_path / "page.html", time=time)
    with pytest.raises(ConfigError, match=r"antialias is a model's own setting"):
        render(load(splat_file), load(splat_file).cameras()[0], antialias=True)


@pytest.mark.parametrize("time", [2.0, -0.1, math.nan])
def test_a_time_out_of_range_is_refused_wherever_a_model_takes_one(splat_file, time):
    model = load(splat_file)
    cameras = model.cameras()[:1]
    for ask in (
        lambda: model.splats(time),
        lambda: model.render(cameras, time=time),
        lambda: model.camera_path(frames=3, time=time),
        lambda: model.save("never.ply", time=time),
    ):
        with pytest.raises(ConfigError, match=rf"time={time:g}: expected a time in \[0, 1\]"):
            ask()


def test_a_format_that_cannot_hold_a_model_is_named(splat_file, tmp_path, monkeypatch):
    def write(self, path, source):
        raise ValueError("its rows are many")

    monkeypatch.setattr(CompressedPlyExporter, "write", write)
    with pytest.raises(DataError, match="format compressed-ply cannot hold this model: its rows"):
        load(splat_file).save(tmp_path / "a.compressed.ply")


def test_a_notebook_shows_the_first_images_of_a_render():
    camera = front_camera()
    many = Cameras.cat([camera] * 10)
    shown = render(random_splats(2), many)._repr_html_()
    assert shown.count('<img src="data:image/webp;base64,') == 8
    assert f"10 images of {camera.width} x {camera.height} pixels; the first 8 of them" in shown
    assert render(random_splats(2), camera)._repr_html_().startswith("<div>1 image of ")
    one_channel = replace(random_splats(2), colors=torch.ones(2, 1))
    assert render(one_channel, camera)._repr_html_().count("<img") == 1


def test_a_model_of_a_file_can_be_copied_and_crosses_to_another_process(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    PlyExporter().write(Path("a.ply"), SplatFile(random_splats(20)))
    model = load("a.ply", device="cpu")
    monkeypatch.chdir(tmp_path.parent)
    camera = model.cameras()[0]
    for copy in (deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert copy.device == model.device
        assert torch.equal(copy.render(camera).color, model.render(camera).color)


def test_a_model_whose_file_is_gone_says_so_where_it_arrives(tmp_path):
    PlyExporter().write(tmp_path / "a.ply", SplatFile(random_splats(20)))
    crossing = pickle.dumps(load(tmp_path / "a.ply"))
    (tmp_path / "a.ply").unlink()
    with pytest.raises(DataError, match=r"a\.ply"):
        pickle.loads(crossing)
