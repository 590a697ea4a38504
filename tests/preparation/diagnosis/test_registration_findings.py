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
from gsfw.preparation.diagnosis.view_findings import view_findings
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


def of_panoramas(
    count: int, placed: int = 0, links: tuple[Link, ...] = (), **features: FeatureReport
) -> Evidence:
    """Panoramas of three views each, named ``p0_0`` and so on; the first ones are placed."""
    header = Header(500, 500, False)
    images = ImageSet(
        tuple(
            SourceImage(
                f"p{one}_{number}",
                Path(f"p{one}_{number}"),
                header,
                Exif(),
                view=ViewOfPanorama(f"p{one}.jpg", number, 250.0),
            )
            for one in range(count)
            for number in range(3)
        )
    )
    names = tuple(images.by_name)
    graph = MatchGraph(names, links, shots={image.name: image.shot for image in images.images})
    usual = FeatureReport(500, SHARP, 0.0, 1.0)
    reports = {name: features.get(name, usual) for name in names}
    models = (frozenset(names[: 3 * placed]),) if placed else ()
    return Evidence(images, (), reports, graph, models, figures() if placed else None)


def test_views_of_one_panorama_are_one_place():
    (finding,) = registration_findings(of_panoramas(1))
    assert finding.found == "There is only one panorama."


def test_a_panorama_without_a_place_is_told_once_with_the_reason_of_its_best_view():
    plain = FeatureReport(20, ImageQuality(1e-5, 0.5, 0.02, 0.0), 40.0, 0.1)
    link = Link("p1_2", "p2_1", 30, 12, 0.3)
    evidence = of_panoramas(3, 2, (link,), p2_0=plain, p2_2=plain)
    (item,) = evidence.unregistered
    assert (item.name, item.reason, item.path) == ("p2.jpg", "few matches", Path("p2_1"))
    assert item.found.startswith("Its best view is p2_1: its best partner is p1_2 with 12 ")
    step = "Take panoramas between p2.jpg and p1.jpg, a step or two apart."
    assert item.advice == step
    poor = FeatureReport(250, SHARP, 0.0, 1.0)
    (item,) = of_panoramas(3, 2, (link,), p2_0=plain, p2_1=poor, p2_2=plain).unregistered
    assert item.advice == (
        f"{step} Give the panoramas at their full size, if they were shrunk: a view has only "
        "500x500 pixels. Include something with texture: step back, or put patterned things there."
    )
    finding = next(registration_findings(evidence))
    assert finding.found == "2 of 3 panoramas were placed; the others: few matches (1)."


def test_a_plain_wall_in_a_panorama_is_no_motion_blur():
    streaked = FeatureReport(300, ImageQuality(0.002, 0.5, 0.2, 0.0), 40.0, 0.05)
    sharp = of_panoramas(3, 3, p0_0=streaked, p0_1=streaked)
    assert not [one for one in view_findings(sharp) if one.kind == "motion blur"]
    plain = FeatureReport(3, ImageQuality(0.0, 0.5, 0.01, 0.0), None, 1.0)
    for last in (streaked, plain):
        moved = of_panoramas(3, 3, p0_0=streaked, p0_1=streaked, p0_2=last)
        (finding,) = [one for one in view_findings(moved) if one.kind == "motion blur"]
        assert finding.found.startswith("1 of 3 images lack fine detail in one direction")
