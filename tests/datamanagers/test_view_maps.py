"""Per-view maps of any content, from folders and formats to the batches that methods get."""

import csv
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from PIL import Image
from support.slow_ship import SlowShip
from support.small_captures import (
    HEIGHT,
    WIDTH,
    request,
    ring,
    write_colmap,
    write_images,
    write_transforms,
)

from gsfw.core.batch import Resampling, ViewMap
from gsfw.core.config import Detection
from gsfw.core.datamanager import Split, WrappedDataManager
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.loop.area import shrink_batch
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.frames import Frame, Recording, no_points
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.map_file import MapFile
from gsfw.datamanagers.transforms import TransformsConfig

CPU = torch.device("cpu")
X, Y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
PLACES = np.stack([X, Y, X + Y], axis=2).astype(np.float32)
"""A map [h, w, 3] that says where its pixels are; linear, so that means are exact."""


@pytest.fixture
def folder(tmp_path):
    """A COLMAP data set of four pinhole images."""
    write_images(tmp_path / "images", ring())
    write_colmap(tmp_path / "sparse/0", ring())
    return tmp_path


def write_maps(folder, values=PLACES, extension=".npy", views=range(4)):
    folder.mkdir(parents=True, exist_ok=True)
    for view in views:
        path = folder / f"view_{view:03d}{extension}"
        if extension == ".npy":
            np.save(path, values)
        elif extension == ".npz":
            np.savez_compressed(path, values=values)
        else:
            Image.fromarray(values).save(path)


def opened(path, *maps, config=ColmapConfig, downscale=1.0, **settings):
    return config(maps=maps, **settings).build(request(path, downscale=downscale))


def only(data, name="m", views=(0,)) -> ViewMap:
    (batch,) = data.load(Split.TRAIN, list(views), CPU)
    found = batch.maps[name]
    assert found.values.shape[:3] == found.known.shape[:3] == batch.images.shape[:3]
    assert bool((found.values[~found.known.expand_as(found.values)] == 0).all())
    return found


def refusal(path, *maps, error=DataError, **settings) -> str:
    with pytest.raises(error) as caught:
        opened(path, *maps, **settings).load(Split.TRAIN, [0], CPU)
    return str(caught.value)


@pytest.mark.parametrize("extension", [".npy", ".npz"])
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.int32])
def test_arrays_reach_the_batch_as_they_are(folder, extension, dtype):
    write_maps(folder / "f", PLACES.astype(dtype), extension)
    data = opened(folder, "m:f")
    found = only(data)
    assert found.values.dtype is torch.float32
    assert np.array_equal(found.values[0].numpy(), PLACES.astype(dtype))
    assert bool(found.known.all())
    assert data.views(Split.TRAIN).maps == data.views(Split.EVAL).maps == {"m": 3}
    assert "per-view map m: 3 channels, resampled by mean" in data.notes()


def test_means_of_images_lie_between_0_and_1_and_labels_stay(folder):
    values = np.tile(np.arange(WIDTH, dtype=np.uint8), (HEIGHT, 1))
    write_maps(folder / "a", np.repeat(values[..., None], 3, axis=2), ".png")
    write_maps(folder / "b", 1000 * values.astype(np.uint16), ".png")
    write_maps(folder / "c", values.astype(np.float32), ".tiff")
    write_maps(folder / "d", values, ".png.png")
    data = opened(folder, "a:a", "b:b", "c:c:mean", "d:d:nearest", "e:d:nearest:0.5")
    assert data.views(Split.TRAIN).maps == {"a": 3, "b": 1, "c": 1, "d": 1, "e": 1}
    row = {name: only(data, name).values[0, 0, :, 0].numpy() for name in "abcde"}
    assert np.allclose(row["a"], values[0] / 255, rtol=1e-6)
    assert np.allclose(row["b"], 1000 * values[0].astype(float) / 65535, rtol=1e-6)
    for name, factor in {"c": 1, "d": 1, "e": 0.5}.items():
        assert np.array_equal(row[name], factor * values[0])


