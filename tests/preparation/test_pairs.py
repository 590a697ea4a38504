from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from gsfw.core.errors import ConfigError
from gsfw.datamanagers.images import Header
from gsfw.preparation import pairs
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.exif import Exif
from gsfw.preparation.feature_database import FeatureDatabase
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, SourceImage, ViewOfPanorama
from gsfw.preparation.pairs import MatchingRule, PairPlan, plan_pairs
from gsfw.preparation.sift import ImageFeatures


def imagined(groups: dict[str, int], in_order: bool = False) -> ImageSet:
    """So many images of each group."""
    header = Header(160, 120, has_alpha=False)
    return ImageSet(
        tuple(
            SourceImage(f"{group}{number:03d}.png", Path("nowhere"), header, Exif(), group)
            for group, count in groups.items()
            for number in range(count)
        ),
        in_order=in_order,
    )


def stored(folder: Path, images: ImageSet, leave_out: str = "") -> Path:
    """A database of the images without any feature."""
    names = tuple(image.name for image in images.images)
    group = CameraGroup(1, "SIMPLE_RADIAL", 160, 120, 150.0, "", names)
    nothing = ImageQuality(0.0, 0.0, 0.0, 0.0)
    with FeatureDatabase(folder / "d.db", images, (group,)) as database:
        for name in names:
            if name != leave_out:
                keypoints, descriptors = np.zeros((0, 6), np.float32), np.zeros((0, 128), np.uint8)
                database.write(ImageFeatures(name, nothing, (0.0, 1.0), keypoints, descriptors))
    return folder / "d.db"


@pytest.fixture
def nearest_by_number(monkeypatch):
    """Likeness goes by numbers, groups come in order: none knows of the other."""

    def ranked(database, vocabulary):
        with pycolmap.Database.open(database) as opened:
            names = [image.name for image in opened.read_all_images()]
        return {
            name: sorted(
                set(names) - {name},
                key=lambda other: (other[0] != name[0], abs(int(other[1:4]) - int(name[1:4]))),
            )
            for name in names
        }

    monkeypatch.setattr(pairs, "look_alikes", ranked)


def planned(folder: Path, images: ImageSet, rule: MatchingRule | None = None) -> PairPlan:
    plan = plan_pairs(images, rule or MatchingRule(), stored(folder, images))
    names = [image.name for image in images.images]
    # Every pair is there once, the earlier image first.
    assert len(set(plan.pairs)) == len(plan.pairs)
    assert all(names.index(first) < names.index(second) for first, second in plan.pairs)
    return plan


@pytest.mark.parametrize(("count", "number"), [(3, 3), (200, 19_900)])
def test_all_pairs_of_few_photos_are_compared(tmp_path, count, number):
    plan = planned(tmp_path, imagined({"a": count}))
    assert len(plan.pairs) == number
    assert plan.how == (f"pairs: all {number} of {count} images, as there are at most 200.")


def test_an_image_that_could_not_be_decoded_is_in_no_pair(tmp_path):
    images = imagined({"a": 4})
    database = stored(tmp_path, images, leave_out="a001.png")
    plan = plan_pairs(images, MatchingRule("exhaustive"), database)
    assert plan.pairs == tuple(combinations(("a000.png", "a002.png", "a003.png"), 2))
    assert plan.how == "pairs: all 3 of 3 images."


@pytest.mark.parametrize("in_order", [False, True])
def test_one_image_has_no_pair(tmp_path, in_order):
    plan = planned(tmp_path, imagined({"a": 1}, in_order))
    assert plan == PairPlan((), "pairs: none, as there are no two images to compare.")


def test_look_alikes_of_many_photos_are_compared(tmp_path, nearest_by_number):
    plan = planned(tmp_path, imagined({"a": 201}))
    assert 201 * 15 <= len(plan.pairs) <= 201 * 30
    assert plan.how == (
        f"pairs: {len(plan.pairs)} of 20100 between 201 images: each with the 30 most alike, by a "
        "vocabulary of their own features, as there are more than 200."
    )


