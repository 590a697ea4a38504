"""Registration findings, from matches, models and files that are not used."""

from dataclasses import replace
from pathlib import Path

from support.model_figures import figures

from gsfw.datamanagers.images import Header
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.registration_findings import registration_findings
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.finding import Weight
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, LeftOut, SourceImage

SHARP = ImageQuality(0.01, 0.5, 0.2, 0.0)


def test_missing_images_beside_several_focal_lengths_have_their_remedy():
    features = {name: FeatureReport(500, SHARP, 0.0, 1.0) for name in "abc"}
    models = (frozenset("ab"),)
    zoomed = figures(own_focals={"b": 1500.0})
    header = Header(1000, 800, False)
    images = ImageSet(tuple(SourceImage(name, Path(name), header, Exif()) for name in "abc"))
    evidence = Evidence(images, (), features, MatchGraph(tuple("abc"), ()), models, zoomed)
    (finding,) = registration_findings(evidence)
    assert finding.advice.startswith("Compute the cameras again with a focal length for each")


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
