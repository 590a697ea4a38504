"""WrittenDataSet: what there is in a data set that was written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gsfw.preparation.writing.camera_plan import CameraPlan, lens_words


@dataclass(frozen=True)
class WrittenDataSet:
    """What was written."""

    layout: str
    """colmap or transforms."""
    pictures: int
    masks: int
    points: int
    sizes: tuple[tuple[int, int], ...]
    """Width and height of the written pictures, the most frequent first."""
    lens: str
    """What became of the lenses, in words."""
    bytes: int
    """Of all files that training reads."""
    notes: tuple[str, ...]
    """What the layout cannot hold, and what else its user should know."""

    @staticmethod
    def of(
        layout: str,
        plans: Sequence[CameraPlan],
        masks: int,
        points: int,
        size: int,
        notes: Iterable[str],
    ) -> WrittenDataSet:
        """Count it up.

        Args:
            layout: colmap or transforms.
            plans: of every picture.
            masks: how many there are.
            points: likewise.
            size: bytes of all files that training reads.
            notes: sentences.
        """
        sizes = Counter((plan.target.width, plan.target.height) for plan in plans)
        return WrittenDataSet(
            layout=layout,
            pictures=len(plans),
            masks=masks,
            points=points,
            sizes=tuple(found for found, _ in sizes.most_common()),
            lens=lens_words(plans),
            bytes=size,
            notes=tuple(notes),
        )
