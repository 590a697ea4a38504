"""Sequence: a model that moves as numbered splat files, one per time, and a list of the times."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch

from gsfw.commands.render_path import is_dynamic
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.plugins.compose import Composition
from gsfw.plugins.restore import Restored
from gsfw.plugins.snapshot import snapshot

ALL = "all"
INDEX = "times.json"
DIGITS = 4
"""Of the numbers in file names at least, so that they sort as text."""


def parse_times(text: str, composition: Composition) -> list[float]:
    """The times that ``times=TEXT`` means, in [0, 1].

    Raises:
        ConfigError: it is neither a number nor ``all``, or nothing moves.
    """
    count = int(text) if text.isascii() and text.isdigit() else 0
    if text != ALL and count < 1:
        raise ConfigError(f"times={text}: expected a whole number of at least 1, or {ALL}.")
    if count == 1:
        return [0.0]
    if not is_dynamic(composition):
        scene, method = composition.scene, composition.settings.method.name
        why = f"method {method} is static" if scene.is_dynamic else f"{scene.name} has no times"
        raise ConfigError(
            f"times={text}: {why}, so all files would be the same.", "Leave times out for one file."
        )
    if text == ALL:
        data = composition.parts.data
        return sorted({time for split in Split for time in data.views(split).times or ()})
    return [index / (count - 1) for index in range(count)]


class SplatSequence:
    """Splat files of one model at several times, in one folder.

    ``times.json`` is taken away first and written last: where it is, all files that it lists are
    whole and belong together.
    """

    def __init__(
        self, restored: Restored, exporter: Exporter, times: Sequence[float], folder: Path
    ) -> None:
        """Nothing is written yet.

        Args:
            restored: the model.
            exporter: writes each file.
            times: in [0, 1], in the order of the files.
            folder: made if it is missing.
        """
        self._restored, self._exporter, self._times = restored, exporter, times
        self._folder = folder

    @property
    def index(self) -> Path:
        """The file that says when each of the others is."""
        return self._folder / INDEX

    def write(self) -> Iterator[Path]:
        """Write the files, one at a time; each once it is there.

        Raises:
            OutputError: one cannot be written.
            ValueError: the format cannot hold the splats.
        """
        scene = self._restored.composition.scene
        before = self._listed()
        with readable_write_errors(self.index):
            self.index.unlink(missing_ok=True)
        entries: list[dict[str, object]] = []
        width = max(DIGITS, len(str(len(self._times) - 1)))
        for number, time in enumerate(self._times):
            path = self._folder / f"splats_{number:0{width}d}{self._exporter.suffix}"
            count = self._write_one(path, time)
            entry = {"file": path.name, "time": time, "data_time": None, "splats": count}
            if scene.time_range is not None:
                first, last = scene.time_range
                entry["data_time"] = first + time * (last - first)
            entries.append(entry)
            yield path
        for left_over in before - {str(entry["file"]) for entry in entries}:
            (self._folder / left_over).unlink(missing_ok=True)
        document = {
            "method": self._restored.composition.settings.method.name,
            "step": self._restored.step,
            "files": entries,
        }
        write_atomically(self.index, (json_text(document, indent=1) + "\n").encode())

    def _write_one(self, path: Path, time: float) -> int:
        """The model at one time; the number of splats."""
        parts, plan = self._restored.composition.parts, self._restored.composition.plan
        instant = torch.tensor(time, device=parts.device)
        taken = snapshot(parts.model, parts.data.scene, plan.settings.antialias, instant)
        self._exporter.write(path, taken.content)
        return len(taken.content.splats)

    def _listed(self) -> set[str]:
        """Names of the files of an earlier sequence in this folder, as its list has them."""
        try:
            entries = json.loads(self.index.read_text())["files"]
            names = {str(entry["file"]) for entry in entries}
        except (OSError, ValueError, KeyError, TypeError):
            return set()
        ours = (name for name in names if name.startswith("splats_") and Path(name).name == name)
        return {name for name in ours if Path(name).suffix == self._exporter.suffix}
