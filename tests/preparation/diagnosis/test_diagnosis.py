"""Captures that were made to fail, from files to findings, and the words of figures."""

import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy import ndimage
from support.captured import arc, photos
from support.model_figures import figures

from gsfw.core.files.json_text import json_text
from gsfw.core.maths.camera_path import look_at
from gsfw.preparation.camera_grouping import CameraRule, group_cameras
from gsfw.preparation.diagnosis.diagnosis import Diagnosis, diagnose, words_of
from gsfw.preparation.features import FeatureSettings, extract_features
from gsfw.preparation.finding import Verdict, Weight
from gsfw.preparation.mapping.mapping import map_cameras
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.matching import match_pairs
from gsfw.preparation.pairs import MatchingRule, plan_pairs
from gsfw.preparation.source import read_source

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

Pixels = np.ndarray


@pytest.fixture(scope="module")
def sharp() -> list[Pixels]:
    return photos(arc(9))


def blurred(pixels: Pixels, sigma: float) -> Pixels:
    return ndimage.gaussian_filter(pixels, (sigma, sigma, 0))


def moved(pixels: Pixels, length: int) -> Pixels:
    """As seen by a camera that moves sideways while its shutter is open."""
    return ndimage.uniform_filter1d(pixels, length, axis=1)


def noisy(pixels: Pixels, seed: int) -> Pixels:
    noise = np.random.default_rng(seed).integers(-2, 3, pixels.shape)
    return (pixels.astype(int) + noise).clip(0, 255).astype(np.uint8)


def wall(seed: int = 0) -> Pixels:
    across = np.linspace(140, 180, 320)[None, :, None] + np.zeros((240, 1, 3))
    return noisy(across.astype(np.uint8), seed)


def bright(pixels: Pixels) -> Pixels:
    return (pixels.astype(int) * 6 + 140).clip(0, 255).astype(np.uint8)


def encoded(pixels: Pixels, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind, **options)
    return file.getvalue()


def turned_file(pixels: Pixels) -> bytes:
    """A photo that was taken sideways, and says so."""
    exif = Image.Exif()
    exif[0x0112] = 6
    return encoded(np.rot90(pixels).copy(), "JPEG", quality=95, exif=exif)


def prepare(folder: Path, files: Mapping[str, bytes | Pixels]) -> Diagnosis:
    """Run all stages that come before the diagnosis."""
    (folder / "photos").mkdir()
    for name, content in files.items():
        data = content if isinstance(content, bytes) else encoded(content, "PNG")
        (folder / "photos" / name).write_bytes(data)
    images = read_source([folder / "photos"]).images
    groups = group_cameras(images, CameraRule())
    database = folder / "work" / "database.db"
    settings = FeatureSettings(max_size=320, count=1000)
    features = extract_features(database, images, groups, settings)
    plan = plan_pairs(images, MatchingRule("exhaustive"), database)
    match_pairs(database, plan, 1)
    mapping = map_cameras(database, folder / "work" / "models", MappingRule())
    diagnosis = diagnose(database, images, groups, features, mapping)
    json_text(diagnosis.document())
    return diagnosis


def named(images: list[Pixels]) -> dict[str, Pixels]:
    return {f"{number}.png": pixels for number, pixels in enumerate(images)}


def reasons(diagnosis: Diagnosis) -> dict[str, str]:
    return {item.name: item.reason for item in diagnosis.unregistered}


def kinds(diagnosis: Diagnosis) -> dict[str, Weight]:
    return {finding.kind: finding.weight for finding in diagnosis.findings}


