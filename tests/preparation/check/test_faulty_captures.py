"""Captures that were made faulty on purpose: each fault is named, and no other."""

from dataclasses import replace
from pathlib import Path

import faults
import numpy as np
import pytest
from made_capture import MadeCapture
from PIL import Image
from support.cast_captures import HEIGHT, WIDTH, cast_capture, findings_of, survey_of

from gsfw.core.errors import DataError
from gsfw.preparation.check.point_scale import depth_factors
from gsfw.preparation.check.pose_agreement import agreement
from gsfw.preparation.check.pose_findings import pose_findings
from gsfw.preparation.finding import Weight

# Whole data sets are read and judged, by parts that have tests of their own.
pytestmark = pytest.mark.unchecked

GREY = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)


@pytest.fixture(scope="module")
def cutout() -> MadeCapture:
    return cast_capture()


@pytest.fixture(scope="module")
def sound(cutout) -> MadeCapture:
    return faults.turntable(cutout, GREY)


@pytest.mark.slow
def test_a_sound_capture_has_no_fault(sound, tmp_path):
    assert set(findings_of(sound, tmp_path / "a")) == {"open side"}


@pytest.mark.slow
def test_matches_agree_with_right_poses_and_points_lie_at_their_depth(sound, tmp_path):
    survey = survey_of(sound, tmp_path / "a")
    check = survey.cross_check
    assert len(check.matches.pairs) > 30
    assert agreement(check.matches, check.rig).mean() > 0.9
    assert agreement(check.matches, check.rig.with_focal(1.5)).mean() < 0.99
    np.testing.assert_allclose(np.median(depth_factors(survey)), 1, atol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "kind", "weight", "advice"),
    [
        (faults.poses_inverted, "poses inverted", Weight.STOP, "invert each matrix"),
        pytest.param(
            faults.axes_mixed,
            "camera axes",
            Weight.STOP,
            "OpenGL and OpenCV",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            faults.images_flipped,
            "mirrored",
            Weight.STOP,
            "flip the images back",
            marks=pytest.mark.slow,
        ),
        (
            faults.images_shuffled,
            "images and poses do not belong together",
            Weight.STOP,
            "Restore the order",
        ),
        pytest.param(
            faults.poses_exchanged,
            "poses exchanged",
            Weight.LIMIT,
            "Exchange their poses",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            faults.camera_turned,
            "cameras misplaced",
            Weight.LIMIT,
            "Leave these images out",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            faults.focal_lengths_spread,
            "focal lengths differ",
            Weight.LIMIT,
            "cameras=one",
            marks=pytest.mark.slow,
        ),
        (faults.masks_named_otherwise, "masks not used", Weight.LIMIT, "view_00.jpg.png or view"),
        (faults.unlit, "unlit images", Weight.LIMIT, "Remove them"),
        pytest.param(
            faults.points_of_another_scale,
            "points of another scale",
            Weight.LIMIT,
            "units",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_fault_is_named_first(sound, tmp_path, fault, kind, weight, advice):
    found = findings_of(fault(sound), tmp_path / "a")
    assert next(iter(found)) == kind
    assert found[kind].weight is weight
    assert advice in found[kind].advice
    # Consequences of a fault are not told as faults of their own.
    assert not {"images contradict points", "uneven exposure", "cameras see no points"} & set(found)


@pytest.mark.slow
def test_where_colmap_does_not_load_that_is_told_and_nothing_else_is_lost(
    sound, tmp_path, monkeypatch
):
    def broken() -> None:
        raise ImportError("libgomp.so.1: cannot open shared object file")

    monkeypatch.setattr("gsfw.preparation.check.view_matches.load_colmap", broken)
    found = findings_of(faults.unlit(sound), tmp_path / "a")
    assert "libgomp.so.1" in found["images not matched"].found
    assert "unlit images" in found


@pytest.mark.slow
def test_exchanged_and_misplaced_images_are_named(sound, tmp_path):
    exchanged = findings_of(faults.poses_exchanged(sound), tmp_path / "a")["poses exchanged"]
    assert set(exchanged.images) == {"images/view_04.jpg", "images/view_14.jpg"}
    turned = findings_of(faults.camera_turned(sound), tmp_path / "b")["cameras misplaced"]
    assert turned.images == ("images/view_12.jpg",)


@pytest.mark.slow
def test_a_focal_length_of_other_images_is_told_with_its_factor(tmp_path):
    # Cameras that all look at one thing hardly tell their focal length.
    sound = faults.turntable(cast_capture(20, wander=0.9), GREY)
    assert survey_of(sound, tmp_path / "a").cross_check.focal_factor is None
    survey = survey_of(faults.focal_length_wrong(sound), tmp_path / "b")
    assert survey.cross_check.focal_factor == pytest.approx(1 / 1.5, rel=0.08)
    assert [finding.kind for finding in pose_findings(survey)] == ["focal length wrong"]


@pytest.mark.slow
def test_two_scenes_in_one_are_told(sound, tmp_path):
    # Features of a negative match none of the positive; each scene alone is sound.
    other = replace(sound, images=tuple(255 - image for image in sound.images))
    found = findings_of(faults.two_scenes(sound, other), tmp_path / "a")
    assert next(iter(found)) == "two scenes"
    assert all(name.startswith("images/zz_view") for name in found["two scenes"].images)


@pytest.mark.slow
def test_an_object_on_a_turntable_is_told_unless_it_is_cut_out(cutout, tmp_path):
    small = np.random.default_rng(2).integers(0, 255, (30, 40, 3)).astype(np.uint8)
    behind = np.asarray(Image.fromarray(small).resize((WIDTH, HEIGHT), Image.Resampling.BICUBIC))
    found = findings_of(faults.turntable(cutout, behind), tmp_path / "a")
    assert next(iter(found)) == "background does not move"
    assert "mask the background" in found["background does not move"].advice
    assert "background does not move" not in findings_of(cutout, tmp_path / "b")


def test_a_left_handed_world_is_called_mirrored(sound, tmp_path):
    with pytest.raises(DataError, match=r"is mirrored \(determinant -1\)[^\n]*\n.*negate one of"):
        survey_of(faults.world_left_handed(sound), tmp_path / "a")


def test_photos_without_a_camera_are_named_and_what_was_computed_is_not(sound, tmp_path):
    folder = sound.write(tmp_path / "a")
    for name in ("view_99.jpg", "view_00_depth.jpg", "notes.txt"):
        (folder / "images" / name).write_bytes((folder / "images/view_00.jpg").read_bytes())
    found = _opened_findings(folder)["photos without a camera"]
    assert found.images == ("view_99.jpg",)
    assert found.weight is Weight.NOTE


def _opened_findings(folder: Path):
    from gsfw.core.datamanager import DataRequest
    from gsfw.datamanagers.transforms import TransformsConfig
    from gsfw.preparation.check.camera_findings import camera_findings
    from gsfw.preparation.check.survey import Survey

    data = TransformsConfig().build(DataRequest(folder))
    survey = Survey.of(data, 1)
    data.close()
    return {finding.kind: finding for finding in camera_findings(survey)}
