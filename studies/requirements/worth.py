"""Worth: PSNR that parts of a finished model gain, measured by rendering without them.

Nothing is trained anew: a model that is trained without a part from the start makes up for some of
it, so that these gains are rather too large than too small.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.capabilities import Feature
from gsfw.core.contributions import Contributions, most_useful_part
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.requirements import LeastUseful, Motion
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.metrics import psnr
from gsfw.core.splats import Sh, Splats
from gsfw.studies.tradeoff.edits import Kept, ShTruncation
from gsfw.studies.tradeoff.finished_model import compared_views
from gsfw.studies.tradeoff.subject import Edit, Subject

MOST_VIEWS = 8
"""Most views for PSNR, spread evenly over the held-out ones."""
MOST_CAMERAS = 24
"""Most training views for contributions, spread evenly."""
PARTS = (0.1, 0.25, 0.5)
"""Parts of the Gaussians, the least useful ones, that are left out."""
STILL_TIME = 0.5
"""Time at which a moving model is held still: the middle of the sequence."""


@dataclass(frozen=True)
class Worth:
    """PSNR on some views, and its loss without parts of the model."""

    views: tuple[str, ...]
    split: Split
    psnr: float
    bands: tuple[float, ...]
    """Gain of each SH band above the constant one, from band 1 on, in dB."""
    least_useful: tuple[LeastUseful, ...]
    """Gains of the least useful Gaussians; empty where contributions cannot be measured."""
    motion: Motion | None
    """Gain of motion; ``None`` for data without times."""

    @staticmethod
    @torch.no_grad()
    def of(subject: Subject, data: DataManager, device: torch.device) -> Worth:
        """Measure; the model is not changed.

        Args:
            subject: the model as it is.
            data: it was trained on.
            device: where it is drawn.

        Raises:
            DataError: an image does not decode.
        """
        moves = not subject.is_still
        split, chosen = Split.EVAL, compared_views(data, Split.EVAL, MOST_VIEWS, device)
        if not chosen:
            split, chosen = Split.TRAIN, compared_views(data, Split.TRAIN, MOST_VIEWS, device)
        names = data.views(split).names
        still = torch.tensor(STILL_TIME, device=device)
        camera = data.views(split).cameras[chosen[0]].to(device)
        degree = _drawn_degree(subject.splats(still, camera))
        scores = _scores(subject, data, device)
        variants: list[Edit] = [
            lambda splats, camera: splats,
            *(ShTruncation(lower) for lower in reversed(range(degree))),
            *(Kept(most_useful_part(scores, 1 - part)) for part in _parts(scores)),
        ]
        batches = _photos(data, split, chosen, device)
        found = _psnr(subject, batches, variants, still if moves else None)
        whole, pruned = found[0], found[1 + degree :]
        steps = pairwise(found[: degree + 1])
        return Worth(
            views=tuple(names[index] for index in chosen),
            split=split,
            psnr=whole,
            bands=tuple(above - below for above, below in steps)[::-1],
            least_useful=tuple(
                LeastUseful(part, _share(scores, part), whole - left)
                for part, left in zip(_parts(scores), pruned, strict=False)
            ),
            motion=Motion(whole - found[-1], STILL_TIME) if moves else None,
        )


def _drawn_degree(splats: Splats) -> int:
    """The highest SH degree in use."""
    colors = splats.colors
    return min(colors.degree, degree_of(colors.width)) if isinstance(colors, Sh) else 0


def _scores(subject: Subject, data: DataManager, device: torch.device) -> Float[Tensor, " n"]:
    """Contribution of each row to the training views; empty where it cannot be measured."""
    if Feature.CONTRIBUTION not in subject.rasterizer.capabilities().features:
        return torch.zeros(0, dtype=torch.float64)
    cameras = [camera.to(device) for camera in data.views(Split.TRAIN).cameras]
    rows, rasterizer, settings = subject.model.num_rows, subject.rasterizer, subject.settings
    return Contributions.of(
        subject.splats, rows, cameras, rasterizer, settings, most=MOST_CAMERAS
    ).total.to(device)


def _parts(scores: Float[Tensor, " n"]) -> Sequence[float]:
    return PARTS if len(scores) else ()


def _share(scores: Float[Tensor, " n"], part: float) -> float:
    """Part of the whole contribution that the least useful rows hold."""
    total, kept = scores.sum(), scores[most_useful_part(scores, 1 - part)].sum()
    return float((total - kept) / total.clamp_min(1e-30))


def _photos(
    data: DataManager, split: Split, views: Sequence[int], device: torch.device
) -> Iterator[Batch]:
    """The photos of some views, one at a time."""
    for place, view in enumerate(views):
        data.prefetch(split, views[place + 1 : place + 3])
        yield from data.load(split, [view], device)


def _psnr(
    subject: Subject, batches: Iterable[Batch], variants: Sequence[Edit], still: Tensor | None
) -> list[float]:
    """Mean PSNR of each variant over the views, and last of the model at the time ``still``."""
    background = subject.settings.background
    assert background is not None
    found: list[list[float]] = []
    for batch in batches:
        target = batch.target(background)[0]
        valid = None if batch.valid is None else batch.valid[0]
        camera = batch.cameras
        splats = subject.splats(batch.time, camera)
        drawn = [edit(splats, camera) for edit in variants]
        drawn += [] if still is None else [subject.splats(still, camera)]
        images = (subject.image(item, camera) for item in drawn)
        found.append([psnr(image, target, valid) for image in images])
    return [sum(values) / len(values) for values in zip(*found, strict=True)]
