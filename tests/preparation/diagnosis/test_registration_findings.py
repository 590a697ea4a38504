"""Registration findings, from matches, models and files that are not used."""

from dataclasses import replace
from pathlib import Path

from support.model_figures import figures

from gsfw.datamanagers.images import Header
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.link import Link
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.model_figures import ModelFigures
from gsfw.preparation.diagnosis.own_focals import PER_IMAGE
from gsfw.preparation.diagnosis.registration_findings import registration_findings
from gsfw.preparation.diagnosis.repetition import ONCE
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, LeftOut, SourceImage, ViewOfPanorama

SHARP = ImageQuality(0.01, 0.5, 0.2, 0.0)


def missing(graph: MatchGraph, model: ModelFigures, **features: FeatureReport) -> list[Finding]:
    """Findings where the first two images of a graph are placed.

    Args:
        graph: of all images.
        model: figures of the placed ones.
        features: of images that have others than usual ones.
    """
    usual = FeatureReport(500, SHARP, 0.0, 1.0)
    header = Header(1000, 800, False)
    images = ImageSet(tuple(SourceImage(name, Path(name), header, Exif()) for name in graph.names))
    reports = {name: features.get(name, usual) for name in graph.names}
    models = (frozenset(graph.names[:2]),)
    return list(registration_findings(Evidence(images, (), reports, graph, models, model)))


def test_missing_images_beside_several_focal_lengths_have_their_remedy():
    zoomed = figures(own_focals={"b": 1500.0})
    (finding,) = missing(MatchGraph(tuple("abc"), ()), zoomed)
    assert finding.advice.startswith("Compute the cameras again with a focal length for each")
    blurred = FeatureReport(500, ImageQuality(1e-5, 0.5, 0.2, 0.0), 0.0, 1.0)
    (finding,) = missing(MatchGraph(tuple("abc"), ()), zoomed, c=blurred)
    assert finding.advice == "Take such photos again in focus."
    (finding,) = missing(MatchGraph(tuple("abcd"), ()), zoomed, c=blurred)
    assert finding.advice == (f"blurred: Take such photos again in focus. few matches: {PER_IMAGE}")


def test_photos_in_between_are_no_remedy_for_groups_of_repeated_texture():
    links = tuple(Link(first, second, 90, 80, 0.2) for first, second in ("ab", "cd"))
    graph = MatchGraph(tuple("abcd"), links)
    missed, groups = missing(graph, figures())
    assert missed.advice == "Take photos between b and c (nearest to each other by name)."
    last = " If the groups show different things, prepare each by itself."
    assert (groups.kind, groups.advice) == ("separate groups", missed.advice + last)
    missed, groups = missing(replace(graph, repeated=0.9), figures())
    assert (missed.advice, groups.advice) == (ONCE, ONCE + last)


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


def test_views_of_one_panorama_are_one_place():
    header, names = Header(500, 500, False), tuple("abcdef")
    images = ImageSet(
        tuple(
            SourceImage(
                name, Path(name), header, Exif(), view=ViewOfPanorama("p.jpg", number, 250.0)
            )
            for number, name in enumerate(names)
        )
    )
    reports = dict.fromkeys(names, FeatureReport(500, SHARP, 0.0, 1.0))
    evidence = Evidence(images, (), reports, MatchGraph(names, ()), (), None)
    (finding,) = registration_findings(evidence)
    assert finding.found == "There is only one panorama."
