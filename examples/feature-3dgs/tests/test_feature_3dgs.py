"""Features are trained, searched, exported, and read from maps of the data."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from gsfw_feature_3dgs.export import Npz
from gsfw_feature_3dgs.extractors import ColorTerms, find_extractor
from gsfw_feature_3dgs.images import heat
from gsfw_feature_3dgs.maps import run as run_features
from PIL import Image

from gsfw.api import ConfigError, Sh, SplatFile, Splats
from gsfw.testing import conformance

test_method_conforms = conformance("method", "feature-3dgs")
test_query_conforms = conformance("command", "query")
test_features_conforms = conformance("command", "features")
# The kit's exporters write splats without features, which this one refuses.

SCENE = (
    *("datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=48"),
    *("datamanager.height=36", "datamanager.points=400", "device=cpu", "report=false"),
    *("steps=120", "features_lr=0.02"),  # A run of few steps learns fast.
)


def gsfw(*arguments):
    command = [sys.executable, "-m", "gsfw", *arguments, "json=true"]
    here = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    found = subprocess.run(command, check=False, capture_output=True, text=True, env=here)
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout)


class Wide(ColorTerms):
    """An extractor with more channels than a Gaussian of the test has, at half of the size."""

    channels = 22

    def features(self, images):
        return super().features(images[:, ::2, ::2]).repeat(1, 1, 1, 2)

    def words(self, text):
        return ColorTerms().words(text).repeat(2)


class Unused(ColorTerms):
    """An extractor that must not be asked for features."""

    def features(self, images):
        raise AssertionError("the data has feature maps")


class Unopened(ColorTerms):
    """A class that a foreign file may name, and that must not be constructed."""

    def __init__(self):
        raise AssertionError("it was constructed")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("feature") / "run"
    return out, gsfw("train", "method=feature-3dgs", *SCENE, f"out={out}")


def test_features_of_held_out_views_are_learned(run):
    assert run[1]["feature_cosine"] > 0.8


def test_a_query_finds_a_place_and_writes_heat_maps(run):
    found = gsfw("query", str(run[0]), "text=blue")
    assert len(found["place"]) == 3
    assert len(list((run[0] / "query").glob("*.png"))) == len(found["views"]) == 2


def test_a_point_finds_what_resembles_it(run):
    found = gsfw("query", str(run[0]), "point=0.72,0.48,0.6", f"out={run[0] / 'near'}")
    assert found["similarity"] > 0.6


def test_the_export_has_a_feature_for_each_gaussian(run, tmp_path):
    gsfw("export", str(run[0]), "format=features", f"out={tmp_path / 'all.npz'}")
    stored = np.load(tmp_path / "all.npz")
    assert stored["features"].shape == (len(stored["means"]), 11)


def test_a_file_is_opened_and_exported_without_constructing_what_its_settings_name(run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run[0], copy)
    for file in copy.glob("*.y*ml"):
        text = file.read_text(encoding="utf-8")
        changed = text.replace("extractor: colors", "extractor: test_feature_3dgs:Unopened")
        file.write_text(changed, encoding="utf-8")
    gsfw("export", str(copy), "format=gsfw", f"out={tmp_path / 'model.gsfw'}")
    assert b"test_feature_3dgs:Unopened" in (tmp_path / "model.gsfw").read_bytes()
    gsfw("export", str(tmp_path / "model.gsfw"), f"out={tmp_path / 'splats.ply'}")


def test_maps_with_more_channels_are_decoded_also_from_a_model_file(tmp_path):
    run, wide = tmp_path / "run", "extractor=test_feature_3dgs:Wide"
    summary = gsfw("train", "method=feature-3dgs", *SCENE, wide, "width=6", f"out={run}")
    assert summary["feature_cosine"] > 0.7
    gsfw("export", str(run), "format=gsfw", f"out={tmp_path / 'model.gsfw'}")
    found = gsfw("query", str(tmp_path / "model.gsfw"), "text=blue", f"out={tmp_path / 'heat'}")
    assert found["place"] == gsfw("query", str(run), "text=blue")["place"]


def capture(folder, views=5, width=24, height=18):
    """A capture of noise in nerfstudio's format, from cameras in a row."""
    generator = np.random.default_rng(0)
    (folder / "images").mkdir(parents=True)
    lens = {"fl_x": 20, "fl_y": 20, "cx": width / 2, "cy": height / 2, "w": width, "h": height}
    frames = []
    for view in range(views):
        pixels = generator.integers(0, 255, (height, width, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(folder / "images" / f"{view}.png")
        pose = np.eye(4)
        pose[:3, 3] = 0.1 * view, 0.05 * view**2, 4.0
        frames.append({"file_path": f"images/{view}.png", "transform_matrix": pose.tolist()})
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))


def test_feature_maps_in_files_take_the_place_of_the_extractor(tmp_path):
    capture(tmp_path / "noise")
    images, maps = tmp_path / "noise" / "images", tmp_path / "noise" / "features"
    assert run_features([f"images={images}", f"out={maps}", "json=true"]) == 0
    assert np.load(maps / "3.npy").shape == (18, 24, 11)
    summary = gsfw(
        *("train", "method=feature-3dgs", f"data={tmp_path / 'noise'}", "device=cpu", "steps=3"),
        *("datamanager.maps=features:features", "extractor=test_feature_3dgs:Unused"),
        *("init=random", "random_points=60", "report=false", f"out={tmp_path / 'run'}"),
    )
    assert 0 <= summary["feature_cosine"] < 1


def test_the_export_refuses_splats_without_features_or_with_nan(tmp_path):
    splats = Splats(
        torch.zeros(3, 3), torch.ones(3), Sh(torch.zeros(3, 1, 3), 0), torch.ones(3, 4),
        torch.ones(3, 3),
    )  # fmt: skip
    with pytest.raises(ValueError, match="method=feature-3dgs"):
        Npz().write(tmp_path / "a.npz", SplatFile(splats))
    broken = replace(splats, extra=torch.tensor([[0.0], [torch.nan], [0.0]]))
    with pytest.raises(ValueError, match="extra of row 1"):
        Npz().write(tmp_path / "a.npz", SplatFile(broken))
    assert not (tmp_path / "a.npz").exists()


def test_words_are_described_by_the_terms_that_are_nearest():
    extractor = ColorTerms()
    image = torch.tensor([[[[0.8, 0.1, 0.1], [0.1, 0.3, 0.8]]]])
    similar = extractor.features(image)[0, 0] @ extractor.words("red")
    assert float(similar[0]) > 0.7
    assert float(similar[1]) < 0.1
    assert torch.equal(extractor.words("dark"), extractor.words("black"))


def test_unknown_words_and_extractors_are_named():
    with pytest.raises(ConfigError, match="'chair'"):
        ColorTerms().words("chair")
    with pytest.raises(ConfigError, match="no_such_module"):
        find_extractor("no_such_module:Clip")
    with pytest.raises(ConfigError, match="no class with channels, features, words"):
        find_extractor("pathlib:Path")


def test_heat_rises_from_the_first_to_the_last_stop():
    colors = heat(torch.tensor([[0.0, 1.0]]))
    assert torch.allclose(colors[0], torch.tensor([[0.1, 0.1, 0.3], [0.9, 0.1, 0.1]]))
