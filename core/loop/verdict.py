"""Verdict: judges each evaluation of a run, and says once what is not sound."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch

from gsfw.core.datamanager import Split, spread
from gsfw.core.loop.baselines import Baselines
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.findings import Evidence, Finding, judge
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.metrics import is_hidden, is_one_color, psnr
from gsfw.core.model import DensifiableModel
from gsfw.core.progress import tracked
from gsfw.core.temporal_metrics.over_time import means

logger = logging.getLogger("gsfw.run")

MOST_TRAINING_VIEWS = 8
"""Most training views that are rendered for comparison with the held-out ones."""


class Verdict:
    """Judges the evaluations of one run; changes nothing of it."""

    def __init__(
        self,
        parts: TrainingParts,
        plan: TrainingPlan,
        settings: Mapping[str, Any],
        split: Split = Split.EVAL,
    ) -> None:
        """Decodes and renders nothing.

        Args:
            parts: of the run.
            plan: of the run.
            settings: of the run, as plain data by dotted key.
            split: split of the evaluations.
        """
        assert plan.settings.background is not None
        self._parts, self._plan, self._settings, self._split = parts, plan, settings, split
        background, device = plan.settings.background, parts.device
        self.baselines = Baselines(parts.data, split, background, device)
        self._of_training = Baselines(parts.data, Split.TRAIN, background, device)
        self._most_visible = parts.refined.num_rows
        self._known: frozenset[str] = frozenset()

    @torch.no_grad()
    def judge(self, step: int, evaluation: Evaluation) -> Evaluation:
        """The evaluation with its findings; renders a few training views.

        Args:
            step: number of finished steps.
            evaluation: of the model after them. Without views, training views are judged.
        """
        held_out = bool(evaluation.views) and self._split is Split.EVAL
        sampled = evaluation
        if self._split is Split.EVAL:
            sampled = self._training_views(step, None if held_out else self._of_training)
            evaluation = replace(
                evaluation,
                training_psnr=sampled.means.get("psnr"),
                searched=evaluation.searched + sampled.searched,
                contradicted=evaluation.contradicted + sampled.contradicted,
            )
        visible = self._visible()
        evidence = Evidence(
            evaluation=evaluation if held_out else sampled,
            scene=self._parts.data.scene,
            settings=self._settings,
            step=step,
            completed=step >= self._plan.steps,
            what="held-out views" if held_out else "training views",
            rows=self._parts.refined.num_rows,
            visible=visible,
            most_visible=self._most_visible,
        )
        self._most_visible = max(self._most_visible, visible or 0)
        findings = judge(evidence)
        return replace(evaluation, findings=findings)

    def log(self, step: int, findings: tuple[Finding, ...]) -> None:
        """Log each finding when it appears, and again only after it was gone.

        Those of a completed run are no warnings: the command that shows its result states them.
        """
        level = logging.INFO if step >= self._plan.steps else logging.WARNING
        now = {finding.key: finding.message for finding in findings}
        for key, message in now.items():
            if key not in self._known:
                logger.log(level, "step %d of %d: %s", step, self._plan.steps, message)
        for key in self._known - now.keys():
            logger.info("step %d of %d: no longer found: %s", step, self._plan.steps, key)
        self._known = frozenset(now)

    def _visible(self) -> int | None:
        """Number of rows that are opaque enough for one pixel; ``None`` if unknown."""
        model = self._parts.refined
        if not isinstance(model, DensifiableModel):
            return None
        return int((model.opacities() >= self._plan.settings.profile.alpha_min).sum())

    def _training_views(self, step: int, baselines: Baselines | None) -> Evaluation:
        """PSNR of some training views, under the protocol of the evaluation."""
        parts, settings = self._parts, self._plan.settings
        assert settings.background is not None
        names = parts.data.views(Split.TRAIN).names
        indices = spread(range(len(names)), MOST_TRAINING_VIEWS)
        compared, per_view, contradicted, one_color = [], [], [], 0
        is_sought = parts.seeks_contradictions(Split.TRAIN)
        for index in tracked(indices, "comparing with training views", len(indices)):
            (batch,) = parts.data.load(Split.TRAIN, [index], parts.device)
            output = parts.render(batch.cameras, settings, batch.time).output
            batch = parts.compared(batch, output, settings.background, step)
            if is_hidden(batch.valid):
                continue
            compared.append(names[index])
            if is_sought and parts.contradicts(batch, output, settings.background, Split.TRAIN):
                contradicted.append(names[index])
            image, target = output.color[0], batch.target(settings.background)[0]
            valid = None if batch.valid is None else batch.valid[0]
            per_view.append({"psnr": psnr(image, target, valid)})
            one_color += is_one_color(image, target, valid)
            if baselines is not None:
                baselines.compare(index, target, valid, None)
        return Evaluation(
            tuple(compared),
            tuple(per_view),
            0.0,
            means(per_view),
            one_color=one_color,
            searched=len(compared) if is_sought else 0,
            contradicted=tuple(contradicted),
            baselines={} if baselines is None else baselines.document(),
        )
