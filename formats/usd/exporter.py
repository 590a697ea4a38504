"""UsdExporter: writes a stage with one field of Gaussians; one that moves has time samples."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource, Holds, MotionFile
from gsfw.core.ranges import number
from gsfw.formats.usd.field import coefficients_of, field_values, origin_of, upright
from gsfw.formats.usd.package import PACKAGE, SUFFIX, check_available
from gsfw.formats.usd.stage import Field, Playback, write_stage
from gsfw.formats.visible_splats import without_invisible


@dataclass(frozen=True)
class UsdExporter(Exporter):
    """Writes .usdc, .usda (text), .usd or .usdz; motion as samples that USD interpolates."""

    samples: int = number(0, at_least=0)
    """Times at which a moving scene is written, evenly from its first to its last. 0: as many as
    the data have."""
    fps: float = number(30.0, above=0, below=math.inf)
    """Times of the data that are played in a second."""
    cameras: bool = True
    """Write the pinhole cameras that the model was trained with, if it is a run or a model file."""
    half: bool = False
    """Write all values but positions as floats of 16 bits."""

    suffix = SUFFIX
    other_suffixes = (".usda", ".usd", PACKAGE)
    most_sh_degree = 3
    holds = Holds.MOTION

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; SH bands above degree 3 are left out.

        Raises:
            OutputError: it cannot be written.
            ConfigError: its suffix is none of USD.
            UnavailableError: usd-core is not installed.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        suffixes = (self.suffix, *self.other_suffixes)
        if path.suffix.lower() not in suffixes:
            raise ConfigError(
                f"format=usd writes {', '.join(suffixes)}, and no file such as {path.name}.",
                f"Name it {path.with_suffix(self.suffix).name}, for example.",
            )
        check_available()
        file = source.motion_file()
        if file.is_still:
            file = without_invisible(file.content)[0].motion_file()
        content = file.content
        reduced = replace(content, splats=content.splats.up_to(self.most_sh_degree))
        cameras = source.cameras() if self.cameras else ()
        turned, cameras, up = upright(replace(file, content=reduced), cameras)
        last = float(max(file.frames - 1, 1))
        codes = [last * time for time in self._times(file)]
        origin = origin_of(turned)
        samples = ((code, field_values(turned, code / last, origin)) for code in codes)
        field = Field(coefficients_of(turned), samples, origin, self.half)
        playback = None if file.is_still else Playback(last, self.fps)
        write_stage(path, field, up, playback, file, cameras)

    def _times(self, file: MotionFile) -> list[float]:
        """The times of the samples, in [0, 1]."""
        count = 1 if file.is_still else self.samples or max(file.frames, 2)
        return [number / max(count - 1, 1) for number in range(count)]
