from pathlib import Path

from gsfw.datamanagers.images import Header
from gsfw.preparation.diagnosis.inquiry import why_unregistered
from gsfw.preparation.diagnosis.link import Link
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.unregistered import Unregistered
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, SourceImage

PLACED = ("a", "b", "c")


def report(
    count: int = 2000,
    sharpness: float = 1e-3,
    brightness: float = 0.5,
    contrast: float = 0.25,
    clipped: float = 0.0,
    blur: float = 0.6,
    failure: str = "",
) -> FeatureReport:
    quality = ImageQuality(sharpness, brightness, contrast, clipped)
    return FeatureReport(count, quality, 40.0 if count else None, blur, failure)


def why(
    other: FeatureReport,
    *links: Link,
    placed: tuple[str, ...] = PLACED,
    models: tuple[frozenset[str], ...] = (),
    still: float = 0.0,
    one_focal: bool = False,
    header: Header = Header(1000, 500, False),  # noqa: B008 - it is frozen.
) -> Unregistered:
    """Why image x is not placed, beside a usual a, b, c and d."""
    names = ("a", "b", "c", "d", "x")
    images = ImageSet(tuple(SourceImage(n, Path(n), header, Exif()) for n in names))
    reports = {name: report() for name in names[:-1]} | {"x": other}
    graph = MatchGraph(names, links, still)
    largest = (frozenset(placed),) if placed else ()
    return why_unregistered(images, reports, graph, (*largest, *models), one_focal)[-1]


def test_an_image_that_does_not_decode_says_why():
    found = why(report(0, failure="x.jpg: the image does not decode: truncated."))
    assert found.reason == "does not decode"
    assert found.found == "x.jpg: the image does not decode: truncated."
    assert found.advice == "Replace the file, or remove it."
    assert found.path == Path("x")


def test_dark_and_bright_images_are_not_called_empty():
    black = why(report(0, 0.0, brightness=0.0, contrast=0.0, clipped=1.0))
    assert black.reason == "too dark"
    assert black.found == (
        "Its mean brightness is 0 % and 100 % of it pure black or white; 0 features were found "
        "where 2,000 are usual."
    )
    white = why(report(0, 0.0, brightness=1.0, contrast=0.0, clipped=1.0))
    assert white.reason == "over-exposed"


def test_one_colour_is_empty_and_a_wall_has_few_features():
    assert why(report(0, 0.0, contrast=0.001)).reason == "empty"
    wall = why(report(1, 1e-4, contrast=0.04))
    assert wall.reason == "few features"
    assert wall.found == (
        "It shows a plain surface, with 16 % of the usual contrast; 1 feature was found where "
        "2,000 are usual."
    )


def test_blur_is_the_cause_of_few_features_and_not_the_other_way_round():
    found = why(report(60, 2e-4))
    assert found.reason == "blurred"
    assert found.found == (
        "It has 20 % of the usual sharpness; 60 features were found where 2,000 are usual."
    )
    assert why(report(60)).reason == "few features"


def test_blur_along_a_line_is_motion_and_may_leave_more_sharpness():
    found = why(report(300, 5e-4, blur=0.05))
    assert found.reason == "motion blur"
    assert "50 % of the usual sharpness, and least along 40 degrees" in found.found
    assert why(report(300, 9e-4, blur=0.05)).reason == "few matches"


def test_a_darker_image_is_not_called_blurred():
    assert why(report(900, 1e-3 / 9, brightness=0.5 / 3)).reason == "few matches"


def test_looks_are_not_to_blame_where_a_placed_image_shows_the_same():
    found = why(report(600, 1e-4), Link("a", "x", 200, 120, 0.1))
    assert found.reason == "matched, but not placed"
    assert found.found == (
        "It has 120 verified matches with a, but too few of them are on points that the model has."
    )


