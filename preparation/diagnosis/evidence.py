"""Evidence: all that is known of a capture after its cameras were computed, or could not be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.diagnosis.inquiry import why_unregistered
from gsfw.preparation.diagnosis.match_graph import Bridge, Component, MatchGraph
from gsfw.preparation.diagnosis.model_figures import ModelFigures
from gsfw.preparation.diagnosis.unplaced_panoramas import by_panorama
from gsfw.preparation.diagnosis.unregistered import Unregistered
from gsfw.preparation.diagnosis.usual import Usual
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.native import readable_native_errors


@dataclass(frozen=True)
class Evidence:
    """All inputs of the findings."""

    images: ImageSet
    groups: Sequence[CameraGroup]
    features: Mapping[str, FeatureReport]
    graph: MatchGraph
    models: tuple[frozenset[str], ...]
    """Names of the images in each, the largest first."""
    figures: ModelFigures | None
    """Figures of the largest model; ``None`` without a model."""

    @staticmethod
    def gather(
        database: Path,
        images: ImageSet,
        groups: Sequence[CameraGroup],
        features: Mapping[str, FeatureReport],
        models: Sequence[Path],
    ) -> Evidence:
        """Read matches and models.

        Raises:
            DataError: they cannot be read.
        """
        from pycolmap import Reconstruction

        with readable_native_errors("read the models", database):
            loaded = [Reconstruction(path) for path in models]
        return Evidence(
            images=images,
            groups=groups,
            features=features,
            graph=MatchGraph.read(database, images),
            models=tuple(
                frozenset(model.image(number).name for number in model.reg_image_ids())
                for model in loaded
            ),
            figures=ModelFigures.of(loaded[0], groups) if loaded else None,
        )

    @property
    def given(self) -> int:
        """Number of images, including those that do not decode."""
        return len(self.graph.names)

    @property
    def has_own_focals(self) -> bool:
        """True if images surely have another focal length than their camera."""
        return self.figures is not None and bool(self.figures.own_focals)

    @cached_property
    def registered(self) -> tuple[str, ...]:
        """Images that the largest model has, in the order of the set."""
        placed = self.models[0] if self.models else frozenset()
        return tuple(name for name in self.graph.names if name in placed)

    @cached_property
    def usual(self) -> Usual:
        """Typical figures of good images of this capture."""
        return Usual.of(self.features, self.registered)

    @cached_property
    def unregistered(self) -> tuple[Unregistered, ...]:
        """The other photos, and the panoramas without a place, each once."""
        one_focal = any(len(group.images) > 1 and not group.focal_origin for group in self.groups)
        images, features, graph = self.images, self.features, self.graph
        found = why_unregistered(images, features, graph, self.models, one_focal)
        return by_panorama(found, images, features, graph, self.registered)

    def count_shots(self, names: Iterable[str]) -> int:
        """Number of photos and panoramas that some images are, or are views of."""
        return len({self.images.by_name[name].shot for name in names})

    @cached_property
    def noun(self) -> str:
        """The word for these, in the plural."""
        views = sum(image.view is not None for image in self.images.images)
        if not views:
            return "images"
        return "panoramas" if views == len(self.images.images) else "photos and panoramas"

    @cached_property
    def components(self) -> tuple[Component, ...]:
        """Components of images that match."""
        return self.graph.components(self.registered)

    @cached_property
    def bridges(self) -> tuple[Bridge, ...]:
        """Bridges between the components."""
        return self.graph.bridges(self.components)
