"""OutputRule: what becomes of lenses and pictures in a data set that is written."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.errors import ConfigError

LENSES = ("pinhole", "keep")


@dataclass(frozen=True)
class OutputRule:
    """What the user chose."""

    lens: str = "pinhole"
    """pinhole (pictures are undistorted to PINHOLE), or keep (lenses and files stay)."""
    jpeg_quality: int = 95
    """Of JPEG files that are written anew."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ConfigError: one of them makes no sense.
        """
        if self.lens not in LENSES:
            raise ConfigError(f"lens={self.lens}: expected one of {', '.join(LENSES)}.")
        if not 1 <= self.jpeg_quality <= 100:
            raise ConfigError(f"jpeg_quality={self.jpeg_quality}: expected a number from 1 to 100.")
