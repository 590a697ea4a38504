"""SplatSequence: a moving model as numbered splat files, one per time, and a list of the times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from gsfw.core.exchange import Exporter, SplatFile
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text, parsed_json

INDEX = "times.json"
DIGITS = 4
"""Least number of digits in file names, so that they sort as text."""


class SplatSequence:
    """Splat files of one model at several times, in one folder.

    ``times.json`` is removed first and written last: if it is present, all files that it lists
    are complete and belong together.
    """

    def __init__(
        self,
        exporter: Exporter,
        times: Sequence[float],
        time_range: tuple[float, float] | None,
        folder: Path,
    ) -> None:
        """Store the arguments; writes nothing.

        Args:
            exporter: writes each file.
            times: in [0, 1], in the order of the files.
            time_range: first and last time in the data's own unit; ``None`` for a static capture.
            folder: created if it is missing.
        """
        self._exporter, self._times, self._time_range = exporter, times, time_range
        self._folder = folder

    @property
    def index(self) -> Path:
        """The file that lists the time of each other file."""
        return self._folder / INDEX

    def write(
        self, splats_at: Callable[[float], SplatFile], about: Mapping[str, object]
    ) -> Iterator[Path]:
        """Write the files, and yield the path of each.

        Args:
            splats_at: returns the splats at a time.
            about: further entries of the list, such as the method and the step.

        Raises:
            OutputError: one cannot be written.
            ValueError: the format cannot hold the splats.
        """
        before = self._listed()
        with readable_write_errors(self.index):
            self.index.unlink(missing_ok=True)
        entries: list[dict[str, object]] = []
        width = max(DIGITS, len(str(len(self._times) - 1)))
        for number, time in enumerate(self._times):
            path = self._folder / f"splats_{number:0{width}d}{self._exporter.suffix}"
            content = splats_at(time)
            self._exporter.write(path, content)
            entries.append(
                {
                    "file": path.name,
                    "time": time,
                    "data_time": self._data_time(time),
                    "splats": len(content.splats),
                }
            )
            yield path
        for left_over in before - {str(entry["file"]) for entry in entries}:
            (self._folder / left_over).unlink(missing_ok=True)
        document = {**about, "files": entries}
        write_atomically(self.index, (json_text(document, indent=1) + "\n").encode())

    def _data_time(self, time: float) -> float | None:
        if self._time_range is None:
            return None
        first, last = self._time_range
        return first + time * (last - first)

    def _listed(self) -> set[str]:
        """Names of the files of an earlier sequence in this folder, from its list."""
        return {name for name in files_of(self._folder) if name.endswith(self._exporter.suffix)}


def files_of(folder: Path) -> list[str]:
    """Names of the files of the sequence in a folder, in order of time; empty if it has none."""
    try:
        entries = parsed_json((folder / INDEX).read_text())["files"]
        names = [str(entry["file"]) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [name for name in names if name.startswith("splats_") and Path(name).name == name]
