"""Editable: what is edited, in the world of the data: splats, or a model at all its times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from gsfw.core.contributions import Contributions
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.axes import known_axis
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Sh, Splats
from gsfw.editing import colors
from gsfw.editing.capture import Capture
from gsfw.editing.colors import ColorMap
from gsfw.editing.transforms import composed, up_after

Test = Callable[[Splats], Bool[Tensor, " n"]]
"""Chooses among splats, which are in the world of the data with quaternions and scales."""
SAMPLE = 20_000
"""Splats in a file whose size gives the bytes of each."""


class Editable(ABC):
    """Splats or a model to be edited. Every edit returns the edited one."""

    moved: Similarity
    """The transform from the world before all edits to the one of now."""
    up: str
    """Upward direction in the world of now ("z", "-y"); empty when unknown."""
    in_place: ClassVar[bool]
    """True if edits change it in place, and rows can be left out, but not added or merged."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of Gaussians."""

    @property
    @abstractmethod
    def degree(self) -> int:
        """SH degree of the colours."""

    @abstractmethod
    def capture(self) -> Capture:
        """The cameras that saw it.

        Raises:
            DataError: they cannot be had.
        """

    @abstractmethod
    def splats(self) -> Splats:
        """The splats in the world of now, in float64 on the CPU; of a model at one time."""

    @abstractmethod
    def scene_splats(self) -> Splats:
        """The splats in the scene frame of the capture, in float32, to be rendered."""

    @abstractmethod
    def as_file(self) -> SplatFile | None:
        """The content of a file of splats; ``None`` for a model, which its run stores."""

    @abstractmethod
    def file_bytes(self, num_bytes: Callable[[Editable], int]) -> tuple[float, float]:
        """Bytes of a file of it: of all that is no row, and of each row, which may be 0.

        Args:
            num_bytes: measures the file of what it is given.
        """

    @abstractmethod
    def chosen(self, test: Test, ever: bool = False) -> Bool[Tensor, " n"]:
        """The rows that pass a test: of a model at any time when they are seen, or at all of them.

        Args:
            test: the test.
            ever: true if a row passes that does at any time, even when it is too faint to be seen.
        """

    @abstractmethod
    def contributions(self) -> Contributions:
        """Measure the contributions of each row to the views of the capture."""

    @abstractmethod
    def keep(self, rows: Bool[Tensor, " n"]) -> Editable:
        """Leave out all other rows."""

    @abstractmethod
    def with_splats(self, splats: Splats) -> Editable:
        """Replace the splats by others of the same world.

        Raises:
            ConfigError: it is changed in place.
        """

    @abstractmethod
    def can_refit(self) -> bool:
        """True if ``with_constants`` changes what is seen in all views."""

    @abstractmethod
    def with_constants(self, dc: Float[Tensor, "n 3"]) -> Editable:
        """Replace the constant SH coefficients."""

    @abstractmethod
    def transformed(self, similarity: Similarity) -> Editable:
        """Move to another world, together with the capture's cameras."""

    @abstractmethod
    def with_up(self, axis: str) -> Editable:
        """State the upward direction."""

    @abstractmethod
    def recolored(self, change: ColorMap) -> Editable:
        """Change all colours.

        Raises:
            ConfigError: the model makes its colours in a way that cannot be changed.
        """

    @abstractmethod
    def truncated(self, degree: int) -> Editable:
        """Leave out the SH bands above a degree."""

    def world_from_scene(self) -> Similarity:
        """From the scene frame of the capture to the world of now."""
        return composed(self.moved, self.capture().world_from_scene)

    def upward(self) -> Float64[Tensor, " 3"] | None:
        """The upward direction in the world of now; ``None`` when unknown."""
        return known_axis(self.up)


