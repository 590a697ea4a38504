"""Camera findings, from figures of models."""

from dataclasses import replace
from pathlib import Path

from support.model_figures import figures

from gsfw.datamanagers.images import Header
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.diagnosis.camera_findings import camera_findings, focal_findings
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.model_figures import ModelFigures, TrackFigures
from gsfw.preparation.diagnosis.residuals import Stretch
from gsfw.preparation.exif import Exif
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.image_set import ImageSet, SourceImage

CAMERAS = 60


def found_in(model: ModelFigures) -> list[Finding]:
    header, exif = Header(1000, 800, False), Exif(make="Acme", model="One", focal_mm=4.2)
    members = {number: (f"{number}.jpg", f"{number}b.jpg") for number in range(1, CAMERAS + 1)}
    groups = tuple(
        CameraGroup(number, "SIMPLE_RADIAL", 1000, 800, 950.0, "EXIF", names)
        for number, names in members.items()
    )
    names = tuple(name for group in groups for name in group.images)
    images = tuple(SourceImage(name, Path(name), header, exif) for name in names)
    graph = MatchGraph(names, ())
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
    errors = {**figures().errors, "1.jpg": 3.0}
    stretch = Stretch(0.8, 30.0, 0.5, 1000)
    zoomed = figures(own_focals={"1.jpg": 1500.0, "1b.jpg": 1512.0}, errors=errors, stretch=stretch)
    (finding,) = found_in(zoomed)
    assert finding.kind == "several focal lengths"
    assert finding.found == (
        "2 of 50 images fit far better with a focal length of 1500 to 1512 pixels than with that "
        "of their camera (900): 1.jpg, 1b.jpg."
    )
    assert "cameras=per-image" in finding.advice


def test_only_cameras_of_images_of_another_focal_length_are_named():
    cameras = tuple(
        replace(figures().cameras[0], number=number, focal=899.0 + number)
        for number in range(1, CAMERAS + 1)
    )
    (one,) = found_in(figures(own_focals={"2.jpg": 1500.0}, cameras=cameras))
    assert one.found == (
        "1 of 50 images fits far better with a focal length of 1500 pixels than with that of its "
        "camera (901): 2.jpg."
    )
    (two,) = found_in(figures(own_focals={"1.jpg": 1500.0, "2.jpg": 1500.0}, cameras=cameras))
    assert "than with that of their camera (900 to 901): 1.jpg, 2.jpg." in two.found


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
