"""Registration: the finest features are looked for where images would stay without a camera."""

import json
from dataclasses import asdict, dataclass, field, replace
from types import SimpleNamespace

import pycolmap
import pytest
from support import captured

from gsfw.core.errors import DataError
from gsfw.datamanagers.images import Header
from gsfw.preparation import features, registration
from gsfw.preparation.camera_grouping import CameraRule, group_cameras
from gsfw.preparation.choices import Choices
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureReport, FeatureSettings
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, SourceImage, ViewOfPanorama
from gsfw.preparation.journal import Journal
from gsfw.preparation.mapping.mapping import Mapping
from gsfw.preparation.preparation_rule import PreparationRule
from gsfw.preparation.registration import Registered, register
from gsfw.preparation.workspace import Workspace

SHARP = ImageQuality(0.01, 0.5, 0.2, 0.0)
BLURRED = ImageQuality(0.0001, 0.5, 0.2, 0.0)


def attempt(tmp_path, placed, name="first", given=10, seen=500, enlarged=False, quality=SHARP):
    """An attempt that placed the first so many images, each of which sees so many points."""
    folder = tmp_path / name
    folder.mkdir(exist_ok=True)
    names = [f"{number:02d}.jpg" for number in range(given)]
    model = SimpleNamespace(
        images={n: SimpleNamespace(name=n, has_pose=True) for n in names[:placed]},
        compute_num_observations=lambda: seen * placed,
        num_reg_frames=lambda: placed,
    )
    reports = {
        n: FeatureReport(
            1500, SHARP if n in names[:placed] else quality, 0.0, 1.0, enlarged=enlarged
        )
        for n in names
    }
    mapping = Mapping((folder,), (placed,)) if placed else Mapping()
    settings = FeatureSettings(1600, 4000, thorough=enlarged)
    chosen = {"cameras": f"cameras of the {name}", name: "its own"}
    return model, Registered((), reports, mapping, folder / "database.db", settings, chosen)


@pytest.fixture
def registered(tmp_path, monkeypatch):
    """Registers, with given outcomes of the attempts; gives the outcome and what was said.

    An error is the outcome of an attempt that fails.
    """

    def run(*attempts, thorough=None, choices=None):
        made = [one for one in attempts if not isinstance(one, Exception)]
        models = {str(found.mapping.models[0]): model for model, found in made if found.placed}
        monkeypatch.setattr(pycolmap, "Reconstruction", lambda path: models[str(path)])
        outcomes = iter(attempts)
        asked = []

        class Attempt:
            def __init__(self, place, rule, journal, say):
                size = (rule.feature_size, rule.feature_count)
                asked.append((place.attempt, rule.thorough, *size))

            def run(self, images, groups):
                outcome = next(outcomes)
                if isinstance(outcome, Exception):
                    raise outcome
                return outcome[1]

        monkeypatch.setattr(registration, "Registration", Attempt)
        said = []
        choices = choices or Choices(said.append)
        place, rule = Workspace(tmp_path / "out"), PreparationRule(thorough=thorough)
        journal = Journal(place.journal)
        found = register(captured.image_set([]), (), place, rule, journal, choices)
        of_first = ("", thorough, None, None)
        assert asked == [of_first, ("thorough", True, 1600, 4000)][: len(attempts)]
        return found, said

    return run


def test_cameras_of_all_images_need_no_second_attempt(tmp_path, registered):
    first = attempt(tmp_path, 10)
    assert registered(first) == (first[1], [])


def test_images_without_a_camera_are_looked_at_more_closely(tmp_path, registered):
    first, second = attempt(tmp_path, 7), attempt(tmp_path, 10, "second", enlarged=True)
    found, said = registered(first, second)
    assert found is second[1]
    assert said == [
        "cameras: 3 of 10 usable images could not be placed; trying again, with the finest "
        "features of all images"
    ]


def test_cameras_that_rest_on_few_points_are_computed_again(tmp_path, registered):
    first = attempt(tmp_path, 10, seen=60)
    second = attempt(tmp_path, 10, "second", enlarged=True)
    found, said = registered(first, second)
    assert found is second[1]
    assert "cameras: an image sees only 60 points; trying again" in said[0]


def test_nothing_placed_is_a_reason_too(tmp_path, registered):
    second = attempt(tmp_path, 0, "second", enlarged=True)
    found, said = registered(attempt(tmp_path, 0), second)
    assert found is second[1]
    assert "cameras: no image could be placed; trying again" in said[0]


def test_the_attempt_with_more_cameras_counts(tmp_path, registered):
    first, second = attempt(tmp_path, 7), attempt(tmp_path, 5, "second", enlarged=True)
    found, said = registered(first, second)
    assert found is first[1]
    assert "the finest features of all images place fewer" in said[-1]


def chosen_with(registered, *attempts):
    """Sentences by the stage, after these attempts."""
    choices = Choices(lambda line: None)
    registered(*attempts, choices=choices)
    return choices.by_stage