@dataclass(frozen=True)
class EditableSplats(Editable):
    """Splats of a file, or of a run at one time."""

    content: SplatFile
    """The splats, in the world of now."""
    open_capture: Callable[[], Capture]
    """Opens the capture; it may cost seconds, and is called only where an edit needs it."""
    moved: Similarity
    in_place: ClassVar[bool] = False

    @property
    def up(self) -> str:  # type: ignore[override]
        """The up direction that the file states."""
        return self.content.up

    def __len__(self) -> int:
        return len(self.content.splats)

    @property
    def degree(self) -> int:
        """SH degree of the colours."""
        return self.content.splats.sh_degree

    def capture(self) -> Capture:
        """The cameras that saw it, rendered as the file asks."""
        capture = self.open_capture()
        settings = replace(capture.settings, antialias=self.content.antialiased)
        return replace(capture, settings=settings)

    def splats(self) -> Splats:
        """The splats."""
        return self.content.splats

    def scene_splats(self) -> Splats:
        """The splats in the scene frame of the capture, in float32, to be rendered."""
        inverse = self.world_from_scene().inverse()
        splats = transform_splats(self.content.splats, inverse).map(torch.Tensor.float)
        return splats.to(self.capture().device)

    def as_file(self) -> SplatFile:
        """The splats."""
        return self.content

    def file_bytes(self, num_bytes: Callable[[Editable], int]) -> tuple[float, float]:
        """Bytes by the sizes of two files, of a sample of the rows and of a half of it."""
        count = min(len(self), SAMPLE)
        # A refusal of all rows counts more of them than one of a half would.
        whole, half = (num_bytes(self._sample(part)) for part in (count, max(1, count // 2)))
        each = (whole - half) / max(count - count // 2, 1)
        return whole - count * each, each

    def _sample(self, count: int) -> EditableSplats:
        """Some of the splats, evenly over their rows."""
        rows = torch.linspace(0, len(self) - 1, count).round().long()
        return self.with_splats(self.content.splats.take(rows))

    def chosen(self, test: Test, ever: bool = False) -> Bool[Tensor, " n"]:
        """The rows that pass a test."""
        return test(self.content.splats)

    def contributions(self) -> Contributions:
        """Measure the contributions of each splat to the views of the capture."""
        splats = self.scene_splats()
        return self.capture().contributions(lambda time, camera: splats, len(self))

    def keep(self, rows: Bool[Tensor, " n"]) -> EditableSplats:
        """Leave out all other rows."""
        return self.with_splats(self.content.splats.take(rows.nonzero()[:, 0]))

    def with_splats(self, splats: Splats) -> EditableSplats:
        """Other splats of the same world."""
        return replace(self, content=replace(self.content, splats=splats))

    def can_refit(self) -> bool:
        """True for SH colours."""
        return isinstance(self.content.splats.colors, Sh)

    def with_constants(self, dc: Float[Tensor, "n 3"]) -> EditableSplats:
        """Replace the constant coefficients, which rotations leave as they are."""
        splats = self.content.splats
        assert isinstance(splats.colors, Sh)
        dense = splats.colors.dense().clone()
        dense[:, 0] = dc.to(dense)
        return self.with_splats(replace(splats, colors=Sh(dense, splats.colors.degree)))

    def transformed(self, similarity: Similarity) -> EditableSplats:
        """Move the splats, and the capture's cameras with them."""
        content = replace(
            self.content,
            splats=transform_splats(self.content.splats, similarity),
            up=up_after(self.content.up, similarity),
        )
        return replace(self, content=content, moved=composed(similarity, self.moved))

    def with_up(self, axis: str) -> EditableSplats:
        """State the upward direction."""
        return replace(self, content=replace(self.content, up=axis))

    def recolored(self, change: ColorMap) -> EditableSplats:
        """Change all colours."""
        return self.with_splats(colors.recolored(self.content.splats, change))

    def truncated(self, degree: int) -> EditableSplats:
        """Leave out the SH bands above a degree."""
        return self.with_splats(self.content.splats.up_to(degree))


def to_world(splats: Splats, world: Similarity) -> Splats:
    """Splats of a model in the world, in float64 on the CPU."""
    return transform_splats(replace(splats.to("cpu"), rows=None), world)
