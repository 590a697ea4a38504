"""Judge: accuracy of finished runs on images of one size, and their rendering times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import mean, median, quantiles

from gsfw.core.datamanager import Split
from gsfw.core.loop.determinism import deterministic
from gsfw.core.loop.evaluation import evaluate, render_model
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored, restore
from gsfw.plugins.run_source import is_dynamic
from gsfw.plugins.settings import Layer
from gsfw.studies.planned_run import PlannedRun
from gsfw.studies.result import Result, ResultStore
from gsfw.studies.tradeoff.finished_model import compared_views
from gsfw.studies.tradeoff.flip import MOST_VIEWS, flip
from gsfw.studies.tradeoff.measurement import Turn
from gsfw.studies.tradeoff.subject import Subject
from gsfw.studies.tradeoff.training.trainer import PSNR, SSIM, run_folder

DRAW_MS, DRAW_SPREAD = "draw_ms", "draw_spread_ms"
"""Figures of a result: median time to render a view, and the distance of the quartiles."""

FLIP = "judged_flip"
"""Figure of a result: mean FLIP of some held-out views in the size of the baseline's."""

TIMED_VIEWS = 3
"""Number of held-out views in a round of timing, spread evenly."""


class RunJudge:
    """Evaluates finished runs on images of the baseline's size, whatever they were trained on."""

    def __init__(self, registry: Registry, downscale: float) -> None:
        self._registry, self._downscale = registry, downscale

    def accuracy(self, run: PlannedRun, result: Result) -> Mapping[str, float]:
        """PSNR and SSIM; those of the run itself where its images had that size.

        Raises:
            DataError: the run cannot be opened.
        """
        if run.settings["downscale"] == self._downscale:
            return {PSNR: result.figures["psnr"], SSIM: result.figures["ssim"]}
        restored = self._open(result)
        parts, settings = restored.composition.parts, restored.composition.plan.settings
        with deterministic(parts.device):
            found = evaluate(parts, settings)
        parts.data.close()
        return {PSNR: found.means["psnr"], SSIM: found.means["ssim"]}

    def time(
        self,
        runs: Sequence[PlannedRun],
        store: ResultStore,
        rounds: int,
        is_over: Callable[[], bool],
    ) -> Iterator[int]:
        """Render all runs in turn and keep their times; yields the number of each round.

        Args:
            runs: that were made.
            store: of their results.
            rounds: at most; there is always one.
            is_over: whether the rounds so far have to do.

        Raises:
            DataError: a run cannot be opened.
        """
        turns = [(run, *self._turn(store.results[run.cell.key])) for run in runs]
        readings: list[list[float]] = [[] for _ in turns]
        for number in range(1, rounds + 1):
            for (_, turn, restored), taken in zip(turns, readings, strict=True):
                taken.append(turn.take(restored.composition.parts.device))
            yield number
            if is_over():
                break
        for (run, _, _), taken in zip(turns, readings, strict=True):
            known = store.results[run.cell.key]
            figures = {**known.figures, DRAW_MS: median(taken), DRAW_SPREAD: _spread(taken)}
            store.keep(replace(known, figures=figures))

    def compare(
        self, runs: Sequence[PlannedRun], store: ResultStore, is_over: Callable[[], bool]
    ) -> Iterator[int]:
        """Measure and keep FLIP of one run after the other; yields the number of finished runs.

        Args:
            runs: that were made.
            store: of their results.
            is_over: whether there is no time for another.

        Raises:
            DataError: a run cannot be opened.
        """
        for number, run in enumerate(runs, start=1):
            if is_over():
                return
            known = store.results[run.cell.key]
            store.keep(replace(known, figures={**known.figures, FLIP: self._flip(known)}))
            yield number

    def _flip(self, result: Result) -> float:
        restored = self._open(result)
        parts, settings = restored.composition.parts, restored.composition.plan.settings
        assert settings.background is not None
        found = []
        with deterministic(parts.device):
            for place in compared_views(parts.data, Split.EVAL, MOST_VIEWS, parts.device):
                (batch,) = parts.data.load(Split.EVAL, [place], parts.device)
                shown = render_model(
                    parts.model, parts.rasterizer, batch.cameras, settings, batch.time
                )
                valid = None if batch.valid is None else batch.valid[0]
                found.append(flip(shown.color[0], batch.target(settings.background)[0], valid))
        parts.data.close()
        return mean(found)

    def _turn(self, result: Result) -> tuple[Turn, Restored]:
        restored = self._open(result)
        restored.state.clear()  # With the optimizer's moments it is three times the model.
        parts, plan = restored.composition.parts, restored.composition.plan
        cameras = parts.data.views(Split.EVAL).cameras
        chosen = cameras[:: max(1, len(cameras) // TIMED_VIEWS)][:TIMED_VIEWS]
        still = not is_dynamic(restored.composition)
        subject = Subject(parts.model, parts.rasterizer, plan.settings, still)
        parts.data.close()
        return Turn.of(subject, [camera.to(parts.device) for camera in chosen]), restored

    def _open(self, result: Result) -> Restored:
        size = Layer("the baseline's size", {"downscale": self._downscale})
        return restore(run_folder(result), self._registry, changed=size)


def _spread(readings: Sequence[float]) -> float:
    """Distance of the quartiles; 0 for a single reading."""
    if len(readings) < 2:
        return 0.0
    first, _, third = quantiles(readings, n=4, method="inclusive")
    return third - first