def test_the_report_has_the_choices_of_the_attempt_that_counts_alone(tmp_path, registered):
    first = attempt(tmp_path, 7)
    worse = attempt(tmp_path, 5, "second", enlarged=True)
    better = attempt(tmp_path, 9, "second", enlarged=True)
    lost, won = chosen_with(registered, first, worse), chosen_with(registered, first, better)
    assert lost.pop("second attempt").endswith("the finest features of all images place fewer")
    assert won.pop("second attempt").endswith("with the finest features of all images")
    assert lost == {"cameras": "cameras of the first", "first": "its own"}
    assert won == {"cameras": "cameras of the second", "second": "its own"}
    alone = chosen_with(registered, attempt(tmp_path, 10))
    assert alone == {"cameras": "cameras of the first", "first": "its own"}


def test_a_second_attempt_that_fails_leaves_the_first(tmp_path, registered):
    first = attempt(tmp_path, 7)
    found, said = registered(first, DataError("COLMAP refuses it."))
    assert found is first[1]
    assert said[-1] == (
        "cameras: 3 of 10 usable images could not be placed; the first attempt counts, as the "
        "second one failed: COLMAP refuses it."
    )


def test_a_second_attempt_that_fails_ends_what_has_no_cameras_yet(tmp_path, registered):
    with pytest.raises(DataError, match="COLMAP refuses it"):
        registered(attempt(tmp_path, 0), DataError("COLMAP refuses it."))


def test_blurred_images_are_no_reason_for_a_second_attempt(tmp_path, registered):
    first = attempt(tmp_path, 7, quality=BLURRED)
    assert registered(first) == (first[1], [])


def test_what_was_looked_for_already_is_no_reason(tmp_path, registered):
    first = attempt(tmp_path, 3, enlarged=True)
    assert registered(first) == (first[1], [])


@pytest.mark.parametrize("thorough", [True, False])
def test_the_user_may_choose(tmp_path, registered, thorough):
    first = attempt(tmp_path, 3)
    assert registered(first, thorough=thorough) == (first[1], [])


@dataclass
class Listener(Journal):
    """A journal that says all stages are finished, and keeps the settings that it is asked for."""

    asked: dict = field(default_factory=dict)

    def stage(self, name, settings, *_, **__):
        self.asked[name] = json.loads(json.dumps(settings))
        return asdict(Mapping()) if name == "cameras" else {"how": ""} if name == "matches" else {}


def test_panoramas_add_nothing_to_the_keys_of_finished_stages_of_photos(tmp_path):
    header = Header(200, 100, has_alpha=False)
    photo = SourceImage("a.jpg", tmp_path, header, Exif())
    view = replace(photo, name="b.jpg", view=ViewOfPanorama("b.jpg", 0, 50.0))
    for images, new in (
        ((photo,), [set(), set()]),
        ((view,), [{"view", "rig"}, {"known_cameras"}]),
    ):
        journal, found = Listener(), ImageSet(images)
        groups = group_cameras(found, CameraRule())
        registration.Registration(
            Workspace(tmp_path), PreparationRule(), journal, lambda line: None
        ).run(found, groups)
        (group,) = journal.asked["features"]["groups"]
        cameras = journal.asked["cameras"]
        # The words of journals from before panoramas were cut.
        assert group.keys() - new[0] == {
            *("number", "model", "width", "height", "focal", "focal_origin", "images")
        }
        assert cameras.keys() - new[1] == {
            *("mapper", "refine_focal", "refine_principal_point", "thorough")
        }
        assert new[0] <= group.keys()
        assert new[1] <= cameras.keys()


@pytest.mark.slow
def test_a_second_attempt_keeps_the_first_and_is_done_once(tmp_path, monkeypatch):
    monkeypatch.setattr(features, "ENOUGH", 50)
    monkeypatch.setattr(registration, "FEW_OBSERVATIONS", 10**6)
    paths = captured.write(tmp_path / "photos", captured.photos(captured.arc(6)), ".png")
    images = captured.image_set(paths)
    place, rule, said = Workspace(tmp_path / "out"), PreparationRule(), []
    place.work.mkdir(parents=True)

    def run():
        groups = group_cameras(images, CameraRule())
        return register(images, groups, place, rule, Journal(place.journal), Choices(said.append))

    found = run()
    assert found.database == place.work / "thorough" / "database.db"
    assert found.placed == 6
    assert all(report.enlarged for report in found.features.values())
    assert any("an image sees only" in line for line in said)
    done = place.journal.read_text()
    assert '"cameras"' in done
    assert '"cameras, thorough"' in done
    assert run().mapping == found.mapping
    assert place.journal.read_text() == done
    monkeypatch.setattr(registration, "FEW_OBSERVATIONS", 0)
    assert run().database == place.work / "database.db"
    assert not (place.work / "thorough").exists()
