"""Preparation: photos or videos become a data set, one stage after the other.

Each stage is kept in the journal, so that the same command goes on where it was stopped, and a
changed setting repeats only the stages that depend on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError
from gsfw.preparation.camera_grouping import CameraRule, group_cameras
from gsfw.preparation.diagnosis.usual import blurred_beside
from gsfw.preparation.features import (
    FeatureReport,
    FeatureSettings,
    check_wanted,
    extract_features,
)
from gsfw.preparation.frames import frames_of_videos
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.journal import Document, Journal, identity_of
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.pairs import MatchingRule
from gsfw.preparation.retrieval import check_vocabulary
from gsfw.preparation.simpler_lenses import (
    MOST_ATTEMPTS,
    impossible_lenses,
    set_lenses,
    what_changes,
    with_simpler_lenses,
)
from gsfw.preparation.source import read_source
from gsfw.preparation.workspace import Workspace
from gsfw.preparation.writing.image_output import OutputRule

if TYPE_CHECKING:
    from gsfw.preparation.camera_grouping import CameraGroup
    from gsfw.preparation.diagnosis.diagnosis import Diagnosis
    from gsfw.preparation.mapping.mapping import Mapping


MODEL = "cameras.bin"
"""A file that every model of COLMAP has."""


@dataclass(frozen=True)
class PreparationRule:
    """The user's choices."""

    frames: int = 150
    """Number of frames to take from all videos together."""
    cameras: CameraRule = field(default_factory=CameraRule)
    feature_size: int | None = None
    """Longest side of images for features, in pixels; ``None`` to choose for the machine."""
    feature_count: int | None = None
    """Most features of an image; ``None`` to choose for the machine."""
    matching: MatchingRule = field(default_factory=MatchingRule)
    mapping: MappingRule = field(default_factory=MappingRule)
    output: OutputRule = field(default_factory=OutputRule)
    jobs: int = 1
    """Number of cores. With one the same images give the same bits; with more, poses
    differ in their last digits."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ConfigError: one of them makes no sense.
        """
        if self.frames < 3:
            raise ConfigError(f"frames={self.frames}: expected at least 3.")
        check_wanted(self.feature_size, self.feature_count)
        for rule in (self.cameras, self.matching, self.mapping, self.output):
            rule.check()


@dataclass(frozen=True)
class Prepared:
    """The outcome of all stages."""

    diagnosis: Diagnosis
    written: Document
    """Document of the written data set; empty where no camera was placed."""
    chosen: Document
    """Description of the choices, by stage."""
    seconds: dict[str, float]
    """Duration of each stage in seconds, over all runs."""


