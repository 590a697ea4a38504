"""Shown: a scene as its page shows it: the source's content, and the options of the exporters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib.metadata import version

from gsfw.core.background import AUTO, parse_background
from gsfw.core.errors import ConfigError
from gsfw.core.exchange import ExportSource, MotionFile, Preview
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE
from gsfw.formats.visible_splats import without_invisible

NAMELESS = "Gaussian splats"
"""Title of a scene without a name."""


@dataclass(frozen=True)
class Shown:
    """A scene as its page shows it."""

    content: MotionFile
    preview: Preview | None
    """Views and image; ``None`` if the source knows no cameras."""
    title: str
    """Plain text."""
    background: tuple[float, float, float]
    """Colour behind the splats, in [0, 1]."""
    sh_degree: int
    """Degree of view dependence above which nothing is written."""
    metre: float
    """World units that are a metre, for headsets; 0 if that is unknown."""

    @staticmethod
    def of(
        source: ExportSource, title: str, background: str, sh_degree: int, metre: float
    ) -> Shown:
        """The scene of a source, at rest without the splats that are too faint to be seen.

        Args:
            source: has splats at all times.
            title: of the page; empty for the name of the scene.
            background: colour as a setting; empty for that of the source.
            sh_degree: see the field.
            metre: see the field.

        Raises:
            ValueError: the source has no splats, or no motion in closed form.
        """
        content, preview = source.motion_file(), source.preview()
        if content.is_still:
            content = without_invisible(content.content)[0].motion_file()
        color = preview.background if preview else parse_background(AUTO)
        return Shown(
            content,
            preview,
            title=title or (preview.title if preview else NAMELESS),
            background=parse_background(background) if background else color,
            sh_degree=sh_degree,
            metre=metre,
        )

    @property
    def about(self) -> str:
        """A sentence about the scene."""
        count = len(self.content.content.splats)
        kind = "A still" if self.content.is_still else "A moving"
        return f"{kind} scene of {count:,} Gaussian splats, made with gsfw {version('gsfw')}."


def check_options(background: str, sh_degree: int, metre: float) -> None:
    """Check the options that both exporters have.

    Raises:
        ConfigError: one is out of range.
    """
    parse_background(background or AUTO, key="format.background")
    if not 0 <= sh_degree <= MAX_DEGREE:
        raise ConfigError(f"format.sh_degree={sh_degree}: expected 0 to {MAX_DEGREE}.")
    if not 0 <= metre < math.inf:
        raise ConfigError(
            f"format.metre={metre}: expected how many world units are a metre, or 0 for unknown."
        )