def test_few_matches_name_the_best_partner_and_where_to_take_photos():
    found = why(report(), Link("b", "x", 30, 0), Link("c", "x", 40, 18, 0.1))
    assert found.reason == "few matches"
    assert found.found == (
        "Its best partner is c with 18 verified matches, where 15 to 30 are needed; 2,000 "
        "features were found where 2,000 are usual."
    )
    assert found.advice == "Take photos between x and c, each overlapping the next by two thirds."
    assert "It has no match with any image" in why(report()).found


def test_few_features_of_small_photos_ask_for_larger_ones():
    small = Header(400, 300, False)
    advice = "Give the photos at their full size, if 400x300 pixels is not all of it. Include "
    assert why(report(60), header=small).advice.startswith(advice)
    weak = why(report(250), Link("b", "x", 40, 18, 0.1), header=small)
    assert weak.reason == "few matches"
    assert f"by two thirds. {advice}" in weak.advice


def test_a_group_of_its_own_is_told_with_a_bridge():
    found = why(report(), Link("d", "x", 90, 70, 0.1), Link("b", "d", 40, 0))
    assert found.reason == "matched only within its group"
    assert found.found == (
        "It and 1 other image match each other only; the largest model has 3 images."
    )
    assert found.advice.startswith("Take photos between b and d (40 features look alike")


def test_a_model_of_its_own_is_a_group_even_if_some_matches_lead_elsewhere():
    links = Link("d", "x", 90, 70, 0.1), Link("b", "d", 40, 32, 0.1)
    found = why(report(), *links, models=(frozenset({"d", "x"}),))
    assert found.found == (
        "It and 1 other image make up a model of their own; the largest model has 3 images."
    )
    assert found.advice == "Take photos between b and d (32 verified matches)."


def test_copies_are_told_apart_from_images_that_share_a_caption():
    assert why(report(), Link("a", "x", 1900, 1800, 1e-4)).found == (
        "It shows a once more: their 1800 verified matches do not move."
    )
    found = why(report(), Link("a", "x", 900, 800, 1e-4), still=0.4)
    assert found.reason == "matched, but not placed"
    assert found.advice == "Crop or mask what is in the same place in all images."


def test_images_of_a_turntable_before_one_background_are_not_called_duplicates():
    still = [Link("a", other, 1900, 1800, 1e-4) for other in "bcdx"]
    found = why(report(), *still, placed=())
    assert found.reason == "one view"
    assert found.found == (
        "Most of it is in the same places as in a: their 1800 verified matches do not move."
    )
    assert "turntable" in found.advice
    assert "Leave it out" not in found.advice
    assert why(report(), still[-1], placed=()).reason == "duplicate"


def test_turning_on_the_spot_is_the_reason_where_no_depth_is_told():
    found = why(report(), Link("a", "x", 900, 800, 0.2, flat=True, is_turn=True))
    assert found.reason == "matched, but not placed"
    assert found.advice == "Take photos from a step aside."


def test_without_a_model_blur_is_judged_by_itself():
    found = why(report(60, 1e-5), Link("a", "x", 60, 50, 0.1), placed=())
    assert found.reason == "blurred"
    assert found.found == "It has 1 % of the usual sharpness; 60 features were found."
    rest = why(report(), Link("a", "x", 60, 50, 0.1), placed=())
    assert rest.found == (
        "It has 50 verified matches with a, but no model of more than a few points came of it."
    )


def test_images_that_match_well_without_a_model_may_have_several_focal_lengths():
    links = [Link(name, "x", 900, 640, 0.2) for name in "ab"]
    shared = why(report(), *links, placed=(), one_focal=True)
    assert shared.reason == "matched, but not placed"
    assert shared.advice.startswith("If the lens was zoomed or exchanged, compute the cameras ")
    assert " If not, take more photos of the same things" in shared.advice
    assert "cameras=per-image" not in why(report(), *links, placed=()).advice


def test_documents_are_plain_data():
    assert why(report(60)).document() == {
        "name": "x",
        "reason": "few features",
        "found": "60 features were found where 2,000 are usual; at least 200 are needed.",
        "advice": "Include something with texture: step back, or put patterned things there.",
    }