class Preparation:
    """The stages, over one set of inputs; ``say`` receives lines on choices and findings."""

    def __init__(
        self,
        inputs: Sequence[Path],
        place: Workspace,
        rule: PreparationRule,
        say: Callable[[str], None],
    ) -> None:
        self._inputs, self._place, self._rule, self._say = inputs, place, rule, say
        self._journal = Journal(place.journal)
        self._chosen: Document = {}

    def run(self) -> Prepared:
        """Do what is not done yet.

        Raises:
            DataError: there is no usable image, or COLMAP refuses what it is given.
            ConfigError: a setting does not go with the images.
            OutputError: something cannot be written.
        """
        from gsfw.preparation.diagnosis.diagnosis import diagnose

        if self._rule.matching.vocabulary is not None:
            check_vocabulary(self._rule.matching.vocabulary)
        images = self._images()
        groups: Sequence[CameraGroup] = group_cameras(images, self._rule.cameras)
        features = self._features(images, groups)
        self._match(images)
        groups, mapping = self._map(groups, features)
        written = self._write(images, mapping)
        diagnosis = diagnose(self._place.database, images, groups, features, mapping)
        return Prepared(diagnosis, written, self._chosen, self._journal.seconds)

    def _choose(self, stage: str, text: str) -> None:
        self._chosen[stage] = text
        self._say(text)

    def _images(self) -> ImageSet:
        source = read_source(self._inputs, self._place.path)
        for note in source.notes:
            self._say(f"note: {note}")
        if not source.videos:
            return source.images
        photos = source.images.images
        frames = frames_of_videos(
            source.videos, self._rule.frames, photos, self._place, self._journal, self._say
        )
        return replace(
            source.images,
            images=(*photos, *frames),
            in_order=not photos,
        )

    def _features(
        self, images: ImageSet, groups: Sequence[CameraGroup]
    ) -> dict[str, FeatureReport]:
        rule = self._rule
        settings, why = FeatureSettings.for_machine(
            images, rule.jobs, rule.feature_size, rule.feature_count
        )
        self._choose("features", why)
        database = self._place.database

        def find() -> Document:
            reports = extract_features(database, images, groups, settings)
            return {name: asdict(report) for name, report in reports.items()}

        found = self._journal.stage(
            "features",
            {
                "images": [[one.name, *identity_of(one.path)] for one in images.images],
                "groups": [asdict(group) for group in groups],
                "size": settings.max_size,
                "count": settings.count,
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
            self._say(plan.how)
            match_pairs(database, plan, rule.jobs)
            return {"how": plan.how, "pairs": len(plan.pairs)}

        found = self._journal.stage(
            "matches", asdict(rule.matching), match, lambda: forget_matches(database)
        )
        self._chosen["matches"] = found["how"]

    def _map(
        self, groups: Sequence[CameraGroup], features: dict[str, FeatureReport]
    ) -> tuple[Sequence[CameraGroup], Mapping]:
        """Cameras, with simpler lenses where those that were chosen come out impossible."""
        mapping = self._map_with(groups, features, "")
        is_chosen = self._rule.cameras.model == AUTO
        for attempt in range(2, MOST_ATTEMPTS + 1):
            impossible = impossible_lenses(mapping.models[0]) if mapping.models else {}
            simpler = with_simpler_lenses(groups, impossible)
            if not is_chosen or simpler == tuple(groups):
                break
            self._choose("lenses", what_changes(groups, simpler))
            groups = simpler
            mapping = self._map_with(groups, features, f"attempt {attempt}")
        self._choose("cameras", mapping.how)
        return groups, mapping

    def _map_with(
        self, groups: Sequence[CameraGroup], features: dict[str, FeatureReport], attempt: str
    ) -> Mapping:
        """Cameras with these lenses; ``attempt`` names stages and folder of a repetition."""
        from gsfw.preparation.mapping.mapping import Mapping, count_images, map_cameras

        place, rule = self._place, self._mapping_rule
        folder = place.models / attempt
        settings = {name: value for name, value in asdict(rule).items() if name != "jobs"}

        def compute() -> Document:
            set_lenses(place.database, groups)
            return map_cameras(place.database, folder, rule).document()

        found = self._journal.stage(
            f"cameras, {attempt}" if attempt else "cameras",
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
            blurred = blurred_beside(features, placed)
            self._say(
                f"cameras: the largest of {len(mapping.models)} models has {mapping.sizes[0]} "
                "images; comparing the others with it again, more closely"
            )
            pairs = [
                pair
                for pair in bridge_pairs(place.database, mapping.models)
                if not blurred.intersection(pair)
            ]
            match_more(place.database, pairs, rule.jobs)
            joined = continue_mapping(place.database, folder, mapping, rule, blurred)
            return joined.document()

        name = f"bridges, {attempt}" if attempt else "bridges"
        is_there = partial(_are_there, folder)
        return Mapping.of(self._journal.stage(name, {}, bridge, is_there=is_there), folder)

    @property
    def _mapping_rule(self) -> MappingRule:
        return replace(self._rule.mapping, jobs=self._rule.jobs)

    def _write(self, images: ImageSet, mapping: Mapping) -> Document:
        from gsfw.preparation.writing.data_set import write_data_set
        from gsfw.preparation.writing.written_files import is_all_there

        place, rule = self._place, self._rule.output

        def write() -> Document:
            from pycolmap import Reconstruction

            if not mapping.models:
                return {}
            model = Reconstruction(mapping.models[0])
            written = write_data_set(model, images, place.path, rule, self._rule.jobs)
            return asdict(written)

        return self._journal.stage(
            "data set",
            asdict(rule),
            write,
            lambda: place.remove(place.images, place.sparse, place.report, place.sheet),
            lambda written: not mapping.models or is_all_there(place.path),
        )


def _are_there(folder: Path, found: Document) -> bool:
    """True if the models of a mapping are still in their folder."""
    return all((folder / name / MODEL).is_file() for name in found["models"])