def test_every_image_of_a_damaged_capture_has_its_own_reason(tmp_path, sharp):
    truncated = encoded(sharp[6], "JPEG", quality=95)
    diagnosis = prepare(
        tmp_path,
        {
            "0.png": sharp[0],
            "1.png": sharp[1],
            "2.png": blurred(sharp[2], 7),
            "3.jpg": turned_file(sharp[3]),
            "4.png": moved(sharp[4], 25),
            "5.jpg": truncated[: len(truncated) // 2],
            "6.jpg": encoded(sharp[2], "PNG"),
            "7.png": sharp[5],
            "8.png": sharp[7],
            "dark.png": (sharp[6] * 0.015).astype(np.uint8),
            "empty.jpg": b"",
            "bright.png": bright(sharp[8]),
            "text.jpg": b"no image at all",
            "wall.png": wall(),
        },
    )
    assert diagnosis.registered == ("0.png", "1.png", "3.jpg", "6.png", "7.png", "8.png")
    assert reasons(diagnosis) == {
        "2.png": "blurred",
        "4.png": "motion blur",
        "5.jpg": "does not decode",
        "bright.png": "over-exposed",
        "dark.png": "too dark",
        "wall.png": "few features",
    }
    assert {item.name for item in diagnosis.left_out} == {"empty.jpg", "text.jpg"}
    assert kinds(diagnosis) == {
        "images not placed": Weight.LIMIT,
        "files left out": Weight.LIMIT,
        "motion blur": Weight.NOTE,
    }
    assert diagnosis.verdict is Verdict.LIMITED
    assert diagnosis.figures[0].startswith("6 of 12 images were placed; ")
    assert diagnosis.figures[-1].startswith("Camera 1 (SIMPLE_RADIAL, 6 images) has a focal ")


def test_a_capture_that_is_all_blurred_says_so(tmp_path, sharp):
    diagnosis = prepare(tmp_path, named([blurred(pixels, 6) for pixels in sharp[:5]]))
    assert set(reasons(diagnosis).values()) == {"blurred"}
    assert diagnosis.findings[0].found == "None of 5 images could be placed: blurred (5)."
    assert diagnosis.findings[0].advice == "Take such photos again in focus."
    assert kinds(diagnosis) == {"no cameras": Weight.STOP, "all images blurred": Weight.LIMIT}
    assert diagnosis.model is None
    assert diagnosis.figures == ()


def test_two_groups_that_show_different_things_are_told_with_a_bridge(tmp_path, sharp):
    # Features are not found again in a mirror.
    mirrored = [pixels[:, ::-1].copy() for pixels in sharp[:3]]
    diagnosis = prepare(tmp_path, named(sharp[:4] + mirrored))
    assert diagnosis.registered == ("0.png", "1.png", "2.png", "3.png")
    assert set(reasons(diagnosis).values()) == {"matched only within its group"}
    assert [(c.images, c.placed) for c in diagnosis.components] == [
        (("0.png", "1.png", "2.png", "3.png"), 4),
        (("4.png", "5.png", "6.png"), 0),
    ]
    assert kinds(diagnosis)["separate groups"] is Weight.LIMIT
    finding = next(one for one in diagnosis.findings if one.kind == "separate groups")
    assert finding.found == "The images fall into 2 groups, of 4 and 3, that hardly a match joins."
    assert finding.advice.startswith("Take photos between ")
    assert finding.advice.endswith(". If the groups show different things, prepare each by itself.")
    assert finding.images == ("4.png", "5.png", "6.png")


def test_three_images_are_placed_and_two_are_too_few(tmp_path, sharp):
    (tmp_path / "three").mkdir()
    (tmp_path / "two").mkdir()
    three = prepare(tmp_path / "three", named(sharp[:3]))
    assert len(three.registered) == 3
    assert three.verdict is Verdict.GOOD
    two = prepare(tmp_path / "two", named(sharp[:2]))
    assert two.findings[0].found == "There are only 2 images."
    assert two.verdict is Verdict.WILL_NOT_TRAIN


def test_plain_walls_have_few_features(tmp_path):
    diagnosis = prepare(tmp_path, named([wall(seed) for seed in range(4)]))
    assert set(reasons(diagnosis).values()) == {"few features"}
    assert diagnosis.unregistered[0].found == "0 features were found; at least 100 are needed."
    assert diagnosis.verdict is Verdict.WILL_NOT_TRAIN


def test_black_and_white_images_were_exposed_wrongly(tmp_path, sharp):
    dark = [(pixels * 0.015).astype(np.uint8) for pixels in sharp[:2]]
    diagnosis = prepare(tmp_path, named([*dark, *map(bright, sharp[:3])]))
    assert list(reasons(diagnosis).values()) == ["too dark"] * 2 + ["over-exposed"] * 3


def test_copies_of_one_image_are_one_view(tmp_path, sharp):
    diagnosis = prepare(tmp_path, named([noisy(sharp[0], seed) for seed in range(4)]))
    assert set(reasons(diagnosis).values()) == {"one view"}
    finding = next(one for one in diagnosis.findings if one.kind == "one view")
    assert finding.weight is Weight.STOP
    assert finding.found == (
        "4 images show 1 different view: their features are in the same places."
    )
    assert "If the object was on a turntable, hang a plain cloth behind it" in finding.advice


def test_turning_on_the_spot_gives_no_model_that_counts(tmp_path):
    angles = torch.deg2rad(8.0 * torch.arange(4, dtype=torch.float64) - 12)
    place = torch.tensor([2.2, 0.0, 1.9], dtype=torch.float64)
    zero = torch.zeros_like(angles)
    ahead = torch.stack([-3 * angles.cos(), 3 * angles.sin(), zero - 1.8 + 0.1 * angles], 1)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    poses = torch.cat([look_at(place[None], place + each, up) for each in ahead])
    diagnosis = prepare(tmp_path, named(photos(replace(arc(4), world_to_camera=poses))))
    assert set(reasons(diagnosis).values()) == {"matched, but not placed"}
    assert kinds(diagnosis)["turning on the spot"] is Weight.STOP
    assert diagnosis.verdict is Verdict.WILL_NOT_TRAIN


def test_the_field_of_view_names_its_side() -> None:
    (sentence,) = (text for text in words_of(figures(), 50) if text.startswith("Camera 1 "))
    assert "900 pixels, a field of view of 58.0 degrees across the width; EXIF says" in sentence


def test_many_cameras_share_a_sentence() -> None:
    cameras = tuple(
        replace(figures().cameras[0], number=number, focal=900.0 + number) for number in range(6)
    )
    sentences = list(words_of(figures(cameras=cameras), 50))
    assert sentences[-1] == (
        "6 cameras have focal lengths of 900 to 905 pixels; prepare.json lists them."
    )
    assert not any(text.startswith("Camera ") for text in sentences)
