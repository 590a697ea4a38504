"""Registration: where the images were taken from; features, matches and mapping, once or twice.

The first attempt looks for the finest features only in images that have few others, which takes a
third of the time. If that leaves images without a camera, or images that see few points, a second
one looks for those of all images, in a folder of its own. It counts unless it places fewer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.core.config import AUTO
from gsfw.core.errors import DataError
from gsfw.preparation.camera_grouping import PANORAMA
from gsfw.preparation.choices import Choices
from gsfw.preparation.diagnosis.image_faults import FEW as FEW_FEATURES
from gsfw.preparation.diagnosis.usual import blurred_beside
from gsfw.preparation.features import FeatureReport, FeatureSettings, extract_features
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.journal import Document, Journal, identity_of
from gsfw.preparation.preparation_rule import PreparationRule
from gsfw.preparation.simpler_lenses import (
    MOST_ATTEMPTS,
    impossible_lenses,
    set_lenses,
    what_changes,
    with_simpler_lenses,
)
from gsfw.preparation.workspace import Workspace

if TYPE_CHECKING:
    from gsfw.preparation.camera_grouping import CameraGroup
    from gsfw.preparation.mapping.mapping import Mapping

MODEL = "cameras.bin"
"""A file that every model of COLMAP has."""
MISSING = 0.02
"""Part of the usable images that may lack a camera before the finest features are looked for."""
FEW_OBSERVATIONS = 100
"""Points that an image of the model has to see, on average, so that its pose is well determined:
fox's photos see 1,000, and COLMAP adds an image that sees 30."""


@dataclass(frozen=True)
class Registered:
    """The outcome of an attempt."""

    groups: Sequence[CameraGroup]
    """Cameras with the lenses that were used in the end."""
    features: dict[str, FeatureReport]
    """By name of the image."""
    mapping: Mapping
    database: Path
    """COLMAP's, with these features and their matches."""
    settings: FeatureSettings
    """Size of the images and number of features that were looked for."""
    chosen: dict[str, str]
    """Sentences on the choices of this attempt, by the name of the stage."""

    @property
    def placed(self) -> int:
        """Number of images of the largest model."""
        return self.mapping.sizes[0] if self.mapping.models else 0


def register(
    images: ImageSet,
    groups: Sequence[CameraGroup],
    place: Workspace,
    rule: PreparationRule,
    journal: Journal,
    choices: Choices,
) -> Registered:
    """Compute the cameras of as many images as possible.

    Args:
        images: all of them.
        groups: images that share a camera.
        place: the folder of the preparation.
        rule: the user's choices.
        journal: finished stages are kept there.
        choices: of the stages; those of the attempt that counts are added.

    Raises:
        DataError: COLMAP refuses what it is given, and no image is placed.
        OutputError: something cannot be written.
    """
    found = Registration(place, rule, journal, choices.say).run(images, groups)
    problem = "" if rule.thorough is not None else _shortcoming(found)
    if not problem:
        place.remove(place.thorough.attempt_folder)
    else:
        again = f"cameras: {problem}; trying again, with the finest features of all images"
        choices.choose("second attempt", again)
        # The size stays: a smaller one, chosen since the finest take longer, would be coarser.
        size, count = found.settings.max_size, found.settings.count
        closer = replace(rule, thorough=True, feature_size=size, feature_count=count)
        second = Registration(place.thorough, closer, journal, choices.say)
        found, defeat = _better(found, lambda: second.run(images, groups))
        if defeat:
            choices.choose("second attempt", f"cameras: {problem}; {defeat}")
    choices.by_stage.update(found.chosen)
    return found


def _better(first: Registered, attempt: Callable[[], Registered]) -> tuple[Registered, str]:
    """The attempt that counts, and why it is not the second one; empty if it is.

    Raises:
        DataError: COLMAP refuses the second one, and the first has placed no image.
    """
    try:
        second = attempt()
    except DataError as error:
        if not first.placed:
            raise
        return first, f"the first attempt counts, as the second one failed: {error.message}"
    if second.placed < first.placed:
        return first, "the finest features of all images place fewer"
    return second, ""


