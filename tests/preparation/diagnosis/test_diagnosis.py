"""Captures that were made to fail, from files to findings, and what is found in figures alone."""

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

from gsfw.core.files.json_text import json_text
from gsfw.core.maths.camera_path import look_at
from gsfw.datamanagers.images import Header
from gsfw.preparation.camera_grouping import CameraGroup, CameraRule, group_cameras
from gsfw.preparation.diagnosis.camera_findings import camera_findings, focal_findings
from gsfw.preparation.diagnosis.diagnosis import Diagnosis, diagnose, words_of
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.link import Link
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.model_figures import (
    BaselineFigures,
    CameraFigures,
    ModelFigures,
    TrackFigures,
)
from gsfw.preparation.diagnosis.registration_findings import registration_findings
from gsfw.preparation.diagnosis.residuals import Stretch
from gsfw.preparation.diagnosis.view_findings import view_findings
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureReport, FeatureSettings, extract_features
from gsfw.preparation.finding import Finding, Verdict, Weight
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, LeftOut, SourceImage
from gsfw.preparation.mapping.mapping import map_cameras
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.matching import match_pairs
from gsfw.preparation.pairs import MatchingRule, plan_pairs
from gsfw.preparation.source import read_source

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

Pixels = np.ndarray
SHARP = ImageQuality(0.01, 0.5, 0.2, 0.0)


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
    assert finding.advice.endswith("; if they show different things, prepare each by itself.")
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


def figures(**changes: object) -> ModelFigures:
    camera = CameraFigures(
        number=1,
        model="SIMPLE_RADIAL",
        width=1000,
        height=800,
        images=50,
        focal=900.0,
        first_focal=950.0,
        focal_origin="EXIF",
        view_degrees=58.0,
        principal_point=(500.0, 400.0),
        distortion={"k": 0.05},
    )
    usual = ModelFigures(
        registered=50,
        points=10_000,
        observations=60_000,
        error=0.7,
        errors={f"{number}.jpg": 0.7 for number in range(50)},
        seen={f"{number}.jpg": 1200 for number in range(50)},
        tracks=TrackFigures(6.0, 0.2, 15.0, 5.0, 0.0, 0.1),
        baselines=BaselineFigures(2.0, 0.1, 6.0, 60.0, 3.0),
        cameras=(camera,),
        stretch=Stretch(0.1, 1.0, 0.5, 1000),
        own_focals={},
    )
    return replace(usual, **changes)


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


def found_in(model: ModelFigures) -> list[Finding]:
    header, exif = Header(1000, 800, False), Exif(make="Acme", model="One", focal_mm=4.2)
    images = tuple(SourceImage(name, Path(name), header, exif) for name in ("1.jpg", "2.jpg"))
    groups = tuple(
        CameraGroup(number, "SIMPLE_RADIAL", 1000, 800, 950.0, "EXIF", (f"{number}.jpg",))
        for number in (1, 2)
    )
    graph = MatchGraph(("1.jpg", "2.jpg"), ())
    evidence = Evidence(ImageSet(images), groups, {}, graph, (), model)
    return [*focal_findings(evidence), *camera_findings(evidence)]


def test_a_usual_model_has_no_findings():
    assert found_in(figures()) == []


def test_a_model_without_points_is_hollow():
    (finding,) = found_in(figures(points=1, registered=3))
    assert finding.weight is Weight.STOP
    assert finding.found == "The cameras of 3 images rest on 1 point."


def test_large_errors_and_the_images_that_have_them_are_told():
    errors = {"a.jpg": 0.7, "b.jpg": 0.7, "c.jpg": 0.8, "d.jpg": 2.5, "e.jpg": 3.0}
    all_of_it, some = found_in(figures(error=2.1, errors=errors, registered=5))
    assert all_of_it.found.startswith("Points are 2.1 pixels from where images show them (mean)")
    assert [all_of_it.kind, some.kind] == ["reprojection error", "images that fit badly"]
    (some,) = found_in(figures(errors={**errors, "e.jpg": 0.6}, registered=5))
    assert some.found == ("1 of 5 images are 1.5 pixels or more off where 0.7 are usual: d.jpg.")


def test_short_tracks_are_told():
    tracks = TrackFigures(2.3, 0.8, 15.0, 5.0, 0.0, 0.1)
    (finding,) = found_in(figures(tracks=tracks))
    assert (
        finding.found == "A point is seen by 2.3 images (mean), and 80 % of the points by two only."
    )


def test_images_that_are_stretched_each_in_another_way_tell_of_a_rolling_shutter():
    (finding,) = found_in(figures(stretch=Stretch(0.8, 30.0, 0.5, 1000)))
    assert finding.kind == "rolling shutter"
    assert finding.found == (
        "Images are stretched by 0.8 pixels at their edges (median), each in another way, 30 "
        "times what noise explains."
    )
    assert "Things that move in the scene have the same effect." in finding.why


def test_images_of_another_focal_length_are_named_and_are_no_rolling_shutter():
    errors = {**figures().errors, "9.jpg": 3.0}
    stretch = Stretch(0.8, 30.0, 0.5, 1000)
    zoomed = figures(own_focals={"9.jpg": 1500.0, "3.jpg": 1512.0}, errors=errors, stretch=stretch)
    (finding,) = found_in(zoomed)
    assert finding.kind == "several focal lengths"
    assert finding.found == (
        "2 of 50 images fit far better with a focal length of 1500 to 1512 pixels than with the "
        "one computed for all of a camera (900): 9.jpg, 3.jpg."
    )
    assert "cameras=per-image" in finding.advice