def test_look_alikes_are_also_taken_from_other_folders(tmp_path, nearest_by_number):
    rule = MatchingRule("retrieval", neighbors=5)
    plan = planned(tmp_path, imagined({"a": 20, "b": 20}), rule)
    across = [pair for pair in plan.pairs if pair[0][0] != pair[1][0]]
    assert {name for pair in across for name in pair} == {
        f"{group}{number:03d}.png" for group in "ab" for number in range(20)
    }
    assert "each with the 5 most alike, 10 of them from other folders, by a" in plan.how


def test_frames_of_a_video_are_compared_with_their_neighbours_and_to_close_loops(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(pairs, "look_alikes", lambda *_: {"a000.png": ["a001.png", "a039.png"]})
    plan = planned(tmp_path, imagined({"a": 40}, in_order=True), MatchingRule(overlap=6))
    steps = {int(b[1:4]) - int(a[1:4]) for a, b in plan.pairs}
    assert steps == {1, 2, 3, 4, 5, 6, 8, 16, 32, 39}
    assert ("a000.png", "a039.png") in plan.pairs
    assert plan.how == (
        f"pairs: {len(plan.pairs)} of 780 between 40 images: each with its neighbours up to 6 "
        "before and after, and some further ones, as they follow each other in time, and, to "
        "close loops, with the 10 most alike elsewhere, by a vocabulary of their own features."
    )


def test_look_alikes_join_two_videos(tmp_path, nearest_by_number):
    plan = planned(tmp_path, imagined({"a": 30, "b": 30}, in_order=True))
    across = {name for pair in plan.pairs if pair[0][0] != pair[1][0] for name in pair}
    assert len(across) == 60
    # The last frame of one video is no neighbour in time of the first of the next.
    assert ("a029.png", "b000.png") not in plan.pairs
    assert "10 most alike elsewhere and 10 of other videos or folders, by a" in plan.how


def test_a_missing_vocabulary_is_refused():
    with pytest.raises(ConfigError) as caught:
        MatchingRule(vocabulary=Path("words.bin")).check()
    assert str(caught.value) == (
        "vocabulary=words.bin: there is no such file.\n"
        "Leave it out to build a vocabulary of the images themselves."
    )


def views(count: int, in_order: bool = False, each: int = 6) -> ImageSet:
    """So many panoramas of one group, each as its views."""
    header = Header(160, 160, has_alpha=False)
    return ImageSet(
        tuple(
            SourceImage(
                f"a{number:03d}_{direction}.jpg",
                Path("nowhere"),
                header,
                Exif(),
                "a",
                view=ViewOfPanorama(f"a{number:03d}.jpg", direction, 80.0),
            )
            for number in range(count)
            for direction in range(each)
        ),
        in_order=in_order,
    )


def test_views_of_one_panorama_are_not_compared_with_each_other(tmp_path):
    plan = planned(tmp_path, views(3))
    assert len(plan.pairs) == 3 * 6 * 6
    assert all(first[:4] != second[:4] for first, second in plan.pairs)


def test_views_of_a_video_are_compared_with_those_of_neighbouring_frames(
    tmp_path, nearest_by_number
):
    plan = planned(tmp_path, views(40, in_order=True))
    near = {pair[1][5:6] for pair in plan.pairs if pair[0] == "a000_0.jpg" and "a001" in pair[1]}
    # A view overlaps those beside it; the frame is the neighbour, and not each view of it.
    assert near == {"0", "1", "5"}
    far = {pair[1] for pair in plan.pairs if pair[0] == "a000_0.jpg" and "a008" in pair[1]}
    assert far == {"a008_0.jpg"}
    assert all(first[:4] != second[:4] for first, second in plan.pairs)


def test_look_alikes_of_a_view_are_views_of_other_panoramas(tmp_path, nearest_by_number):
    plan = planned(tmp_path, views(40), MatchingRule("retrieval", neighbors=6))
    assert all(first[:4] != second[:4] for first, second in plan.pairs)
    assert len([pair for pair in plan.pairs if "a000_0.jpg" in pair]) >= 6
