"""Depth maps, from files to batches."""

import numpy as np
import pytest
import torch
from PIL import Image
from support.small_captures import HEIGHT, WIDTH, request, ring, write_images, write_transforms

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.datamanagers.undistortion import LensRule

CPU = torch.device("cpu")
MILLIMETRES = np.tile(1000 + 10 * np.arange(WIDTH, dtype=np.uint16), (HEIGHT, 1))
"""Depths of an image, which grow by 10 from column to column."""


def write(folder, depths=MILLIMETRES, frames=(0, 1, 2, 3), name="depth.png", **settings):
    """A transforms.json whose frames share a depth map."""
    write_images(folder, ring())
    if name.endswith(".npy"):
        np.save(folder / name, depths)
    else:
        Image.fromarray(depths).save(folder / name)
    own = [{"depth_file_path": name} if number in frames else {} for number in range(4)]
    write_transforms(folder / "transforms.json", ring(), own, **settings)
    return folder


def build(path, depth=True, **settings):
    return TransformsConfig(depth=depth).build(request(path, **settings))


def load(data, indices=(0,)):
    """The depths of a batch in units of the world."""
    (batch,) = data.load(Split.TRAIN, list(indices), CPU)
    depth = batch.maps["depth"]
    assert depth.values.shape == depth.known.shape == (*batch.images.shape[:3], 1)
    assert depth.values.dtype is torch.float32
    assert torch.equal(depth.values > 0, depth.known)
    return data.scene.world_from_scene.scale * depth.values[..., 0].numpy()


def failure(path) -> str:
    with pytest.raises(DataError) as error:
        load(build(path))
    return str(error.value)


def test_depths_are_metres_of_the_world_in_units_of_the_scene(tmp_path):
    data = build(write(tmp_path))
    assert np.allclose(load(data)[0], MILLIMETRES / 1000, rtol=1e-6)
    assert "per-view map depth: 1 channel, resampled by depth" in data.notes()
    assert data.views(Split.TRAIN).maps == {"depth": 1}
    data.close()


def test_depths_are_loaded_only_where_asked_for(tmp_path):
    data = build(write(tmp_path), depth=False)
    (batch,) = data.load(Split.TRAIN, [0], CPU)
    assert batch.maps == {}
    assert "4 frames have depth maps: not used (datamanager.depth=true loads them)" in data.notes()
    (tmp_path / "depth.png").unlink()
    build(tmp_path, depth=False)


def test_the_unit_may_be_said(tmp_path):
    data = build(write(tmp_path, depth_unit_scale_factor=0.01))
    assert np.allclose(load(data)[0], MILLIMETRES / 100, rtol=1e-6)


def test_numpy_files_are_read_and_what_is_not_finite_is_unknown(tmp_path):
    depths = np.full((HEIGHT, WIDTH, 1), 2.0, np.float32)
    depths[0, :3, 0] = np.nan, np.inf, -1
    found = load(build(write(tmp_path, depths, name="d.npy", depth_unit_scale_factor=1.0)))[0]
    assert found[0, :4].tolist() == pytest.approx([0, 0, 0, 2])


def test_smaller_maps_give_each_pixel_the_nearest(tmp_path):
    found = load(build(write(tmp_path, MILLIMETRES[::2, ::2].copy())))[0]
    assert np.allclose(found, np.repeat(MILLIMETRES[:, ::2], 2, axis=1) / 1000, rtol=1e-6)


def test_shrunk_images_have_the_mean_of_what_is_known(tmp_path):
    depths = MILLIMETRES.copy()
    depths[0, 0] = 0
    depths[2:4, :2] = 0
    depths[2, 0] = 1000
    found = load(build(write(tmp_path, depths), downscale=2.0))[0]
    assert found.shape == (HEIGHT // 2, WIDTH // 2)
    assert found[0, 0] == pytest.approx((1.0 + 1.01 + 1.01) / 3)
    assert found[1, 0] == 0
    assert found[5, 4] == pytest.approx((1.08 + 1.09) / 2)


def test_depths_follow_an_undistorted_image(tmp_path):
    data = build(write(tmp_path, k1=-0.2, k2=0.05))
    found = load(data)[0]
    undistortion = data.recording.frames[0].undistortion(LensRule())
    target = undistortion.target
    assert found.shape == (target.height, target.width)
    y, x = np.mgrid[: target.height, : target.width].reshape(2, -1) + 0.5
    source, _ = undistortion.look(np.stack([x, y], axis=1))
    # A pixel's depth is that of the nearest one: at most half a column away.
    exact = 1 + 0.01 * (source[:, 0].reshape(found.shape) - 0.5)
    assert np.abs(found - exact).max() < 0.0056


def test_images_without_depth_share_a_batch_as_unknown(tmp_path):
    data = build(write(tmp_path, frames=(0, 2)))
    found = load(data, (0, 1))
    assert found[0].min() > 0.99
    assert found[1].max() == 0
    assert load(data, (1, 3)).max() == 0
    assert "per-view map depth: 1 channel, resampled by depth, in 2 of 4 views" in data.notes()


@pytest.mark.parametrize(
    ("depths", "message"),
    [
        (
            np.zeros((HEIGHT, HEIGHT), np.uint16),
            "depth.png: the map is 48x48 pixels with 1 channel",
        ),
        (np.zeros((HEIGHT, WIDTH, 3), np.uint8), "depth.png has 3 channels."),
    ],
)
def test_maps_that_do_not_fit_are_refused(tmp_path, depths, message):
    assert message in failure(write(tmp_path, depths))


def test_malformed_files_are_refused(tmp_path):
    write(tmp_path, MILLIMETRES.astype(np.float32), name="d.npy")
    np.save(tmp_path / "d.npy", np.zeros((2, 3, 4)))
    assert "d.npy has 4 channels.\nExpected one depth for each pixel." in failure(tmp_path)
    (tmp_path / "d.npy").write_bytes(b"no numbers")
    assert "d.npy cannot be read" in failure(tmp_path)
    (tmp_path / "d.npy").unlink()
    assert "its depth map d.npy is not on disk." in failure(tmp_path)
    assert "remove depth_file_path to train without it." in failure(tmp_path)
    assert "depth_unit_scale_factor: expected a number above 0, found -1.0." in failure(
        write(tmp_path, depth_unit_scale_factor=-1.0)
    )
