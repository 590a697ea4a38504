"""View findings, from matches and models."""

from dataclasses import replace

import pytest
from support.model_figures import figures

from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.link import Link
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.view_findings import view_findings
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet

SHARP = ImageQuality(0.01, 0.5, 0.2, 0.0)


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
