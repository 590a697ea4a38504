"""Findings: the signs that a result is not sound, each with its cause and its remedy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gsfw.core.config import NO_BUDGET
from gsfw.core.loop.distractors import KEPT_PSNR
from gsfw.core.scene import Scene
from gsfw.core.words import listed, shell_argument

if TYPE_CHECKING:
    from gsfw.core.loop.evaluation import Evaluation

ONE_COLOR_SHARE = 0.5
"""Share of the views that have to be one colour: single views may show the background alone."""

MARGIN = 0.5
"""A result has to beat an image without a model by this, in dB. Measured: sound runs of 500 to
1000 steps 5 to 18 dB; chair with shuffled images 0.4 dB below the mean image."""

SETTLED = 300
"""Steps before which figures are not judged: random Gaussians are worse than one colour at first.
Measured: mujoco_texture after 100, 200 and 300 steps 4.0, 1.1 and 0.0 dB below it, chair sound at
500. A render of one colour is judged at once."""

FEW_VISIBLE, LOW_SHARE = 10, 0.05
"""Gaussians die if so few, or so small a part of the most there were, can be seen. The second alone
is no sign: thinned models are sound. It counts where the result is poor."""

GAP = 10.0
"""Training views may be better than held-out ones by this, in dB. Measured after 1000 steps: 2.0 dB
(plush, 84 views), 2.5 (fox, 43), 7.4 (fox, 13), 20.3 (fox, 5); 17 dB where cameras were wrong."""

FEWEST_CONTRADICTED, CONTRADICTED_SHARE = 2, 0.05
"""Number, and part of the searched images, that have to be contradicted by the others. Where it is
fewer, deleting these photos is the better remedy."""

FEW_VIEWS = 12
"""Number of training views up to which their number is the likely cause of such a gap."""


@dataclass(frozen=True)
class Finding:
    """One sign that a result is not sound."""

    key: str
    """Name for programs, such as ``one-color``."""
    message: str
    """Sign, cause and remedies, as sentences."""
    is_collapse: bool = True
    """True if the result shows next to nothing; false if it is good on training views alone."""

    def document(self) -> dict[str, str | bool]:
        """Plain data for result files."""
        return {"key": self.key, "collapse": self.is_collapse, "message": self.message}


@dataclass(frozen=True)
class Evidence:
    """The figures that findings are based on."""

    evaluation: Evaluation
    scene: Scene
    settings: Mapping[str, Any]
    """Every setting of the run as plain data, by dotted key."""
    step: int
    """Number of finished steps."""
    completed: bool
    """False while the run may still improve."""
    what: str = "held-out views"
    """The evaluated views, in words."""
    rows: int = 0
    visible: int | None = None
    """Number of rows that can be seen at all; ``None`` if the model does not say."""
    most_visible: int = 0
    """Most such rows at any evaluation of the run, or at its start."""

    def figure(self, name: str) -> float | None:
        """A mean over the views, or a baseline; ``None`` if not measured."""
        found = self.evaluation.means.get(name, self.evaluation.baselines.get(name))
        return found if isinstance(found, float) else None

    @property
    def is_settled(self) -> bool:
        """True if the figures can be judged."""
        return self.completed or self.step >= SETTLED

    @property
    def is_poor(self) -> bool:
        """True if the views are hardly better than a constant image."""
        psnr, constant = self.figure("psnr"), self.figure("constant_psnr")
        return psnr is not None and constant is not None and psnr < constant + MARGIN

    @property
    def is_one_color(self) -> bool:
        """True if most views are rendered in one colour."""
        count = len(self.evaluation.views)
        return count > 0 and self.evaluation.one_color >= max(ONE_COLOR_SHARE * count, 1)


def judge(evidence: Evidence) -> tuple[Finding, ...]:
    """All signs that a result is not sound, the gravest first; empty for a sound result."""
    found = [_one_color(evidence)]
    if evidence.is_settled:
        found += [
            _no_better_than_baseline(evidence),
            _dying_gaussians(evidence),
            _motion_not_found(evidence),
            _overfitting(evidence) or _distractors(evidence),
        ]
    return tuple(finding for finding in found if finding is not None)


def _one_color(evidence: Evidence) -> Finding | None:
    if not evidence.is_one_color:
        return None
    evaluation, psnr = evidence.evaluation, evidence.figure("psnr")
    constant = evidence.figure("constant_psnr")
    figures = ""
    if psnr is not None and constant is not None:
        figures = f"PSNR is {psnr:.2f} dB, and that of the best single colour {constant:.2f} dB. "
    return Finding(
        "one-color",
        f"{evaluation.one_color} of {len(evaluation.views)} {evidence.what} are rendered as "
        f"(nearly) one colour, and their images are not. {figures}"
        "The Gaussians have vanished into the background, or no camera sees them. "
        + _try([_longer(evidence), *_against_vanishing(evidence), _check(evidence)]),
    )


def _no_better_than_baseline(evidence: Evidence) -> Finding | None:
    """Compare with a constant image, and the result of a static capture with a mean image too.

    A single fixed camera would make the mean image of a moving scene hard to beat.
    """
    psnr, best = evidence.figure("psnr"), evidence.figure("constant_psnr")
    if evidence.is_one_color or psnr is None or best is None:
        return None
    name, mean_image = "a single colour", evidence.figure("mean_image_psnr") or 0.0
    judged = evidence.completed and evidence.step >= SETTLED and not evidence.scene.is_dynamic
    if judged and mean_image > best:
        best, name = mean_image, "the mean of the training images"
    if psnr >= best + MARGIN:
        return None
    still = evidence.scene.is_dynamic and evidence.settings.get("ignore_time")
    cause = "the model stands still and the scene moves" if still else "training was too short"
    return Finding(
        "no-better-than-baseline",
        f"the {evidence.what} have {psnr:.2f} dB, and {name} would have {best:.2f} dB: the renders "
        f"are hardly better than that. Either {cause}, or the cameras do not fit the images. "
        + _try([_longer(evidence), _check(evidence), *_against_vanishing(evidence)]),
    )


def _dying_gaussians(evidence: Evidence) -> Finding | None:
    visible, most = evidence.visible, evidence.most_visible
    if visible is None or most <= FEW_VISIBLE:
        return None
    poor = evidence.is_poor or evidence.is_one_color
    if visible > FEW_VISIBLE and not (poor and visible < LOW_SHARE * most):
        return None
    remedies, budget = [], evidence.settings.get("strategy.budget", NO_BUDGET)
    if budget != NO_BUDGET:
        remedies.append(f"a larger budget (this run: strategy.budget={budget})")
    if evidence.settings.get("strategy.reset_every"):
        remedies.append("no opacity resets (strategy.reset_every=0)")
    if evidence.settings.get("opacity_penalty"):
        remedies.append("no opacity penalty (opacity_penalty=0)")
    return Finding(
        "dying-gaussians",
        f"{visible:,} of {evidence.rows:,} Gaussians are opaque enough to be seen, after {most:,} "
        "before: more of them vanish than are added. "
        + _try([*remedies, *_against_vanishing(evidence), _check(evidence)]),
    )


def _motion_not_found(evidence: Evidence) -> Finding | None:
    """Compare what moves with a constant image, and a completed run with a still image too."""
    moving, constant = evidence.figure("moving_psnr"), evidence.figure("constant_moving_psnr")
    still = evidence.figure("still_moving_psnr")
    asked_for = bool(evidence.settings.get("ignore_time"))
    if moving is None or constant is None or asked_for or evidence.is_one_color:
        return None
    best, name = constant, "a single colour"
    if evidence.completed and still is not None and still > constant:
        best, name = still, "the mean of each camera's training images"
    if moving >= best + MARGIN:
        return None
    return Finding(
        "motion-not-found",
        f"the moving region has {moving:.2f} dB, and {name} would have {best:.2f} dB there: "
        "(nearly) no motion is reconstructed. Parts that are present for a short time vanish "
        "first. " + _try([_longer(evidence), *_against_vanishing(evidence), "another method"]),
    )


def _overfitting(evidence: Evidence) -> Finding | None:
    training, kept = evidence.evaluation.training_psnr, evidence.figure(KEPT_PSNR)
    psnr = evidence.figure("psnr") if kept is None else kept
    where = "" if kept is None else " in the pixels that are kept"
    if training is None or psnr is None or training - psnr < GAP:
        return None
    remedies = ["more views"]
    count = len(evidence.scene.camera_centers)
    if not evidence.settings.get("opacity_penalty", 1.0):
        remedies.append("opacity_penalty=0.03")
    if not evidence.scene.is_dynamic and evidence.settings.get("init") != "dense":
        remedies.append("init=dense")
    if evidence.settings.get("refine_poses"):
        cause = "held-out cameras are not refined with the training ones (refine_poses=true)"
    elif count <= FEW_VIEWS:
        cause = f"there are only {count} training views"
    else:
        cause = "cameras that are misplaced or have a wrong focal length, or too few views"
    return Finding(
        "overfitting",
        f"training views have {training:.1f} dB and {evidence.what} {psnr:.1f} dB{where}: the "
        f"model overfits the training images. Likely cause: {cause}. "
        + _try([_check(evidence), *remedies]),
        is_collapse=False,
    )


def _distractors(evidence: Evidence) -> Finding | None:
    """Judge completed runs alone: places that are learnt late would be taken for distractors.

    Renders of held-out views say nothing of the images where the model overfits.
    """
    names, searched = evidence.evaluation.contradicted, evidence.evaluation.searched
    is_learnt = evidence.completed and evidence.step >= SETTLED
    if not is_learnt or evidence.is_poor or evidence.is_one_color:
        return None
    if len(names) < max(FEWEST_CONTRADICTED, CONTRADICTED_SHARE * searched):
        return None
    cause, remedies = "", ["ignore_distractors=true", "masks (datamanager.masks=DIR)"]
    if not evidence.settings.get("exposure"):
        cause = "their exposure or light differs, or "
        remedies.append("exposure=true")
    return Finding(
        "distractors",
        f"{len(names)} of {searched} compared images show something large that the other images "
        f"contradict ({listed(names)}). Likely cause: people, cars or other "
        f"things that moved between the photos; else {cause}those cameras are misplaced. "
        + _try([*remedies, _check(evidence)]),
        is_collapse=False,
    )


def _against_vanishing(evidence: Evidence) -> list[str]:
    """Settings that keep Gaussians from taking the colour of the background."""
    settings, steps = evidence.settings, evidence.settings.get("steps", 0)
    found = []
    if evidence.scene.is_dynamic and settings.get("squared_steps", steps) < steps // 2:
        found.append(f"squared_steps={steps // 2}")
    if evidence.scene.has_alpha and not settings.get("random_background"):
        found.append("random_background=true")
    number = settings.get("random_points")
    if not len(evidence.scene.points) and isinstance(number, int) and number > 20_000:
        found.append("fewer random points (random_points=20000)")
    return found


def _longer(evidence: Evidence) -> str:
    return f"more steps (this run: {evidence.settings.get('steps', 'few')})"


def _check(evidence: Evidence) -> str:
    data = evidence.settings.get("data")
    return (
        f"gsfw check {shell_argument(data)}, for cameras that do not fit"
        if data
        else "other settings"
    )


def _try(remedies: list[str]) -> str:
    return f"Try, one by one: {'; '.join(dict.fromkeys(remedies))}."
