"""Runner: measures accuracy and size of variants one by one, then their times in turn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from statistics import mean

import torch
from torch import Tensor

from gsfw.core.datamanager import Split
from gsfw.core.errors import UserError
from gsfw.core.maths.flip import unavailable
from gsfw.studies.tradeoff.file_round_trip import FileRoundTrip, round_trips
from gsfw.studies.tradeoff.finished_model import FinishedModel, evenly
from gsfw.studies.tradeoff.flip import MOST_VIEWS, flip
from gsfw.studies.tradeoff.measurement import Exact, Turn
from gsfw.studies.tradeoff.record import Record, RecordStore, VariantKey
from gsfw.studies.tradeoff.subject import Subject
from gsfw.studies.tradeoff.variant import Variant

TIMED_VIEWS = 3
"""Number of views in a round of timing, spread evenly over the measured views."""
SLOW_MS, SLOW_ROUNDS = 1000.0, 2
"""Variants that take longer than this for a view have only this many rounds."""

Shown = tuple[Tensor, Tensor, Tensor | None]
"""A rendered view, its target, and its valid pixels."""


class Runner:
    """Measures the variants of a model; finished measurements are kept and not repeated."""

    def __init__(
        self, model: FinishedModel, variants: Sequence[Variant], store: RecordStore
    ) -> None:
        self.model, self.variants, self.store = model, variants, store

    @property
    def missing(self) -> list[Variant]:
        """Variants without a record, or without FLIP where it can be measured."""
        return [variant for variant in self.variants if self._is_missing(variant)]

    def _is_missing(self, variant: Variant) -> bool:
        record = self.store.records.get(variant.key)
        if record is None:
            return True
        return record.flip is None and not record.failure and self._has_flip

    def measure(self) -> Iterator[Variant]:
        """Measure accuracy and size of the missing variants; yields each when it is kept."""
        for variant in self.missing:
            record = self.store.records.get(variant.key) or self._record(variant)
            if self._has_flip and not record.failure:
                record = replace(record, flip=self._flip(variant.change(self.model.subject)))
            self.store.keep(record)
            yield variant

    def rounds_left(self, repeats: int) -> int:
        """Number of rounds until every variant has its readings."""
        known = [
            len(self.store.records[v.key].readings) for v in self._timed() if not self._slow(v)
        ]
        return max(0, repeats - min(known, default=repeats))

    def time(self, repeats: int) -> Iterator[int]:
        """Measure memory and times of all variants in turn; yields each round's number."""
        rounds = self.rounds_left(repeats)
        if not rounds:
            return
        model = self.model
        step = max(1, len(model.cameras) // TIMED_VIEWS)
        cameras = model.cameras[::step][:TIMED_VIEWS]
        turns: dict[VariantKey, Turn] = {}
        for variant in self._timed():
            turn = turns[variant.key] = Turn.of(variant.change(model.subject), cameras)
            record = self.store.records[variant.key]
            if record.peak_memory_mb is None:
                self.store.keep(replace(record, peak_memory_mb=turn.memory(model.device)))
        for number in range(1, rounds + 1):
            taking = [variant for variant in self._timed() if not self._slow(variant)]
            self.store.add_round({v.key: turns[v.key].take(model.device) for v in taking})
            yield number

    def _timed(self) -> list[Variant]:
        records = self.store.records
        return [v for v in self.variants if not (v.draws_alike or records[v.key].failure)]

    def _slow(self, variant: Variant) -> bool:
        """True if a slow variant has enough readings."""
        record = self.store.records[variant.key]
        return len(record.readings) >= SLOW_ROUNDS and (record.ms or 0.0) > SLOW_MS

    def _record(self, variant: Variant) -> Record:
        """Measure a variant; where it cannot be rendered, its record has the reason."""
        subject = self.model.subject
        try:
            subject = variant.change(subject)
            # The small images first: there every value is checked.
            error, per_view, failure = self._exact.error(subject), self._per_view(subject), ""
        except (ValueError, UserError) as problem:
            error, per_view, failure = None, [], " ".join(str(problem).split())
        return Record(
            axis=variant.axis,
            name=variant.name,
            per_view=per_view,
            relative_l2=None if error is None else error.relative,
            max_error=None if error is None else error.largest,
            num_gaussians=subject.num_gaussians(),
            floats=subject.num_floats(),
            parameter_bytes=subject.num_floats() * subject.float_bytes,
            file_bytes=self._files[variant.file].size(subject) if variant.file else None,
            file=variant.file,
            command=list(variant.command),
            draws_alike=variant.draws_alike,
            failure=failure,
        )

    @cached_property
    def _exact(self) -> Exact:
        return Exact(self.model.subject, self.model.probes, self.model.registry)

    @cached_property
    def _files(self) -> Mapping[str, FileRoundTrip]:
        return {trip.name: trip for trip in round_trips(self.model)}

    @cached_property
    def _has_flip(self) -> bool:
        return not unavailable()

    def _flip(self, subject: Subject) -> float:
        """FLIP of some of the views: it is slow."""
        places = evenly(len(self.model.cameras), MOST_VIEWS)
        return mean(flip(*shown) for shown in self._shown(subject, places))

    @torch.no_grad()
    def _per_view(self, subject: Subject) -> list[dict[str, float]]:
        """Metrics of every view under the run's own protocol."""
        metrics = self.model.parts.metrics
        shown = self._shown(subject, range(len(self.model.cameras)))
        return [{name: metric(*item) for name, metric in metrics.items()} for item in shown]

    def _shown(self, subject: Subject, places: Iterable[int]) -> Iterator[Shown]:
        """Rendered views with their targets."""
        chosen = list(places)
        cameras = [self.model.cameras[place] for place in chosen]
        for place, splats in zip(chosen, subject.splats_by_camera(cameras), strict=True):
            yield subject.image(splats, self.model.cameras[place]), *self._target(place)

    def _target(self, place: int) -> tuple[Tensor, Tensor | None]:
        """The photo of a view and its valid pixels; without photos, a render of the model."""
        model = self.model
        camera, subject = model.cameras[place], model.subject
        if not model.parts.data.has_images:
            (splats,) = subject.splats_by_camera([camera])
            return subject.image(splats, camera), None
        (batch,) = model.parts.data.load(Split.EVAL, [model.views[place]], model.device)
        assert subject.settings.background is not None
        valid = None if batch.valid is None else batch.valid[0]
        return batch.target(subject.settings.background)[0], valid