def test_missing_images_beside_several_focal_lengths_have_their_remedy():
    features = {name: FeatureReport(500, SHARP, 0.0, 1.0) for name in "abc"}
    models = (frozenset("ab"),)
    zoomed = figures(own_focals={"b": 1500.0})
    header = Header(1000, 800, False)
    images = ImageSet(tuple(SourceImage(name, Path(name), header, Exif()) for name in "abc"))
    evidence = Evidence(images, (), features, MatchGraph(tuple("abc"), ()), models, zoomed)
    (finding,) = registration_findings(evidence)
    assert finding.advice.startswith("Compute the cameras again with a focal length for each")


def test_focal_lengths_are_compared_with_what_was_said():
    camera = figures().cameras[0]
    (finding,) = found_in(figures(cameras=(replace(camera, first_focal=700.0),)))
    assert finding.kind == "focal length unlike EXIF"
    assert finding.found == (
        "Camera 1 (50 images) has a focal length of 900 pixels, where EXIF says 700."
    )
    given = replace(camera, first_focal=700.0, focal_origin="given")
    assert found_in(figures(cameras=(given,)))[0].kind == "focal length unlike the given one"
    guessed = replace(camera, first_focal=1200.0, focal_origin="")
    assert found_in(figures(cameras=(guessed,))) == []


def test_parallel_views_do_not_tell_a_focal_length():
    usual = figures()
    baselines = replace(usual.baselines, view_spread=2.9)
    unknown = replace(usual.cameras[0], focal_origin="")
    flight = replace(usual, baselines=baselines, cameras=(unknown,))
    (finding,) = found_in(flight)
    assert finding.kind == "parallel views"
    assert finding.found == (
        "All 50 views have one direction, within 2.9 degrees, and the focal length was computed "
        "from them."
    )
    given = replace(usual.cameras[0], first_focal=900.0, focal_origin="given")
    assert found_in(replace(flight, cameras=(given,))) == []
    confirmed = replace(given, first_focal=880.0, focal_origin="EXIF")
    assert found_in(replace(flight, cameras=(confirmed,))) == []


def test_one_lens_has_one_focal_length():
    camera = figures().cameras[0]
    other = replace(camera, number=2, width=800, height=1000, focal=1080.0)
    (finding,) = found_in(figures(cameras=(camera, other)))
    assert finding.found == (
        "Images of one camera and lens have different focal lengths: 900 pixels for 1000x800, "
        "1080 pixels for 800x1000."
    )
    assert found_in(figures(cameras=(camera, replace(other, focal=930.0)))) == []


def test_distortion_that_no_lens_has_is_told():
    bent = replace(figures().cameras[0], distortion={"k": -1.2})
    (finding,) = found_in(figures(cameras=(bent,)))
    assert finding.found == (
        "Camera 1 (50 images) moves the corners of its images by 61 % inwards."
    )
    fisheye = replace(bent, model="OPENCV_FISHEYE")
    assert found_in(figures(cameras=(fisheye,))) == []


def test_a_wall_and_a_watermark_are_told():
    links = tuple(Link(a, b, 90, 80, 0.2, flat=True) for a, b in ("ab", "bc", "ac"))
    features = {name: FeatureReport(500, SHARP, 0.0, 1.0) for name in "abc"}
    graph = MatchGraph(tuple("abc"), links, 0.3)
    flat, still = view_findings(Evidence(ImageSet(()), (), features, graph, (), None))
    assert (flat.kind, still.kind) == ("flat scene", "something stands still")
    assert flat.found == "In 100 % of 3 pairs of images all matches lie in one plane."
    assert still.found == (
        "30 % of the matches of two images stay in place while the view moves (median)."
    )


@pytest.mark.parametrize(
    ("spread", "origin", "found"), [(8.0, "", ["flat scene"]), (40.0, "", []), (8.0, "EXIF", [])]
)
def test_tilted_views_of_a_wall_and_exif_tell_the_focal_length(spread, origin, found):
    links = tuple(Link(a, b, 90, 80, 0.2, flat=True) for a, b in ("ab", "bc", "ac"))
    features = {name: FeatureReport(500, SHARP, 0.0, 1.0) for name in "abc"}
    camera = replace(figures().cameras[0], focal_origin=origin)
    baselines = replace(figures().baselines, view_spread=spread)
    model = figures(baselines=baselines, cameras=(camera,))
    models = (frozenset("abc"),)
    evidence = Evidence(ImageSet(()), (), features, MatchGraph(tuple("abc"), links), models, model)
    assert [finding.kind for finding in view_findings(evidence)] == found


def test_files_that_need_nothing_to_be_done_are_a_note():
    left_out = (LeftOut("a.jpg", "it is the same file as b.jpg"),)
    evidence = Evidence(ImageSet((), left_out), (), {}, MatchGraph(("b.jpg",), ()), (), None)
    placed = replace(evidence, models=(frozenset({"b.jpg"}),))
    (finding,) = registration_findings(placed)
    assert finding.weight is Weight.NOTE
    assert finding.found == ("1 of 2 files are not used: a.jpg: it is the same file as b.jpg.")
    assert finding.advice == "Nothing needs to be done."


def test_each_remedy_names_the_files_that_it_is_for():
    left_out = (
        LeftOut("a.heic", "HEIC files are not read", "Convert them."),
        LeftOut("b.jpg", "the file is empty (0 bytes)", "Copy it again from the camera."),
        LeftOut("c.heic", "HEIC files are not read", "Convert them."),
        LeftOut("d.jpg", "it is the same file as b.jpg"),
    )
    evidence = Evidence(ImageSet((), left_out), (), {}, MatchGraph(("e.jpg",), ()), (), None)
    (finding,) = registration_findings(replace(evidence, models=(frozenset({"e.jpg"}),)))
    assert finding.advice == ("a.heic, c.heic: Convert them. b.jpg: Copy it again from the camera.")