@pytest.mark.parametrize(("rule", "downscale"), [("mean", 1.0), ("mean", 2.0), ("nearest", 3.0)])
def test_maps_of_another_size_are_resampled_to_the_image_by_their_rule(folder, rule, downscale):
    # A map at an eighth of the size: pixel centres at 4, 12, ...; enlarged within these exactly.
    write_maps(folder / "f", PLACES[4::8, 4::8] - np.float32([0.5, 0.5, 1]))
    values = only(opened(folder, f"m:f:{rule}", downscale=downscale)).values[0].numpy()
    sides = zip((WIDTH, HEIGHT), values.shape[1::-1], strict=True)
    x, y = np.meshgrid(*((np.arange(new) + 0.5) * old / new for old, new in sides))
    expected = np.stack([x, y, x + y], axis=2)
    if rule == "nearest":
        expected[..., :2] = 8 * np.floor(expected[..., :2] / 8) + 4
        expected[..., 2] = expected[..., 0] + expected[..., 1]
    inner = (x > 4) & (x < WIDTH - 4) & (y > 4) & (y < HEIGHT - 4)
    assert np.abs(values - expected)[inner].max() < 1e-3


def test_maps_larger_than_the_image_are_shrunk(folder):
    large = np.repeat(np.repeat(PLACES, 2, axis=0), 2, axis=1)
    write_maps(folder / "f", large)
    assert np.allclose(only(opened(folder, "m:f")).values[0], PLACES, atol=1e-4)


