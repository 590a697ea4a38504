"""Preparation: photos or videos become a data set, one stage after the other.

Each stage is kept in the journal, so that the same command continues where it was stopped, and a
changed setting repeats only the stages that depend on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.preparation.camera_grouping import group_cameras
from gsfw.preparation.choices import Choices
from gsfw.preparation.frames import frames_of_videos
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.journal import Document, Journal
from gsfw.preparation.panorama_cutting import cut_panoramas
from gsfw.preparation.preparation_rule import PreparationRule
from gsfw.preparation.registration import register
from gsfw.preparation.retrieval import check_vocabulary
from gsfw.preparation.source import read_source
from gsfw.preparation.workspace import Workspace

if TYPE_CHECKING:
    from gsfw.preparation.diagnosis.diagnosis import Diagnosis
    from gsfw.preparation.mapping.mapping import Mapping


@dataclass(frozen=True)
class Prepared:
    """The outcome of all stages."""

    diagnosis: Diagnosis
    written: Document
    """Document of the written data set; empty where no camera was placed."""
    chosen: dict[str, str]
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
        self._choices = Choices(say)

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
        self._rule.panoramas.masks.check(self._inputs)
        images = self._images()
        groups = group_cameras(images, self._rule.cameras)
        found = register(images, groups, self._place, self._rule, self._journal, self._choices)
        written = self._write(images, found.mapping)
        diagnosis = diagnose(found.database, images, found.groups, found.features, found.mapping)
        return Prepared(diagnosis, written, self._choices.by_stage, self._journal.seconds)

    def _images(self) -> ImageSet:
        masks = self._rule.panoramas.masks.path
        apart = [self._place.path] if masks is None else [self._place.path, masks]
        source = read_source(self._inputs, apart, self._place.photos)
        for note in source.notes:
            self._say(f"note: {note}")
        images = source.images
        if source.videos:
            photos = images.images
            frames = frames_of_videos(
                source.videos, self._rule.frames, photos, self._place, self._journal, self._say
            )
            images = replace(images, images=(*photos, *frames), in_order=not photos)
        return cut_panoramas(images, self._rule.panoramas, self._place.views, self._choices)

    def _write(self, images: ImageSet, mapping: Mapping) -> Document:
        from gsfw.preparation.writing.data_set import write_data_set
        from gsfw.preparation.writing.written_files import is_all_there

        place, rule, layout = self._place, self._rule.output, self._rule.layout

        def write() -> Document:
            from pycolmap import Reconstruction

            if not mapping.models:
                return {}
            model = Reconstruction(mapping.models[0])
            written = write_data_set(model, images, place.path, rule, self._rule.jobs, layout)
            return asdict(written)

        return self._journal.stage(
            "data set",
            {**asdict(rule), "layout": layout},
            write,
            lambda: place.remove(place.images, place.sparse, place.report, place.sheet),
            lambda written: not mapping.models or is_all_there(place.path),
        )