def _shortcoming(found: Registered) -> str:
    """The reason to look for the finest features of all images; empty for none."""
    if all(report.enlarged for report in found.features.values()):
        return ""  # They are in it already.
    if not found.mapping.models:
        return "no image could be placed"
    from pycolmap import Reconstruction

    model = Reconstruction(found.mapping.models[0])
    placed = {image.name for image in model.images.values() if image.has_pose}
    # What is blurred or plain stays without a camera, however closely one looks.
    hopeless = blurred_beside(found.features, placed)
    usable = {
        name
        for name, report in found.features.items()
        if report.count >= FEW_FEATURES and name not in hopeless
    }
    missing = len(usable - placed)
    if missing > MISSING * len(usable):
        return f"{missing} of {len(usable)} usable images could not be placed"
    # A view of a panorama may see nothing, and has the pose of the others.
    seen = model.compute_num_observations() / max(1, model.num_reg_frames())
    return f"an image sees only {seen:.0f} points" if seen < FEW_OBSERVATIONS else ""


class Registration:
    """One attempt; the features of ``rule.thorough``, and those of ``None`` as of ``False``."""

    def __init__(
        self,
        place: Workspace,
        rule: PreparationRule,
        journal: Journal,
        say: Callable[[str], None],
    ) -> None:
        self._place, self._rule, self._journal = place, rule, journal
        self._choices = Choices(say)
        self._thorough = bool(rule.thorough)
        self._mapping_rule = replace(rule.mapping, jobs=rule.jobs, thorough=self._thorough)
        self._images = ImageSet(())

    def run(self, images: ImageSet, groups: Sequence[CameraGroup]) -> Registered:
        """Do what is not done yet."""
        self._images = images
        settings = self._settings(images)
        features = self._features(images, groups, settings)
        self._match(images)
        groups, mapping = self._map(groups, features)
        database, chosen = self._place.database, self._choices.by_stage
        return Registered(groups, features, mapping, database, settings, chosen)

    def _named(self, stage: str, attempt: str = "") -> str:
        """Unique name of a stage in the journal."""
        return ", ".join(part for part in (stage, self._place.attempt, attempt) if part)

    def _settings(self, images: ImageSet) -> FeatureSettings:
        rule = self._rule
        settings, why = FeatureSettings.for_machine(
            images,
            rule.jobs,
            rule.feature_size,
            rule.feature_count,
            self._thorough,
            rule.machines,
        )
        self._choices.choose("features", why)
        return settings

    def _features(
        self, images: ImageSet, groups: Sequence[CameraGroup], settings: FeatureSettings
    ) -> dict[str, FeatureReport]:
        database = self._place.database

        def find() -> Document:
            reports = extract_features(database, images, groups, settings, self._rule.machines)
            return {name: asdict(report) for name, report in reports.items()}

        found = self._journal.stage(
            self._named("features"),
            {
                "images": [_identity(one) for one in images.images],
                "groups": [_stated(asdict(group)) for group in groups],
                "size": settings.max_size,
                "count": settings.count,
                "thorough": settings.thorough,
            },
            find,
            lambda: self._place.remove(*database.parent.glob("database.db*"), self._feature_log),
            lambda found: database.is_file(),
        )
        return {name: FeatureReport.of(report) for name, report in found.items()}

    @property
    def _feature_log(self) -> Path:
        return self._place.database.with_name("features.jsonl")

    def _match(self, images: ImageSet) -> None:
        from gsfw.preparation.matching import forget_matches, match_pairs
        from gsfw.preparation.pairs import plan_pairs

        rule, database = self._rule, self._place.database

        def match() -> Document:
            plan = plan_pairs(images, rule.matching, database)
            self._choices.say(plan.how)
            match_pairs(database, plan, rule.jobs, machines=rule.machines)
            return {"how": plan.how, "pairs": len(plan.pairs)}

        found = self._journal.stage(
            self._named("matches"), asdict(rule.matching), match, lambda: forget_matches(database)
        )
        self._choices.by_stage["matches"] = found["how"]

    def _map(
        self, groups: Sequence[CameraGroup], features: dict[str, FeatureReport]
    ) -> tuple[Sequence[CameraGroup], Mapping]:
        """Cameras, with simpler lenses where those that were chosen come out impossible."""
        known = tuple(one.number for one in groups if one.focal_origin == PANORAMA)
        self._mapping_rule = replace(self._mapping_rule, known_cameras=known)
        mapping = self._map_with(groups, features, "")
        is_chosen = self._rule.cameras.model == AUTO
        for attempt in range(2, MOST_ATTEMPTS + 1):
            impossible = impossible_lenses(mapping.models[0]) if mapping.models else {}
            simpler = with_simpler_lenses(groups, impossible)
            if not is_chosen or simpler == tuple(groups):
                break
            self._choices.choose("lenses", what_changes(groups, simpler))
            groups = simpler
            mapping = self._map_with(groups, features, f"attempt {attempt}")
        self._choices.choose("cameras", mapping.how)
        return groups, mapping

    def _map_with(
        self, groups: Sequence[CameraGroup], features: dict[str, FeatureReport], attempt: str
    ) -> Mapping:
        """Cameras with these lenses; ``attempt`` names stages and folder of a repetition."""
        from gsfw.preparation.mapping.mapping import Mapping, count_images, map_cameras

        place, rule = self._place, self._mapping_rule
        folder = place.models / attempt
        settings = _stated(asdict(rule))
        del settings["jobs"]

        def compute() -> Document:
            set_lenses(place.database, groups)
            return map_cameras(place.database, folder, rule).document()

        found = self._journal.stage(
            self._named("cameras", attempt),
            settings,
            compute,
            lambda: place.remove(folder),
            partial(_are_there, folder),
        )
        mapping = Mapping.of(found, folder)
        if mapping.models and mapping.sizes[0] < count_images(place.database):
            mapping = self._bridge(mapping, features, attempt)
        return mapping

    def _bridge(
        self, mapping: Mapping, features: dict[str, FeatureReport], attempt: str
    ) -> Mapping:
        """Compare what the largest model lacks with it again, more closely, and go on from it."""
        from pycolmap import Reconstruction

        from gsfw.preparation.mapping.mapping import Mapping, continue_mapping
        from gsfw.preparation.mapping.merging import bridge_pairs
        from gsfw.preparation.matching import match_more

        place, rule = self._place, self._mapping_rule
        folder = place.models / attempt

        def bridge() -> Document:
            placed = [image.name for image in Reconstruction(mapping.models[0]).images.values()]
            # A blurred image that only just fits does more harm than good in training.
            blurred = self._images.whole_shots(blurred_beside(features, placed))
            self._choices.say(
                f"cameras: the largest of {len(mapping.models)} models has {mapping.sizes[0]} "
                "images; comparing the others with it again, more closely"
            )
            pairs = [
                pair
                for pair in bridge_pairs(place.database, mapping.models)
                if not blurred.intersection(pair)
            ]
            match_more(place.database, pairs, self._rule.jobs, self._rule.machines)
            joined = continue_mapping(place.database, folder, mapping, rule, blurred)
            return joined.document()

        name = self._named("bridges", attempt)
        is_there = partial(_are_there, folder)
        return Mapping.of(self._journal.stage(name, {}, bridge, is_there=is_there), folder)


def _identity(image: SourceImage) -> list[Any]:
    """Name and content of an image, and of its mask where it has one, as plain data."""
    mask = [] if image.mask is None else identity_of(image.mask)
    return [image.name, *identity_of(image.path), *mask]


def _stated(settings: Document) -> Document:
    """Settings with a value: a new one without a value does not repeat finished stages."""
    return {name: value for name, value in settings.items() if value not in (None, ())}


def _are_there(folder: Path, found: Document) -> bool:
    """True if the models of a mapping are still in their folder."""
    return all((folder / name / MODEL).is_file() for name in found["models"])