def test_small_maps_stay_small_in_the_cache_and_in_half_precision(folder):
    write_maps(folder / "f", np.ones((HEIGHT // 8, WIDTH // 8, 16), np.float16))
    data = opened(folder, "m:f")
    image = data._decode(0)
    assert image.maps["m"].values.shape == (HEIGHT // 8, WIDTH // 8, 16)
    assert image.maps["m"].values.dtype == np.float16
    stored = [
        image.pixels,
        *(part for m in image.maps.values() for part in (m.values, m.known)),
    ]
    assert sum(part.nbytes for part in stored) == data._loader._cache.sizes[0]
    assert only(data).values.shape == (1, HEIGHT, WIDTH, 16)


@pytest.mark.parametrize("downscale", [1.0, 2.5])
def test_maps_follow_distorted_lenses_as_the_image_does(tmp_path, downscale):
    write_images(tmp_path, ring())
    write_transforms(tmp_path / "transforms.json", ring(), k1=-0.2, k2=0.05)
    write_maps(tmp_path / "f")
    write_maps(tmp_path / "quarter", PLACES.reshape(12, 4, 16, 4, 3).mean(axis=(1, 3)))
    data = opened(tmp_path, "m:f", "q:quarter", config=TransformsConfig, downscale=downscale)
    camera = data.views(Split.TRAIN).cameras[0]
    # The lens leads from each undistorted pixel to where it lay, which is what the map says.
    (fx, _, cx), (_, fy, cy), _ = camera.intrinsics[0].double().numpy()
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    slopes = np.stack([(x - cx) / fx, (y - cy) / fy], axis=-1).reshape(-1, 2)
    wanted = data.recording.frames[0].lens.project(slopes).reshape(*x.shape, 2)
    for name, tolerance in {"m": 0.1, "q": 0.25}.items():
        found = only(data, name)
        inner = (slice(6, -6), slice(6, -6))
        error = np.abs(found.values[0, ..., :2].numpy() - wanted)[inner]
        assert error.max() < tolerance, name


@pytest.mark.parametrize("mode", ["ignore", "empty"])
def test_maps_are_unknown_outside_masks_and_not_mixed_with_what_is_there(folder, mode):
    inside = np.zeros((HEIGHT, WIDTH), np.uint8)
    inside[:, :31] = 255
    write_maps(folder / "masks", inside, ".png")
    write_maps(folder / "f", np.where(inside[..., None] > 0, 1.0, 100.0).astype(np.float32))
    for downscale, known in ((1.0, 31), (2.0, 15)):
        found = only(opened(folder, "m:f", mask_mode=mode, downscale=downscale))
        assert bool((found.known[0, :, :, 0].sum(dim=1) == known).all())
        assert found.values.max() == 1


def test_numbers_that_are_not_finite_are_unknown(folder):
    values = np.ones((HEIGHT // 2, WIDTH // 2, 2), np.float32)
    values[3, 4, 1], values[5, 6, 0] = np.nan, np.inf
    write_maps(folder / "f", values)
    for rule in ("mean", "nearest"):
        found = only(opened(folder, f"m:f:{rule}"))
        assert found.values.max() == 1
        assert not bool(found.known[0, 6:8, 8:10].any())
        assert not bool(found.known[0, 10:12, 12:14].any())
        assert bool(found.known[0, 20:].all())


def test_depth_folders_hold_millimetres_or_units_of_the_world_or_what_is_said(folder):
    write_maps(folder / "whole", np.full((HEIGHT, WIDTH), 1500, np.uint16), ".png")
    write_maps(folder / "real", np.full((HEIGHT, WIDTH), 1.5, np.float16), views=(1, 2))
    for spec in ("depth:whole", "depth:real", "depth:whole:depth:0.001", "z:real:depth"):
        data = opened(folder, spec)
        found = only(data, spec.partition(":")[0], views=(0, 1))
        scale = data.scene.world_from_scene.scale
        assert np.allclose(scale * found.values[1], 1.5, rtol=1e-5)
        assert bool(found.known[0].any()) == ("whole" in spec)


@pytest.mark.parametrize("budget", [0, 1])
def test_maps_cross_to_a_device_and_may_stay_there(folder, budget):
    write_maps(folder / "f", PLACES[::8, ::8].copy())
    write_maps(folder / "l", np.ones((HEIGHT, WIDTH), np.uint8), ".png", views=(1,))
    data = opened(folder, "m:f", "depth:l")
    expected = data.load(Split.TRAIN, [0, 1, 2, 3], CPU)
    data._loader._way_to = lambda device: SlowShip()
    data._loader._kept = frozenset(range(4)) if budget else frozenset()
    data._loader._cameras = {}
    for _ in range(2):
        for one, other in zip(data.load(Split.TRAIN, [0, 1, 2, 3], CPU), expected, strict=True):
            for name, item in other.maps.items():
                assert torch.equal(one.maps[name].values, item.values)
                assert torch.equal(one.maps[name].known, item.known)
                assert one.maps[name].rule is item.rule
    data.close()


def test_views_without_a_map_are_named_unless_it_is_depth(folder):
    write_maps(folder / "f", views=(0, 2))
    message = refusal(folder, "m:f")
    assert "2 of 4 views have no map 'm': view_001.png, view_003.png." in message
    depth = np.ones((HEIGHT, WIDTH), np.float32)
    write_maps(folder / "d", depth, views=(0, 2))
    found = only(opened(folder, "m:d:depth"), views=(0, 1))
    assert [bool(part.any()) for part in found.known] == [True, False]


def test_folders_that_do_not_fit_are_refused(folder):
    assert "there is no folder" in refusal(folder, "m:f")
    write_maps(folder / "f", np.moveaxis(PLACES, 2, 0))
    assert "the map is 48x3 pixels with 64 channels, its image is 64x48" in refusal(folder, "m:f")
    write_maps(folder / "f")
    np.save(folder / "f/view_002.npy", PLACES[..., :2])
    assert "view_002.npy has 2 channels, other files of the map 'm' have 3." in refusal(
        folder, "m:f"
    )
    np.save(folder / "f/view_002.npy", PLACES.astype(complex))
    assert "view_002.npy holds complex128 numbers of the shape [48, 64, 3]." in refusal(
        folder, "m:f"
    )
    (folder / "f/view_002.npy").write_bytes(b"no array")
    assert "view_002.npy cannot be read" in refusal(folder, "m:f")
    np.savez(folder / "f/view_002.npz", a=PLACES, b=PLACES)
    (folder / "f/view_002.npy").unlink()
    assert "view_002.npz holds 2 arrays (a.npy, b.npy)." in refusal(folder, "m:f")
    (folder / "exr").mkdir()
    (folder / "exr/view_000.exr").touch()
    message = refusal(folder, "m:exr")
    assert "contains no map of any image (looked for view_000.npy or view_000.png.npy" in message
    assert "convert .exr files: .npy, .npz, .png" in message


@pytest.mark.parametrize(
    "text", ["f", "m:", ":f", "m:f:median:2", "m:f:mean:", "m:f:depth:-1", "3:f"]
)
def test_settings_that_are_no_map_are_refused(folder, text):
    if text == "m:f:median:2":  # It is a folder's name.
        assert "there is no folder" in refusal(folder, text)
        return
    assert f"datamanager.maps={text}: expected NAME:FOLDER" in refusal(
        folder, text, error=ConfigError
    )


def test_a_name_is_used_once(folder):
    assert "a name is used twice" in refusal(folder, "m:f", "m:g", error=ConfigError)


@dataclass
class RgbdConfig(CaptureConfig):
    """A third-party format with depth and confidence: it lists its files, and that is all."""

    @classmethod
    def detect(cls, path):
        return Detection((path / "cams.csv").is_file(), "cams.csv")

    def recording(self, path, downscale):
        frames = []
        with (path / "cams.csv").open() as lines:
            for name, k1, *pose in csv.reader(lines):
                lens = Lens(
                    *(70.0, 72.0, 31.0, 25.5, WIDTH, HEIGHT, "cams.csv", "RADIAL"), (float(k1), 0.0)
                )
                maps = {
                    "depth": MapFile(path / f"depth/{name}.npy", Resampling.DEPTH),
                    "confidence": MapFile(path / f"conf/{name}.npy", Resampling.NEAREST),
                }
                matrix = torch.tensor([float(p) for p in pose], dtype=torch.float64).view(4, 4)
                image = path / f"{name}.png"
                frames.append(Frame(name, image, read_header(image), lens, matrix, maps=maps))
        return Recording(path.name, path, tuple(frames), *no_points())


def test_a_format_of_a_plugin_lists_maps_and_gets_them_fitted(tmp_path):
    capture = ring()
    write_images(tmp_path, capture)
    depth = (1 + X / 50).astype(np.float32)
    depth[:10] = 0
    write_maps(tmp_path / "depth", depth)
    write_maps(tmp_path / "conf", (X > 20).astype(np.uint8)[::2, ::2])
    inside = np.full((HEIGHT, WIDTH), 255, np.uint8)
    inside[:, 50:] = 0
    write_maps(tmp_path / "masks", inside, ".png")
    rows = [[f"view_{i:03d}", -0.05, *p.flatten()] for i, p in enumerate(capture.poses)]
    with (tmp_path / "cams.csv").open("w") as file:
        csv.writer(file).writerows(rows)
    data = RgbdConfig().build(request(tmp_path, downscale=2.0))
    assert data.views(Split.TRAIN).maps == {"depth": 1, "confidence": 1}
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    width, height = batch.cameras.width, batch.cameras.height
    for size in (1, 2):  # At full size, and as the resolution schedule shrinks it.
        small = shrink_batch(batch, width // size, height // size)
        depth_map, confidence = small.maps["depth"], small.maps["confidence"]
        rendered = torch.full_like(depth_map.values, 1.5 / data.scene.world_from_scene.scale)
        loss = depth_map.mean((rendered - depth_map.values).abs() * confidence.values)
        assert 0 < float(loss) < 1
        assert set(confidence.values.unique().tolist()) == {0.0, 1.0}
        assert not bool((depth_map.known & ~small.valid).any())
        world = data.scene.world_from_scene.scale * depth_map.values
        column = world[0, -4, :, 0]
        known = column > 0
        assert bool((column[known].diff() > 0).all())
        assert 1 < float(column[known].min()) < float(column.max()) < 2.1


class WithFeatures(WrappedDataManager):
    """A third-party data manager that adds a map to any other one."""

    def views(self, split):
        views = super().views(split)
        return replace(views, maps={**views.maps, "features": 4})

    def load(self, split, indices, device):
        return [self._with(batch) for batch in super().load(split, indices, device)]

    def _with(self, batch):
        values = batch.images.mean(dim=-1, keepdim=True).expand(-1, -1, -1, 4)
        return replace(batch, maps={**batch.maps, "features": ViewMap.of(values)})


def test_a_wrapped_data_manager_adds_a_map_and_forwards_all_else(folder):
    given = opened(folder)
    data = WithFeatures(given)
    assert data.views(Split.TRAIN).maps == {"features": 4}
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    small = shrink_batch(batch, 10, 8)
    expected = small.images.mean(dim=-1, keepdim=True).expand(-1, -1, -1, 4)
    torch.testing.assert_close(small.maps["features"].values, expected)
    assert data.notes() == given.notes()
    assert data.scene is given.scene
    assert data.moving_mask(Split.TRAIN, 0) is None
    data.prefetch(Split.TRAIN, [2])
    data.close()
